"""Why the nodes are not uniform: Runge's function, after Sagliano et al. 2016, Figs. 9 and 10."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ampi.onboard.reference import Mode
from ampi.pseudospectral.lagrange import barycentric_weights, interpolation_matrix
from ampi.pseudospectral.radau import flipped_radau
from ampi.report.figures.panels import FIGURE_WIDTH, line_key, marker_key, place_legend
from ampi.report.figures.style import INK, MODE_STYLES, house_style, new_figure

Array = NDArray[np.float64]

NODE_COUNTS = (11, 25)
WINDOW = (-0.6, 1.6)  # the uniform interpolant leaves it by far; its extreme is printed instead


@house_style
def runge_phenomenon(node_counts: tuple[int, ...] = NODE_COUNTS) -> Figure:
    """1/(1 + 25 τ²) interpolated through uniform and flipped Radau nodes [Figs. 9, 10]."""
    figure = new_figure(FIGURE_WIDTH, 3.1 * len(node_counts) + 0.4)
    grid = figure.subplots(len(node_counts), 2, squeeze=False, sharex=True, sharey=True)
    for row, count in zip(grid, node_counts, strict=True):
        _draw_interpolant(row[0], np.linspace(-1.0, 1.0, count), f"{count} uniform nodes")
        _draw_interpolant(row[1], flipped_radau(count - 1).nodes, f"{count} flipped Radau nodes")
        row[0].set_ylabel("F(τ) (–)")
    for axes in grid[-1]:
        axes.set_xlabel("τ (–)")
    colour = MODE_STYLES[Mode.AMPI].colour
    place_legend(
        figure,
        [
            line_key("1/(1 + 25 τ²)", INK, dashed=True, width=1.4),
            line_key("interpolant", colour),
            marker_key("nodes", "o", colour),
        ],
    )
    return figure


def runge_function(tau: Array) -> Array:
    """F(τ) = 1/(1 + 25 τ²)."""
    return np.asarray(1.0 / (1.0 + 25.0 * tau * tau))


def _draw_interpolant(axes: Axes, nodes: Array, title: str) -> None:
    tau = np.linspace(-1.0, 1.0, 801)
    interpolant = interpolation_matrix(nodes, barycentric_weights(nodes), tau) @ runge_function(
        nodes
    )
    error = float(np.abs(interpolant - runge_function(tau)).max())
    colour = MODE_STYLES[Mode.AMPI].colour
    axes.plot(tau, interpolant, color=colour, linewidth=1.8)
    axes.plot(tau, runge_function(tau), color=INK, linewidth=1.4, linestyle=(0, (5, 3)))
    axes.plot(nodes, runge_function(nodes), "o", color=colour, markersize=4)
    axes.set(ylim=WINDOW, title=f"{title}: greatest error {error:.3g}")
