"""Footprints of known shapes, what outliers do to them, and the map against geodesics."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from ampi.physics.planet import WGS84, bearing, destination, great_circle_distance
from ampi.simulation.estimates.ellipses import (
    ELLIPSE,
    Ellipse,
    Place,
    containing_ellipse,
    covariance_ellipse,
    ellipse_area,
    robust_shape,
)

Maker = Callable[[np.ndarray, np.ndarray], Ellipse | None]

laws = settings(deadline=None, max_examples=60)


def scatter(n: int, seed: int = 0) -> np.ndarray:
    """(2, n), m: across and along, correlated, off the target."""
    rng = np.random.default_rng(seed)
    return np.array([[3e3, 0.0], [1e3, 5e2]]) @ rng.standard_normal((2, n)) + [[800.0], [-200.0]]


def inside(ellipse: Ellipse, points: np.ndarray, slack: float = 1e-9) -> int:
    """Points within, by its axes."""
    across, along = points - np.array(ellipse.centre)[:, None]
    cos, sin = math.cos(ellipse.angle), math.sin(ellipse.angle)
    major = (cos * across + sin * along) / ellipse.semi_axes[0]
    minor = (cos * along - sin * across) / ellipse.semi_axes[1]
    return int(np.count_nonzero(np.hypot(major, minor) <= 1.0 + slack))


def test_the_covariance_ellipse_is_that_of_its_area() -> None:
    points = scatter(500)
    got = covariance_ellipse(*points)
    assert got is not None
    assert got.area == pytest.approx(ellipse_area(points[1], points[0]), rel=1e-12)
    assert got.holds == inside(got, points)
    assert got.centre == pytest.approx(tuple(points.mean(axis=1)), rel=1e-12)


@pytest.mark.parametrize("make", [covariance_ellipse, containing_ellipse])
def test_the_edge_lies_on_the_ellipse(make: Maker) -> None:
    got = make(*scatter(400, 3))
    assert got is not None
    edge = np.stack(got.outline(73))
    assert inside(got, edge) == 73
    assert inside(got, edge, slack=-1e-9) == 0
    assert np.allclose(edge[:, 0], edge[:, -1])
    turned = edge[0, :-1] @ edge[1, 1:] - edge[0, 1:] @ edge[1, :-1]
    assert 0.5 * turned == pytest.approx(got.area, rel=2e-3)  # counter-clockwise


@laws
@given(n=st.integers(10, 300), seed=st.integers(0, 999), share=st.floats(0.0, 0.05))
def test_it_holds_95_percent_of_all_flights_lost_ones_outside(
    n: int, seed: int, share: float
) -> None:
    points = scatter(n, seed)
    points[:, : math.floor(share * n)] = np.nan
    got = containing_ellipse(*points)
    assert got is not None
    assert (got.holds, got.n) == (math.ceil(0.95 * n), n)
    assert inside(got, points) == got.holds


def test_no_ellipse_holds_what_did_not_arrive() -> None:
    points = scatter(100)
    points[0, :6] = np.inf
    assert containing_ellipse(*points) is None
    got = covariance_ellipse(*points)  # speaks of those that arrived
    assert got is not None
    assert got.n == 100


@laws
@given(
    matrix=st.tuples(*[st.floats(-3.0, 3.0)] * 4).filter(
        lambda m: abs(m[0] * m[3] - m[1] * m[2]) > 0.3
    ),
    shift=st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5)),
)
def test_it_turns_and_stretches_with_the_points(
    matrix: tuple[float, ...], shift: tuple[float, float]
) -> None:
    points, change = scatter(150, 7), np.reshape(matrix, (2, 2))
    centre, shape = robust_shape(points.T)
    moved, stretched = robust_shape((change @ points).T + shift)
    assert moved == pytest.approx(change @ centre + shift, rel=1e-5, abs=0.05)
    assert stretched == pytest.approx(change @ shape @ change.T, rel=1e-4, abs=100.0)
    one = containing_ellipse(*points)
    other = containing_ellipse(*(change @ points + np.array(shift)[:, None]))
    assert one is not None and other is not None
    assert other.area == pytest.approx(abs(np.linalg.det(change)) * one.area, rel=1e-4)


def test_the_robust_shape_is_the_likeliest_of_a_cauchy() -> None:
    """scipy's multivariate t: no step away from it is likelier."""
    points = scatter(80, 5).T
    centre, shape = robust_shape(points)
    best = stats.multivariate_t(centre, shape, df=1).logpdf(points).sum()
    rng = np.random.default_rng(1)
    for _ in range(200):
        step = 0.02 * rng.standard_normal((2, 2))
        change = np.eye(2) + step
        off = centre + 20.0 * rng.standard_normal(2)
        other = stats.multivariate_t(off, change @ shape @ change.T, df=1).logpdf(points).sum()
        assert other <= best


def test_a_normal_keeps_its_shape() -> None:
    points = scatter(20_000, 2)
    robust, plain = containing_ellipse(*points), covariance_ellipse(*points)
    assert robust is not None and plain is not None
    assert robust.semi_axes == pytest.approx(plain.semi_axes, rel=0.03)
    assert robust.angle == pytest.approx(plain.angle, abs=0.01)


def test_outliers_do_not_carry_it_away() -> None:
    """Forty of a thousand flights 300 km off: the covariance follows, the containment hardly."""
    clean, dirty = scatter(1000, 4), scatter(1000, 4)
    dirty[:, :40] = 3e5 * np.array([[1.0], [0.5]])
    robust, before = containing_ellipse(*dirty), containing_ellipse(*clean)
    plain = covariance_ellipse(*dirty)
    assert robust is not None and before is not None and plain is not None
    assert robust.area < 3.0 * before.area
    assert plain.area > 20.0 * before.area


@pytest.mark.parametrize("make", [covariance_ellipse, containing_ellipse])
def test_points_on_a_line_or_too_few_have_none(make: Maker) -> None:
    line = np.arange(30.0)
    assert make(line, 2.0 * line) is None
    assert make(line[:2], line[1:3]) is None
    assert make(np.full(30, 5.0), np.full(30, 1.0)) is None
    assert make(np.full(9, np.nan), np.full(9, np.nan)) is None


# --- on the globe ---------------------------------------------------------------------------------


@pytest.mark.parametrize("latitude", [-1.2, 0.0, 1.2, 1.5])
def test_the_map_gives_back_the_misses(latitude: float) -> None:
    """Distance and bearing from the target, as a campaign measures them."""
    target = Place(0.3, latitude, 0.7, WGS84.equatorial_radius)
    ellipse = Ellipse((20e3, -30e3), (80e3, 10e3), 0.4, 0, 0)
    across, along = ellipse.outline()
    edge = ellipse.on_map(target)
    miss = great_circle_distance(*target[:2], *edge, target.radius)
    off = bearing(*target[:2], *edge) - target.azimuth
    assert miss * np.sin(off) == pytest.approx(across, abs=1e-3)
    assert miss * np.cos(off) == pytest.approx(along, abs=1e-3)
    assert np.isclose(edge[0][0], edge[0][-1])


def geodetic(geocentric: float, flattening: float) -> float:
    return math.atan(math.tan(geocentric) / (1.0 - flattening) ** 2)


def test_how_much_the_great_circle_differs_from_the_geodesic() -> None:
    """The bounds that the module states, of 25 km all over the ellipsoid."""
    geodesic = pytest.importorskip("geographiclib.geodesic").Geodesic.WGS84
    distance = 25e3
    as_geocentric, as_geodetic = [], []
    for latitude in np.radians([-88.0, -60.0, -30.0, -1.0, 0.0, 45.0, 69.0, 80.0, 88.0]):
        for azimuth in np.radians(np.arange(0.0, 360.0, 30.0)):
            end = destination(0.3, latitude, azimuth, distance / WGS84.equatorial_radius)
            for found, convert in (
                (as_geodetic, lambda angle: angle),
                (as_geocentric, lambda angle: geodetic(angle, geodesic.f)),
            ):
                start, stop = (math.degrees(convert(angle)) for angle in (latitude, end[1]))
                witness = geodesic.Inverse(start, math.degrees(0.3), stop, math.degrees(end[0]))
                found.append(distance / witness["s12"] - 1.0)
    assert min(as_geocentric) == pytest.approx(0.0, abs=1e-6)
    assert max(as_geocentric) == pytest.approx(0.0034, abs=1e-4)
    assert max(as_geocentric) * distance == pytest.approx(84.0, abs=0.5)
    assert (min(as_geodetic), max(as_geodetic)) == pytest.approx((-0.0034, 0.0067), abs=1e-4)


def test_the_scale_of_the_covariance_ellipse_is_chi_squared() -> None:
    assert pytest.approx(stats.chi2(2).ppf(0.95), rel=1e-12) == ELLIPSE
