"""Plans corrected in flight: those of one flight, and how misses shrink on the way to the target."""

from __future__ import annotations

from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from ampi.correction.corrector import CorrectionOutcome
from ampi.correction.plan import BANKS, CHANGES, equivalent_speed
from ampi.missions.mission import Mission
from ampi.physics.state import ALTITUDE, BANK, SPEED
from ampi.report.figures.panels import FIGURE_WIDTH, line_key, marker_key, place_legend
from ampi.report.figures.style import INK, LIMIT_COLOUR, house_style, new_figure
from ampi.report.quantities import DEGREES, KILO
from ampi.report.scheme_groups import words
from ampi.simulation.correction_log import CorrectionLog
from ampi.simulation.predicted_misses import PredictedMisses

Array = NDArray[np.float64]

TITLE_WIDTH = 100  # characters
LEAST_MISS = 0.1  # m, at which lesser ones are drawn
SHORTEST, LONGEST = 1.0, 700.0  # s to go, ends of the axis
SPEEDS = (5.0, 4.0, 3.0, 2.0, 1.5, 1.0, 0.8, 0.6)  # km/s
FLOWN = "#BBBBBB"
TICKS = (600.0, 300.0, 100.0, 60.0, 30.0, 10.0, 3.0, 1.0)  # s to go
# the colours of a plan by its time to go: viridis' without the light end, which is lost on white
COLOURS = (
    "#B5DE2B",
    "#6CCD5A",
    "#35B779",
    "#1F9E89",
    "#26828E",
    "#31688E",
    "#3E4A89",
    "#482878",
    "#440154",
)
MARKERS = {
    CorrectionOutcome.PLAN_KEPT: ("o", "#5B5B5B"),
    CorrectionOutcome.PLAN_REPLACED: ("o", "#0072B2"),
    CorrectionOutcome.PLAN_BETTERED: ("^", "#E69F00"),
    CorrectionOutcome.OUT_OF_REACH: ("X", "#D55E00"),
    CorrectionOutcome.NO_BETTER: ("s", "#CC79A7"),
    CorrectionOutcome.NO_ARRIVAL: ("P", "#B00020"),
    CorrectionOutcome.NO_STATE: ("D", "#000000"),
}
LEVELS = {  # colour and percentile
    "median": ("#0072B2", 50.0),
    "95 %": ("#E69F00", 95.0),
    "worst": ("#D55E00", 100.0),
}


@house_style
def corrections_figure(mission: Mission, log: CorrectionLog, name: str) -> Figure:
    """One flight: every plan that it flew over the equivalent speed, and what each promised."""
    figure = new_figure(FIGURE_WIDTH, 6.6)
    grid = figure.add_gridspec(2, 2, height_ratios=(1.25, 1.0))
    bank, change = (figure.add_subplot(grid[0, k]) for k in (0, 1))
    misses = figure.add_subplot(grid[1, :])
    flights, limits = log.flight, mission.limits
    ended = f"ends {_metres(float(flights.miss[0]))} from the target"
    title = fill(f"{mission.title}, {name}: {len(log)} corrections, {ended}", TITLE_WIDTH)
    figure.suptitle(title, fontsize=10.5, parse_math=False)
    speed = _flown_speed(mission, log)
    _plans(bank, log, BANKS, (speed, flights.states[0, BANK]), limits.bank_angle)
    most = limits.angle_of_attack_change
    _plans(change, log, CHANGES, (speed, flights.angle_of_attack[0]), most)
    bank.set_ylabel("Bank angle (deg)")
    change.set_ylabel("Change of the angle of attack (deg)")
    scale = ScalarMappable(_scale(log), _colours())
    bar = figure.colorbar(scale, ax=change, label="Plans, by their time to go (s)", pad=0.02)
    bar.ax.invert_yaxis()
    keys = [
        line_key("flown", FLOWN, width=4.0),
        line_key("limit", LIMIT_COLOUR, dashed=True, width=1.2),
    ]
    _misses(misses, log)
    place_legend(figure, [*keys, *_outcome_keys(log)])
    return figure


def _flown_speed(mission: Mission, log: CorrectionLog) -> Array:
    """Equivalent speed (k,), m/s, at the recorded points."""
    states = log.flight.states[0]
    altitude = mission.family(log.flight.parameters).target("altitude")[0]
    gravity = mission.flight_model.planet.load_factor_gravity
    return np.asarray(equivalent_speed(gravity, altitude, states[ALTITUDE], states[SPEED]))


def _scale(log: CorrectionLog) -> Normalize:
    return Normalize(0.0, float(np.max(log.to_go, initial=SHORTEST)))


def _colours() -> Colormap:
    return LinearSegmentedColormap.from_list("to go", list(reversed(COLOURS)))


def _plans(
    axes: Axes,
    log: CorrectionLog,
    rows: slice,
    flown: tuple[Array, Array],
    limit: float | None,
) -> None:
    """Values of all plans, and what was flown: (equivalent speed, angle)."""
    plans = log.plans
    values = plans.values[rows] * DEGREES
    share = np.linspace(0.0, 1.0, len(values))[:, None]
    speeds = (plans.fast + share * (plans.slow - plans.fast)) * KILO
    order = np.argsort(-log.to_go, kind="stable")
    lines = [np.column_stack([speeds[:, k], values[:, k]]) for k in order]
    colours = _colours()(_scale(log)(log.to_go[order]))
    axes.add_collection(LineCollection(lines, colors=colours, linewidths=0.8, zorder=3))
    begun = np.flatnonzero(log.flight.times >= log.times[0]) if len(log) else slice(0)
    axes.plot(flown[0][begun] * KILO, flown[1][begun] * DEGREES, color=FLOWN, linewidth=4.0)
    for level in () if limit is None else (-limit, limit):
        axes.axhline(level * DEGREES, color=LIMIT_COLOUR, linewidth=1.2, linestyle=(0, (5, 3)))
    axes.set_xscale("log")  # half of the flight is below a third of the speed
    axes.set(xlabel="Equivalent speed (km/s)", xlim=(1.03 * speeds.max(), 0.97 * speeds.min()))
    axes.set_xticks(SPEEDS, [f"{tick:g}" for tick in SPEEDS])
    axes.minorticks_off()
    axes.autoscale_view(scalex=False)


def _misses(axes: Axes, log: CorrectionLog) -> None:
    """Of each plan the predicted miss over the ground, by outcome; and the one that came."""
    miss = np.maximum(np.linalg.norm(log.miss[:, :2], axis=1), LEAST_MISS)
    axes.plot(log.to_go, miss, color="#BBBBBB", linewidth=0.8, zorder=1)
    for outcome, (marker, colour) in MARKERS.items():
        of = log.outcome == outcome
        axes.plot(log.to_go[of], miss[of], marker, color=colour, markersize=4.5, zorder=2)
    actual = float(log.flight.miss[0])
    if np.isfinite(actual):
        axes.axhline(actual, color=INK, linewidth=1.2, linestyle=":")
        axes.annotate(
            f"actual miss {_metres(actual)}",
            (0.01, actual),
            (0.0, 3.0),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            fontsize=9.0,
        )
    _over_time_to_go(axes)
    axes.set_ylabel("Predicted miss (m)")


def _over_time_to_go(axes: Axes) -> None:
    """From the first correction to the end, on logarithmic axes."""
    axes.set(xscale="log", yscale="log", xlim=(LONGEST, 0.9 * SHORTEST), xlabel="Time to go (s)")
    axes.set_xticks(TICKS, [f"{tick:g}" for tick in TICKS])
    axes.minorticks_off()
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _outcome_keys(log: CorrectionLog) -> list[Line2D]:
    return [
        marker_key(words(outcome.name), *MARKERS[outcome])
        for outcome in MARKERS
        if np.any(log.outcome == outcome)
    ]


@house_style
def time_to_go_figure(found: PredictedMisses) -> Figure:
    """Of many flights, what their last corrections predict, and dashed what came of it."""
    figure = new_figure(FIGURE_WIDTH, 4.0)
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    sides = (
        (left, found.miss, found.actual_miss, "Miss over the ground"),
        (right, found.altitude, found.actual_altitude, "Error of the altitude"),
    )
    for axes, predicted, actual, title in sides:
        for colour, percentile in LEVELS.values():
            curve = _percentiles(predicted, percentile)
            axes.plot(found.to_go, curve, color=colour, linewidth=1.8)
            level = float(np.percentile(actual, percentile, method="higher"))
            if np.isfinite(level):
                axes.axhline(level, color=colour, linewidth=1.1, linestyle=(0, (4, 3)))
        _over_time_to_go(axes)
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: _metres(value)))
        axes.set_title(title)
    left.set_ylabel(f"{len(found.actual_miss)} flights, as predicted")
    keys = [line_key(label, colour) for label, (colour, _) in LEVELS.items()]
    place_legend(figure, [*keys, line_key("as it came", "#888888", dashed=True, width=1.2)])
    return figure


def _percentiles(values: Array, percentile: float) -> Array:
    """(k,): over the flights that are known of (k, n); not-a-number while half of them are not."""
    known = np.isfinite(values)
    found = np.full(len(values), np.nan)
    for k in np.flatnonzero(known.mean(axis=1) > 0.5):
        found[k] = np.percentile(values[k, known[k]], percentile)
    return np.maximum(found, LEAST_MISS)


def _metres(value: float) -> str:
    """A length in m or km."""
    if value >= 1e3:
        return f"{value * KILO:.3g} km"
    return f"{value:.0f} m" if value >= 10.0 else f"{value:.2g} m"
