"""The audit's pictures show every case, every cell, and name what is to be named."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_hex

from ampi.report.figures.audit import (
    CHOSEN_COLOUR,
    MOST_NAMES,
    PANELS,
    CellBar,
    coherence_figure,
    error_map_figure,
)
from ampi.report.figures.style import image_bytes


def test_every_case_is_a_point_and_outliers_are_named() -> None:
    roughness = np.array([0.1, 0.0, 33.0, 0.4, 12.0])
    figure = coherence_figure(roughness, 10.0, {2: "case 2 at grid index (0, 2)", 4: "case 4"})
    (axes,) = figure.axes
    good, bad = axes.lines[0].get_xydata(), axes.lines[1].get_xydata()
    assert good[:, 0].tolist() == [0, 1, 3]
    assert good[[0, 2], 1].tolist() == [0.1, 0.4]
    assert good[1, 1] > 0.0  # a case without roughness still shows on the logarithmic axis
    assert bad.tolist() == [[2, 33.0], [4, 12.0]]
    assert [t.get_text() for t in axes.texts] == ["case 2 at grid index (0, 2)", "case 4"]
    assert axes.get_yscale() == "log"
    assert image_bytes(figure).startswith(b"\x89PNG")


def test_a_case_of_which_nothing_is_known_has_no_height() -> None:
    """At the foot of the panel, not at the smoothest of the axis; named all the same."""
    figure = coherence_figure(np.array([0.1, np.nan, np.nan]), 10.0, {2: "case 2"})
    (axes,) = figure.axes
    drawn = [line.get_xydata().tolist() for line in axes.lines if line.get_marker() in "oDx"]
    assert drawn == [[[0.0, 0.1]], [], [[1.0, 0.04]], [[2.0, 0.04]]]
    assert [line.get_transform() for line in axes.lines[-2:]] == [axes.get_xaxis_transform()] * 2
    (text,) = axes.texts
    assert (text.get_text(), text.xy) == ("case 2", (2, 0.04))
    assert "unknown" in [t.get_text() for t in figure.legends[0].get_texts()]
    all_unknown = coherence_figure(np.full(3, np.nan), 10.0, {})
    assert image_bytes(all_unknown).startswith(b"\x89PNG")


def test_only_the_roughest_are_named() -> None:
    roughness = np.arange(40, dtype=float) + 11.0
    figure = coherence_figure(roughness, 10.0, {i: f"case {i}" for i in range(40)})
    names = [t.get_text() for t in figure.axes[0].texts]
    assert names == [f"case {i}" for i in range(39, 39 - MOST_NAMES, -1)]


def test_every_cell_is_a_bar_and_one_is_chosen() -> None:
    cells = [
        CellBar("speed", "-70 … 0", dict.fromkeys(PANELS, 1.0), False),
        CellBar("density_factor", "-0.1 … 0", dict.fromkeys(PANELS, 3.0), True),
        CellBar("density_factor", "0 … 0.1", dict.fromkeys(PANELS, 2.0), False),
    ]
    figure = error_map_figure(cells)
    assert [axes.get_xlabel() for axes in figure.axes] == list(PANELS.values())
    for axes in figure.axes:
        widths = [bar.get_width() for bar in axes.patches]
        assert widths == pytest.approx([1.0, 3.0, 2.0])
        chosen = [to_hex(bar.get_facecolor()) == CHOSEN_COLOUR.lower() for bar in axes.patches]
        assert chosen == [False, True, False]
    labels = [t.get_text() for t in figure.axes[0].get_yticklabels()]
    assert labels == ["speed\n-70 … 0", "density_factor\n-0.1 … 0", "density_factor\n0 … 0.1"]


def test_a_cell_of_which_nothing_is_known_says_so() -> None:
    cells = [
        CellBar("speed", "-70 … 0", dict.fromkeys(PANELS, float("nan")), False),
        CellBar("speed", "0 … 70", dict.fromkeys(PANELS, 3.0), True),
    ]
    for axes in error_map_figure(cells).axes:
        assert [t.get_text() for t in axes.texts] == ["unknown"]
