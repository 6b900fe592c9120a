"""Estimates of one flight with three standard deviations, against the truth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ampi.estimation.estimate import ATTACK, EAST, LIFT, LOCAL, LOG_DRAG, NORTH
from ampi.onboard.reference import Mode
from ampi.report.figures.panels import line_key, panel_grid, place_legend
from ampi.report.figures.style import INK, MODE_STYLES, house_style
from ampi.simulation.estimate_truth import EstimateCourse

Array = NDArray[np.float64]

DEVIATIONS = 3.0
COLOUR = MODE_STYLES[Mode.AMPI].colour


def _percent(logarithm: Array) -> Array:
    return 100.0 * np.expm1(logarithm)


def _itself(value: Array) -> Array:
    return value


PANELS: tuple[tuple[str, tuple[int, ...], Callable[[Array], Array]], ...] = (
    ("Lift and drag (%)", (LOG_DRAG, LOCAL), _percent),
    ("Lift to drag (%)", (LIFT,), _percent),
    ("Angle of attack (°)", (ATTACK,), np.degrees),
    ("Wind to the east (m/s)", (EAST,), _itself),
    ("Wind to the north (m/s)", (NORTH,), _itself),
)


@house_style
def estimates_figure(course: EstimateCourse) -> Figure:
    """What is wrong with the model where the vehicle is, over time, and the altitude there."""
    times, mean, truth, covariance = course.times, course.mean, course.truth, course.covariance
    figure, panels = panel_grid([*(panel[0] for panel in PANELS), "Altitude (km)"], 3)
    for axes, (_, rows, shown) in zip(panels, PANELS, strict=False):
        which = list(rows)
        middle, true = mean[:, which].sum(axis=1), truth[:, which].sum(axis=1)
        wide = DEVIATIONS * np.sqrt(covariance[:, which][:, :, which].sum(axis=(1, 2)))
        low, high = shown(middle - wide), shown(middle + wide)
        axes.fill_between(times, low, high, color=COLOUR, alpha=0.25, linewidth=0.0)
        axes.plot(times, shown(middle), color=COLOUR, linewidth=1.2)
        axes.plot(times, shown(true), color=INK, linewidth=1.2, linestyle="--")
    panels[-1].plot(times, course.altitude / 1e3, color=INK, linewidth=1.2)
    keys = [
        line_key("estimate, with three standard deviations", COLOUR),
        line_key("truth", INK, dashed=True),
    ]
    place_legend(figure, keys)
    return figure
