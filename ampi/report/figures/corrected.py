"""Corrections in flight, over a campaign: what they make of each miss, and what they steer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from ampi.missions.mission import Mission
from ampi.report.figures.misses import FARTHEST
from ampi.report.figures.panels import (
    draw_bundle,
    draw_limits,
    limit_key,
    line_key,
    marker_key,
    place_legend,
)
from ampi.report.figures.scheme_style import style_of
from ampi.report.figures.style import INK, house_style, new_figure
from ampi.report.figures.world_panels import WIDTH
from ampi.report.quantities import DEGREES, KILO, TIME
from ampi.report.scheme_groups import UNCORRECTED, by_world, is_corrected, words
from ampi.simulation.flights import Flights

HEIGHT = 3.3  # inches, of a row
LEAST = 1.0  # m: lesser misses are drawn there


@dataclass(frozen=True, eq=False)
class Pair:
    """A corrected campaign, and the same without correction, if it was flown on the same draws."""

    corrected: Flights
    plain: Flights | None


def pairs(campaigns: Mapping[str, Flights]) -> dict[str, Pair]:
    """World and correction → AMPI's corrected flights, or those of another reference."""
    found = {}
    for world, own in by_world(campaigns).items():
        for correction in dict.fromkeys(f.correction for f in own.values() if is_corrected(f)):
            flights = [f for f in own.values() if f.correction == correction]
            corrected = next((f for f in flights if f.mode.value == "ampi"), flights[0])
            plain = next((f for f in own.values() if _is_plain(f, corrected)), None)
            found[f"{world}, {words(correction)}"] = Pair(corrected, plain)
    return found


def _is_plain(other: Flights, corrected: Flights) -> bool:
    return (
        other.correction == UNCORRECTED
        and (other.law, other.mode) == (corrected.law, corrected.mode)
        and np.array_equal(other.seeds, corrected.seeds)
        and np.array_equal(other.numbers, corrected.numbers)
    )


@house_style
def corrections_of_campaigns(mission: Mission, campaigns: Mapping[str, Flights]) -> Figure:
    """A row per world: misses with over misses without, and the change of the angle of attack."""
    found = pairs(campaigns)
    figure = new_figure(WIDTH, HEIGHT * len(found) + 0.4)
    grid = figure.subplots(len(found), 2, squeeze=False, sharex="col", width_ratios=(1.0, 1.6))
    for (left, right), (title, pair) in zip(grid, found.items(), strict=True):
        left.set_title(title, loc="left", parse_math=False)
        _misses(left, pair)
        _changes(right, pair.corrected, mission.limits.angle_of_attack_change)
    grid[-1][0].set_xlabel("Miss without correction (km)")
    grid[-1][1].set_xlabel(TIME.label)
    first = next(iter(found.values())).corrected
    style = style_of(first)
    keys = [
        marker_key("a flight", style.marker, style.colour),
        line_key("no better", INK, dashed=True, width=1.0),
        line_key("change of the angle of attack", style.colour),
    ]
    place_legend(figure, [*keys, limit_key()])
    return figure


def _misses(axes: Axes, pair: Pair) -> None:
    """Each flight twice flown: below the dashed line the correction has brought it nearer."""
    axes.set_ylabel("Miss with correction (km)")
    if pair.plain is None:
        axes.text(0.5, 0.5, "not flown without", transform=axes.transAxes, ha="center")
        return
    style, both = style_of(pair.corrected), pair.plain.reached & pair.corrected.reached
    x, y = (np.clip(f.miss[both], LEAST, FARTHEST) * KILO for f in (pair.plain, pair.corrected))
    axes.plot(x, y, style.marker, color=style.colour, markersize=3.5, alpha=0.5, fillstyle="none")
    ends = np.array([LEAST, FARTHEST]) * KILO
    axes.plot(ends, ends, color=INK, linewidth=1.0, linestyle=(0, (5, 3)))
    axes.set(xscale="log", yscale="log", xlim=ends, ylim=ends)
    nearer, lost = int(np.sum(y < x)), int(np.sum(~pair.corrected.reached))
    told = f"{nearer} of {len(x)} nearer" + (f", {lost} lost" if lost else "")
    axes.annotate(told, (0.04, 0.92), xycoords="axes fraction", fontsize=9.0)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _changes(axes: Axes, flights: Flights, limit: float | None) -> None:
    """The change of the angle of attack over time, or that none is flown."""
    axes.set_ylabel("Change (deg)")
    changes = flights.angle_of_attack[()] * DEGREES
    colour = style_of(flights).colour
    draw_bundle(axes, flights.times, changes, colour)
    if limit is not None:
        draw_limits(axes, [-limit * DEGREES, limit * DEGREES])
