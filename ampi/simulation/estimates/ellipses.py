"""Footprints: the 95 % ellipse of a covariance, and the one that holds 95 % of all flights.

A covariance follows its outliers, and says nothing of the flights that did not arrive. The containing
ellipse takes centre and shape from the multivariate t-distribution of ν = 1 (Cauchy) that fits the end
points best, by the fixed point of its likelihood equations (d = 2, n points x, metric V)

    w = (ν + d)/(ν + (x − μ)ᵀ V⁻¹ (x − μ)),   μ = Σ w x / Σ w,   V = Σ w (x − μ)(x − μ)ᵀ / Σ w,     (1)

which fewer than a third of the points cannot carry away, and which turns and stretches with them. It is
scaled to hold ⌈0.95 n⌉ of all n flights; those that did not arrive lie outside.

The plane is that of misses: across (to the right) and along the nominal track, m, by distance and
bearing from the target over the sphere of the planet's equatorial radius. Against the geodesic on the
WGS84 ellipsoid such a distance is 0 to 0.34 % long, by place and direction, where latitudes are
geocentric, as in the spherical equations of motion: at most 84 m of 25 km. Where they are read as
geodetic it is 0.34 % short to 0.67 % long (tests/simulation/test_ellipses.py).

References
----------
Kent, Tyler (1991), Annals of Statistics 19, 2102–2119 (uniqueness; breakdown). Kent, Tyler, Vardi
(1994), Communications in Statistics 23 (Eq. (1), with the division by Σ w).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ampi.physics.planet import destination
from ampi.simulation.estimates.bootstrap import Estimate, resampled_flights
from ampi.simulation.estimates.proportions import CONFIDENCE

Array = NDArray[np.float64]

ELLIPSE = -2.0 * math.log(1.0 - CONFIDENCE)  # squared Mahalanobis radius: χ² of two numbers
FEWEST = 3  # points of an ellipse
FREEDOM = 1.0  # ν of Eq. (1)
ITERATIONS = 1000
SETTLED = 1e-10  # relative change of V
FLAT = 1e-12  # of the determinant to the squared trace, below which points lie on a line


class Place(NamedTuple):
    """The target and the nominal track over it."""

    longitude: float  # rad
    latitude: float  # rad
    azimuth: float  # rad, of the track
    radius: float  # m, of the sphere


@dataclass(frozen=True)
class Ellipse:
    """In the (across, along) plane, m; `angle` (rad) of the major axis from across towards along."""

    centre: tuple[float, float]
    semi_axes: tuple[float, float]  # major, minor
    angle: float  # −π/2 … π/2
    holds: int  # flights inside, its edge included
    n: int  # flights in all

    @property
    def area(self) -> float:
        """In m²."""
        return math.pi * self.semi_axes[0] * self.semi_axes[1]

    def outline(self, points: int = 181) -> tuple[Array, Array]:
        """Across and along (m) of its edge, a closed line that runs counter-clockwise in the plane."""
        turn = np.linspace(0.0, 2.0 * np.pi, points)
        major, minor = self.semi_axes[0] * np.cos(turn), self.semi_axes[1] * np.sin(turn)
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        return (
            self.centre[0] + cos * major - sin * minor,
            self.centre[1] + sin * major + cos * minor,
        )

    def on_map(self, target: Place, points: int = 181) -> tuple[Array, Array]:
        """Longitude and latitude (rad) of its edge: great circles from the target, as misses are."""
        across, along = self.outline(points)
        azimuth = target.azimuth + np.arctan2(across, along)
        angle = np.hypot(across, along) / target.radius
        return destination(target.longitude, target.latitude, azimuth, angle)


def ellipse_area(along: Array, across: Array) -> float:
    """Area (m²) of the 95 % covariance ellipse of a footprint."""
    if len(along) < FEWEST:
        return float("nan")
    covariance = np.cov(along, across)
    return float(np.pi * ELLIPSE * np.sqrt(max(np.linalg.det(covariance), 0.0)))


def ellipse_area_estimate(along: Array, across: Array, seed: int = 0) -> Estimate:
    """The same with its bootstrap interval; NaN of fewer than three points."""
    if len(along) < FEWEST:
        return Estimate(np.nan, np.nan, np.nan)
    resampled = []
    for flights in resampled_flights(len(along), seed):
        x, y = along[flights], across[flights]
        x, y = x - x.mean(axis=1, keepdims=True), y - y.mean(axis=1, keepdims=True)
        determinant = (x * x).sum(axis=1) * (y * y).sum(axis=1) - (x * y).sum(axis=1) ** 2
        resampled.append(np.sqrt(np.maximum(determinant, 0.0)) / (len(along) - 1))
    areas = np.pi * ELLIPSE * np.concatenate(resampled)
    return Estimate.between(ellipse_area(along, across), areas)


def covariance_ellipse(across: Array, along: Array) -> Ellipse | None:
    """95 % of a bivariate normal with the covariance of the flights that arrived.

    `across`, `along` (n,), m, not finite of a flight that did not arrive. None: fewer than three did, or
    they lie on a line.
    """
    points = _arrived(across, along)
    if len(points) < FEWEST or _is_flat(shape := np.cov(points.T)):
        return None
    return _scaled(points.mean(axis=0), shape, points, ELLIPSE, len(across))


def containing_ellipse(across: Array, along: Array) -> Ellipse | None:
    """Holds ⌈0.95 n⌉ of all n flights, by a robust centre and shape, Eq. (1).

    `across`, `along` (n,), m, not finite of a flight that did not arrive. None: too few arrived for any
    ellipse to hold so many, or they lie on a line.
    """
    points, inside = _arrived(across, along), math.ceil(CONFIDENCE * len(across))
    if len(points) < max(FEWEST, inside) or _is_flat(np.cov(points.T)):
        return None
    centre, shape = robust_shape(points)
    if _is_flat(shape):
        return None
    size = np.partition(_squared(points, centre, shape), inside - 1)[inside - 1]
    return _scaled(centre, shape, points, float(size), len(across))


def robust_shape(points: Array) -> tuple[Array, Array]:
    """Centre (2,) and metric V (2, 2) of points (n, 2), Eq. (1)."""
    centre, shape = np.median(points, axis=0), np.cov(points.T)
    for _ in range(ITERATIONS):
        weight = (FREEDOM + 2.0) / (FREEDOM + _squared(points, centre, shape))
        centre = weight @ points / weight.sum()
        off = points - centre
        before, shape = shape, (weight * off.T) @ off / weight.sum()
        if _is_flat(shape) or np.max(np.abs(shape - before)) <= SETTLED * np.max(np.abs(shape)):
            break
    return centre, shape


def _arrived(across: Array, along: Array) -> Array:
    points = np.stack([across, along], axis=1)
    return points[np.all(np.isfinite(points), axis=1)]


def _is_flat(shape: Array) -> bool:
    return bool(np.linalg.det(shape) <= FLAT * np.trace(shape) ** 2)


def _squared(points: Array, centre: Array, shape: Array) -> Array:
    """Squared Mahalanobis distances (n,) of points (n, 2)."""
    off = points - centre
    return np.einsum("ni,ij,nj->n", off, np.linalg.inv(shape), off)


def _scaled(centre: Array, shape: Array, points: Array, size: float, n: int) -> Ellipse:
    """The ellipse of squared Mahalanobis distance `size`."""
    variances, directions = np.linalg.eigh(shape)
    minor, major = np.sqrt(size * variances)
    angle = np.arctan2(directions[1, 1], directions[0, 1])
    return Ellipse(
        centre=(float(centre[0]), float(centre[1])),
        semi_axes=(float(major), float(minor)),
        angle=float((angle + 0.5 * np.pi) % np.pi - 0.5 * np.pi),  # an axis has no sense
        holds=int(np.count_nonzero(_squared(points, centre, shape) <= size)),
        n=n,
    )
