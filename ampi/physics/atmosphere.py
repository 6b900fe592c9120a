"""Atmospheres as smooth functions of geometric altitude.

The layers of the US Standard Atmosphere 1976 meet with kinks, and a kink inside a segment costs a
pseudospectral method its spectral convergence. `StandardAtmosphere1976` is therefore one Chebyshev
polynomial of ln ρ (and one of T), fitted by least squares to the tabulated atmosphere:

    ln ρ(h) = Σ_k c_k T_k(ξ) = E(η) + ξ O(η),   ξ = 2 h / h_max − 1,   η = T_2(ξ) = 2 ξ² − 1.     (1)

E and O are evaluated by Horner's rule: additions and multiplications only, so the same source runs on
floats, arrays, complex numbers and symbols, and has derivatives of every order. In powers of η half the
degree is left, and with it all digits; powers of ξ would lose five. Outside the table ln ρ goes on
linearly, with the slope of the edge. A cubic spline was rejected: its third derivative
jumps at every knot, and its evaluation needs an index, which a symbolic tracer cannot follow.

`TableAtmosphere` is the same of any table, of ln ρ and of ln c. A polynomial of degree 24 through few
points is free between them: the points are joined by a natural cubic spline first, and it is that which
is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from importlib import resources
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.polynomial import chebyshev, polynomial
from numpy.typing import NDArray

SPECIFIC_HEAT_RATIO = 1.4  # of air
AIR_GAS_CONSTANT = 287.053  # J/(kg K)
CHEBYSHEV_DEGREE = 24  # 0.3 % rms of density, 1.4 % at the tropopause; see tests/physics
LEAST_POINTS = 8  # of a table: fewer say nothing of the shape between them
FITTED_POINTS = 521  # of the spline, evenly spaced: twenty times the degree
WORST_FIT = 0.05  # of a table's number; NRLMSIS of any season is met within 0.03


Numbers = tuple[float, ...]


class Atmosphere(Protocol):
    """Density and speed of sound over altitude, as plain ufunc expressions."""

    def density(self, altitude: Any) -> Any:
        """Density (kg/m³) at geometric `altitude` (m)."""
        ...

    def speed_of_sound(self, altitude: Any) -> Any:
        """Speed of sound (m/s) at geometric `altitude` (m)."""
        ...


@dataclass(frozen=True, kw_only=True)
class ExponentialAtmosphere:
    """ρ = ρ₀ exp(−h/H), isothermal: c² = κ R T with R T = g H of the planet's gravity g."""

    surface_density: float  # kg/m³
    scale_height: float  # m
    surface_gravity: float  # m/s²
    specific_heat_ratio: float = SPECIFIC_HEAT_RATIO  # κ
    density_factor: float = 1.0

    def density(self, altitude: Any) -> Any:
        """Density (kg/m³) at `altitude` (m)."""
        density = self.surface_density * np.exp(-altitude / self.scale_height)
        return self.density_factor * density

    def speed_of_sound(self, altitude: Any) -> Any:
        """Speed of sound (m/s): the same at every altitude."""
        speed = np.sqrt(self.specific_heat_ratio * self.surface_gravity * self.scale_height)
        return speed + 0.0 * altitude


@dataclass(frozen=True)
class SmoothTable:
    """Least-squares Chebyshev polynomial over [0, top], linear outside, Eq. (1)."""

    top: float
    even: tuple[float, ...]  # E, by powers of η
    odd: tuple[float, ...]  # O
    edge_slopes: tuple[float, float]

    @classmethod
    def fit(cls, altitude: NDArray[np.float64], value: NDArray[np.float64]) -> SmoothTable:
        """Fit the table `value` over `altitude` (m), which starts at zero."""
        top = float(altitude[-1])
        series = chebyshev.Chebyshev.fit(altitude, value, CHEBYSHEV_DEGREE, domain=[0.0, top])
        slopes = series.deriv()(np.array([0.0, top]))
        even = chebyshev.cheb2poly(series.coef[::2])  # T_2k(ξ) = T_k(η)
        odd = _halved(series.coef[1::2])
        return cls(
            top, tuple(even.tolist()), tuple(odd.tolist()), (float(slopes[0]), float(slopes[1]))
        )

    def __call__(self, altitude: Any) -> Any:
        """Value at `altitude` (m)."""
        inside = np.minimum(np.maximum(altitude, 0.0), self.top)
        xi = inside * (2.0 / self.top) - 1.0
        eta = 2.0 * xi * xi - 1.0
        value = _horner(self.even, eta) + xi * _horner(self.odd, eta)
        below = self.edge_slopes[0] * np.minimum(altitude, 0.0)
        return value + below + self.edge_slopes[1] * np.maximum(altitude - self.top, 0.0)


def _halved(coefficients: NDArray[Any]) -> NDArray[np.float64]:
    """Σ c_k T_{2k+1}(ξ)/ξ by powers of η: W_0 = 1, W_1 = 2η − 1, W_{k+1} = 2η W_k − W_{k−1}."""
    before, basis = np.array([1.0]), np.array([-1.0, 2.0])
    total = coefficients[:1]
    for coefficient in coefficients[1:]:
        total = polynomial.polyadd(total, coefficient * basis)
        before, basis = basis, polynomial.polysub(polynomial.polymul([0.0, 2.0], basis), before)
    return np.asarray(total)


def _horner(coefficients: tuple[float, ...], x: Any) -> Any:
    total = coefficients[-1] * x + coefficients[-2]
    for coefficient in reversed(coefficients[:-2]):
        total *= x  # the array is ours
        total += coefficient
    return total


@lru_cache(maxsize=1)
def _us76() -> tuple[SmoothTable, SmoothTable]:
    text = resources.files("ampi.physics").joinpath("us76.csv").read_text(encoding="utf-8")
    table = np.loadtxt(text.splitlines(), delimiter=",", skiprows=2)
    altitude, density, temperature = table.T
    return SmoothTable.fit(altitude, np.log(density)), SmoothTable.fit(altitude, temperature)


@dataclass(frozen=True)
class StandardAtmosphere1976:
    """US Standard Atmosphere 1976 from 0 to 120 km, made smooth."""

    log_density: SmoothTable = field(default_factory=lambda: _us76()[0], repr=False)
    temperature: SmoothTable = field(default_factory=lambda: _us76()[1], repr=False)
    density_factor: float = 1.0

    def density(self, altitude: Any) -> Any:
        """Density (kg/m³) at geometric `altitude` (m)."""
        return self.density_factor * np.exp(self.log_density(altitude))

    def speed_of_sound(self, altitude: Any) -> Any:
        """Speed of sound (m/s), √(κ R T), at geometric `altitude` (m)."""
        return np.sqrt(SPECIFIC_HEAT_RATIO * AIR_GAS_CONSTANT * self.temperature(altitude))


@dataclass(frozen=True)
class TableAtmosphere:
    """Density and speed of sound of a table, made smooth."""

    log_density: SmoothTable = field(repr=False)
    log_speed_of_sound: SmoothTable = field(repr=False)
    density_factor: float = 1.0

    @classmethod
    @lru_cache(maxsize=32)
    def of(cls, altitude: Numbers, density: Numbers, speed_of_sound: Numbers) -> TableAtmosphere:
        """Through `density` (kg/m³) and `speed_of_sound` (m/s) over geometric `altitude` (m).

        Raises
        ------
        ValueError
            If the altitudes are few, do not increase or start above the ground, if a number is missing
            or not positive, or if no smooth curve follows the table.
        """
        _check_altitudes(altitude)
        for name, column in (("density", density), ("speed_of_sound", speed_of_sound)):
            _check_column(name, column, altitude)
        return cls(
            _smooth("density", altitude, density),
            _smooth("speed_of_sound", altitude, speed_of_sound),
        )

    def density(self, altitude: Any) -> Any:
        """Density (kg/m³) at geometric `altitude` (m)."""
        return self.density_factor * np.exp(self.log_density(altitude))

    def speed_of_sound(self, altitude: Any) -> Any:
        """Speed of sound (m/s) at geometric `altitude` (m)."""
        return np.exp(self.log_speed_of_sound(altitude))


def _check_altitudes(altitude: Numbers) -> None:
    if len(altitude) < LEAST_POINTS:
        raise ValueError(
            f"atmosphere.altitude: expected at least {LEAST_POINTS} altitudes, got {len(altitude)}"
        )
    for below, above in pairwise(altitude):
        if not above > below:
            raise ValueError(
                f"atmosphere.altitude: expected altitudes that increase strictly, got {above:g} m after "
                f"{below:g} m"
            )
    if altitude[0] > 0.0:
        raise ValueError(
            "atmosphere.altitude: expected a table that starts at 0 m or below, got one that starts at "
            f"{altitude[0]:g} m"
        )


def _check_column(name: str, column: Numbers, altitude: Numbers) -> None:
    if len(column) != len(altitude):
        raise ValueError(
            f"atmosphere.{name}: expected {len(altitude)} numbers, one for each altitude, got "
            f"{len(column)}"
        )
    for h, value in zip(altitude, column, strict=True):
        if not 0.0 < value < np.inf:
            raise ValueError(
                f"atmosphere.{name}: expected positive numbers, got {value:g} at {h:g} m"
            )


def _smooth(name: str, altitude: Numbers, column: Numbers) -> SmoothTable:
    """Of the logarithm."""
    from scipy.interpolate import CubicSpline  # what flies in other air does without scipy

    h, logarithm = np.array(altitude), np.log(column)
    even = np.linspace(0.0, h[-1], FITTED_POINTS)
    found = SmoothTable.fit(even, CubicSpline(h, logarithm, bc_type="natural")(even))
    above_ground = h >= 0.0
    off = np.abs(np.expm1(found(h) - logarithm)) * above_ground
    worst = int(np.argmax(off))
    if off[worst] > WORST_FIT:
        raise ValueError(
            f"atmosphere.{name}: expected a table that a smooth curve follows within "
            f"{100.0 * WORST_FIT:g} %, got one that it leaves by {100.0 * off[worst]:.3g} % at "
            f"{h[worst]:g} m; smooth it there, or leave out what lies far above the entry"
        )
    return found
