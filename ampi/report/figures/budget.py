"""The uncertainty budget: what share of the spread along the track each dispersed number accounts for.

Of numbers drawn independently of one another, ρ² of Spearman's rank correlation with the miss along the
track is the share of the variance of its ranks that goes with that number alone. What they leave is
interaction, noise of the sensors, and what is not monotonic.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ampi.missions.mission import Mission
from ampi.report.correlations import correlations
from ampi.report.figures.panels import line_key, place_legend
from ampi.report.figures.sensitivity import PALE, explained
from ampi.report.figures.style import DATABASE_COLOUR, INK, house_style, new_figure
from ampi.report.figures.world_panels import WIDTH
from ampi.simulation.estimates.bootstrap import Estimate
from ampi.simulation.flights import Flights

MOST = 8  # numbers with a bar of their own
OTHERS, LEFT = "all others", "not explained"
BAR = 0.26  # inches
PERCENT = 100.0


def budget(mission: Mission, flights: Flights) -> dict[str, Estimate]:
    """Shares (0 … 1) of the variance, the greatest first; then the others and what is left.

    Empty where too few flights arrived to tell.
    """
    rho = {name: one.along for name, one in correlations(mission, flights).items()}
    shares = {name: _squared(one) for name, one in rho.items() if np.isfinite(one.value)}
    order = sorted(shares, key=lambda name: -shares[name].value)
    if not order:
        return {}
    rest = sum(shares[name].value for name in order[MOST:])
    left = 1.0 - sum(one.value for one in shares.values())
    found = {name: shares[name] for name in order[:MOST]}
    found[OTHERS] = Estimate(rest, np.nan, np.nan)
    found[LEFT] = Estimate(max(left, 0.0), np.nan, np.nan)
    return found


def _squared(one: Estimate) -> Estimate:
    """ρ² with the interval of ρ, which may hold 0."""
    ends = sorted((one.low**2, one.high**2))
    return Estimate(one.value**2, 0.0 if one.low <= 0.0 <= one.high else ends[0], ends[1])


@house_style
def budget_figure(mission: Mission, campaigns: Mapping[str, Flights]) -> Figure:
    """A panel for each campaign that is explained."""
    found = {name: budget(mission, f) for name, f in explained(campaigns).items()}
    columns = min(len(found), 2)
    rows = -(-len(found) // columns)
    figure = new_figure(WIDTH, rows * ((MOST + 2) * BAR + 0.9) + 0.4)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True).ravel()
    for axes in grid[len(found) :]:
        axes.remove()
    for axes, (name, shares) in zip(grid, found.items(), strict=False):
        axes.set_title(name, loc="left", parse_math=False)
        _draw(axes, shares)
    for axes in grid[: len(found)][-columns:]:
        axes.set_xlabel("Share of the variance, in ranks (%)")
        axes.tick_params(labelbottom=True)
    keys = [
        line_key("by one number", DATABASE_COLOUR, width=6.0),
        line_key("by none alone", PALE, width=6.0),
        line_key("95 % interval", INK, width=1.0),
    ]
    place_legend(figure, keys)
    return figure


def _draw(axes: Axes, shares: Mapping[str, Estimate]) -> None:
    for row, (name, one) in enumerate(shares.items()):
        colour = PALE if name in (OTHERS, LEFT) else DATABASE_COLOUR
        axes.barh(row, PERCENT * one.value, height=0.7, color=colour)
        axes.plot([PERCENT * one.low, PERCENT * one.high], [row, row], color=INK, linewidth=1.0)
    if not shares:
        axes.text(0.5, 0.5, "unknown", transform=axes.transAxes, ha="center", va="center")
    axes.set_yticks(range(len(shares)), list(shares))
    axes.set(xlim=(0.0, 100.0), ylim=(max(len(shares), 1) - 0.4, -0.6))
    axes.grid(visible=False, axis="y")
