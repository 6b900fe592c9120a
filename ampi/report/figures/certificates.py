"""Certificates against flights: predicted and flown misses, mode by mode."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from ampi.onboard.reference import Mode
from ampi.report.figures.panels import FIGURE_WIDTH, line_key, marker_key, place_legend
from ampi.report.figures.style import INK, MODE_STYLES, house_style, new_figure
from ampi.simulation.certificate_truth import CheckedCertificates

SMALLEST = 1.0  # m: what the integrators may differ by


@house_style
def certificate_figure(checked: Mapping[Mode, CheckedCertificates]) -> Figure:
    """Predicted over flown misses, and the relative error over the flown miss; those that ended."""
    figure = new_figure(FIGURE_WIDTH, 4.4)
    misses, errors = figure.subplots(1, 2)
    ends: list[float] = []
    for mode, own in checked.items():
        style = MODE_STYLES[mode]
        for inside in (True, False):
            chosen = (own.inside == inside) & np.isfinite(own.predicted) & np.isfinite(own.flown)
            flown = np.maximum(own.flown[chosen], SMALLEST) / 1e3
            drawn = {
                "color": style.colour,
                "marker": style.marker,
                "markersize": 3.5,
                "linestyle": "none",
                "fillstyle": "full" if inside else "none",
                "alpha": 0.6,
            }
            misses.plot(flown, np.maximum(own.predicted[chosen], SMALLEST) / 1e3, **drawn)
            errors.plot(flown, own.relative_error[chosen], **drawn)
            ends += [flown.min(), flown.max()] if len(flown) else []
    diagonal = [0.7 * min(ends), 1.4 * max(ends)] if ends else [1e-3, 1.0]
    misses.plot(diagonal, diagonal, color=INK, linewidth=0.8)
    misses.set(xscale="log", yscale="log", xlabel="Flown miss (km)", ylabel="Predicted miss (km)")
    errors.set(xscale="log", yscale="log", xlabel="Flown miss (km)", ylabel="Error / flown miss")
    keys = [
        marker_key(
            f"{mode.value} (rank correlation {own.rank_correlation:.5f})",
            MODE_STYLES[mode].marker,
            MODE_STYLES[mode].colour,
        )
        for mode, own in checked.items()
    ]
    keys.append(line_key("equal; open: outside the hypercube", INK, width=0.8))
    place_legend(figure, keys)
    return figure
