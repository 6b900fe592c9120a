"""Coast lines are cut at the window's edges, and land stays land."""

from __future__ import annotations

import numpy as np
import pytest

from ampi.explorer.coast import Array, clipped, land

WINDOW = {"west": 0.0, "east": 4.0, "south": 0.0, "north": 3.0}


def area(ring: Array) -> float:
    """By the shoelace formula."""
    (x, y), (u, v) = ring.T, np.roll(ring, -1, axis=0).T
    return 0.5 * abs(float(np.sum(x * v - u * y)))


def test_a_ring_inside_is_itself() -> None:
    ring = np.array([[1.0, 1.0], [2.0, 1.0], [2.0, 2.0]])
    assert np.array_equal(clipped(ring, WINDOW), ring)


def test_a_ring_around_the_window_is_the_window() -> None:
    ring = np.array([[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]])
    found = clipped(ring, WINDOW)
    assert area(found) == pytest.approx(12.0)
    assert {tuple(point) for point in found} == {(0, 0), (4, 0), (4, 3), (0, 3)}


def test_a_ring_outside_is_nothing() -> None:
    assert len(clipped(np.array([[5.0, 0.0], [6.0, 0.0], [6.0, 1.0]]), WINDOW)) == 0


def test_a_comb_that_crosses_an_edge_many_times_keeps_its_area() -> None:
    teeth = [
        (x, y)
        for k in range(4)
        for x, y in ((k + 0.1, -2.0), (k + 0.1, 1.0), (k + 0.6, 1.0), (k + 0.6, -2.0))
    ]
    found = clipped(np.array([*teeth, (3.6, -3.0), (0.1, -3.0)]), WINDOW)
    assert area(found) == pytest.approx(4 * 0.5)
    assert np.all((found >= [0.0, 0.0]) & (found <= [4.0, 3.0]))


def test_greenland_lies_where_it_lies() -> None:
    """Its ice cap is land throughout, the sea east of Iceland is none, on any turn."""
    inland = {"west": -42.0, "east": -38.0, "south": 70.0, "north": 74.0}
    (ring,) = land(inland)
    assert area(ring) == pytest.approx(16.0)
    turned = {**inland, "west": 318.0, "east": 322.0}
    assert area(land(turned)[0]) == pytest.approx(16.0)
    assert land({"west": -8.0, "east": -4.0, "south": 66.0, "north": 70.0}) == []


def test_every_point_is_in_the_window() -> None:
    window = {"west": -60.0, "east": 5.0, "south": 60.0, "north": 80.0}
    for ring in land(window):
        assert np.all(ring >= [-60.0, 60.0]) and np.all(ring <= [5.0, 80.0])


def test_antarctica_reaches_the_pole_and_chukotka_the_date_line() -> None:
    """The ice within two degrees of the pole is land all around; land goes on at 180°."""
    pole = {"west": 150.0, "east": 260.0, "south": -90.0, "north": -88.0}
    assert sum(map(area, land(pole))) == pytest.approx(110.0 * 2.0)
    tundra = {"west": 178.0, "east": 181.0, "south": 67.5, "north": 68.5}
    assert sum(map(area, land(tundra))) == pytest.approx(3.0)
