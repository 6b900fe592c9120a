"""What misses come from: rank correlations with everything that was dispersed, as bars."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.report.correlations import Correlation, correlations
from ampi.report.figures.panels import line_key, place_legend
from ampi.report.figures.style import DATABASE_COLOUR, INK, house_style, new_figure
from ampi.report.figures.world_panels import WIDTH
from ampi.report.scheme_groups import (
    by_world,
    differs_from_model,
    first_law,
    is_corrected,
    words,
)
from ampi.simulation.estimates.bootstrap import Estimate
from ampi.simulation.flights import Flights

PALE = "#C9D3E3"  # of bars whose interval holds 0
BAR = 0.22  # inches
LABELS = {
    "miss": "Rank correlation with the distance missed (–)",
    "along": "Rank correlation with the miss along the track (–)",
}


def explained(campaigns: Mapping[str, Flights]) -> dict[str, Flights]:
    """One campaign of each world that differs, or of each if none does: of the first law, AMPI's.

    A second one of what is corrected in flight, for other errors are left.
    """
    worlds = by_world(campaigns)
    wrong = {w: own for w, own in worlds.items() if differs_from_model(next(iter(own.values())))}
    found = {}
    for world, flown in (wrong or worlds).items():
        law = list(first_law(flown).values())
        for corrected in (False, True):
            own = [f for f in law if is_corrected(f) is corrected]
            if own:
                name = f"{world}, corrected" if corrected else world
                found[name] = next((f for f in own if f.mode is Mode.AMPI), own[-1])
    return found


@house_style
def sensitivity(mission: Mission, campaigns: Mapping[str, Flights]) -> Figure:
    """A row per world: the distance missed, and the signed miss along the track."""
    found = {
        world: (flights, correlations(mission, flights))
        for world, flights in explained(campaigns).items()
    }
    counts = [len(own) + 2 for _, own in found.values()]
    figure = new_figure(WIDTH, BAR * sum(counts) + 0.7 * len(counts) + 0.5)
    grid = figure.subplots(len(found), 2, squeeze=False, sharex=True, height_ratios=counts)
    for row, (world, (flights, own)) in zip(grid, found.items(), strict=True):
        title = f"{world}: {words(flights.law)}, {flights.mode.value}, {flights.n} flights"
        row[0].set_title(title, loc="left", parse_math=False)
        for axes, output in zip(row, LABELS, strict=True):
            _draw(axes, own, output)
        row[1].tick_params(labelleft=False)
    for axes, label in zip(grid[-1], LABELS.values(), strict=True):
        axes.set_xlabel(label)
    place_legend(
        figure,
        [
            line_key("interval without 0", DATABASE_COLOUR, width=6.0),
            line_key("interval with 0", PALE, width=6.0),
            line_key("95 % interval", INK, width=1.0),
        ],
    )
    return figure


def _draw(axes: Axes, found: Mapping[str, Correlation], output: str) -> None:
    """Bars from the top, with their intervals."""
    names = list(found)
    estimates: list[Estimate] = [getattr(found[name], output) for name in names]
    rows = np.arange(len(names))
    for row, estimate in zip(rows.tolist(), estimates, strict=True):
        if not np.isfinite(estimate.value):
            continue
        colour = PALE if estimate.low <= 0.0 <= estimate.high else DATABASE_COLOUR
        axes.barh(row, estimate.value, height=0.7, color=colour)
        axes.plot([estimate.low, estimate.high], [row, row], color=INK, linewidth=1.0)
    if not any(np.isfinite(estimate.value) for estimate in estimates):
        axes.text(0.5, 0.5, "unknown", transform=axes.transAxes, ha="center", va="center")
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set(xlim=(-1.0, 1.0), ylim=(len(names) - 0.4, -0.6))
    axes.set_yticks(rows, names)
    axes.grid(visible=False, axis="y")
