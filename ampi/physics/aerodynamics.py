"""Lift and drag coefficients over angle of attack α (rad) and Mach number: formulas and tables.

A table becomes a tensor product of cubic splines with zero slope at their ends, in truncated powers,

    s(x) = a₀ + a₂ t² + a₃ t³ + Σ_k c_k (x − x_k)₊³,                           (1)

which needs no index, so it can be traced symbolically. Outside the table its edge value is held ("no
data outside"): the value is repeated at two more knots beyond the edge, the spline levels off between
them, and the coordinate is clamped at the outer one. The result has two continuous derivatives
everywhere but at the clamp, where it has one.

References
----------
Phillips (2003), "A Common Aero Vehicle (CAV) Model, Description, and Employment Guide".
Lu (1997), J. Guidance 20(1), for the polynomial model.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Aerodynamics(Protocol):
    """Lift and drag coefficients as plain ufunc expressions."""

    @property
    def needs_mach(self) -> bool:
        """Whether the coefficients depend on Mach number; if not, `mach` may be None."""
        ...

    def coefficients(self, angle_of_attack: Any, mach: Any) -> tuple[Any, Any]:
        """(C_L, C_D) at `angle_of_attack` (rad) and `mach` (–)."""
        ...


@dataclass(frozen=True, kw_only=True)
class ModifiedNewtonian:
    """C_N = a sin²α + b sin α, C_A constant; C_L and C_D by rotation. The SHEFEX-3 surrogate."""

    normal_quadratic: float
    normal_linear: float
    axial: float
    needs_mach: ClassVar[bool] = False

    def coefficients(self, angle_of_attack: Any, mach: Any) -> tuple[Any, Any]:
        """(C_L, C_D); independent of Mach number (hypersonic limit)."""
        sin_a, cos_a = np.sin(angle_of_attack), np.cos(angle_of_attack)
        normal = self.normal_quadratic * sin_a * sin_a + self.normal_linear * sin_a
        return normal * cos_a - self.axial * sin_a, normal * sin_a + self.axial * cos_a


@dataclass(frozen=True, kw_only=True)
class PolynomialDragPolar:
    """C_L = Σ l_k α^k (α in degrees), C_D = Σ d_k C_L^k (Lu 1997)."""

    lift: tuple[float, ...]
    drag: tuple[float, ...]
    needs_mach: ClassVar[bool] = False

    def coefficients(self, angle_of_attack: Any, mach: Any) -> tuple[Any, Any]:
        """(C_L, C_D); independent of Mach number."""
        degrees = angle_of_attack * (180.0 / np.pi)
        lift = sum(c * degrees**k for k, c in enumerate(self.lift))
        return lift, sum(c * lift**k for k, c in enumerate(self.drag))


def _clamped_basis(knots: Any, x: Any) -> list[Any]:
    """The n truncated-power functions that span the cubic splines with zero slope at both ends."""
    length = knots[-1] - knots[0]
    last = knots[-1] - knots[-2]
    t = (x - knots[0]) / length
    # r has slope 1 at the right end; subtracting f'(end) r from f takes its slope there away
    r = np.maximum(x - knots[-2], 0.0) ** 3 / (3.0 * (last * last))
    basis = [1.0 + 0.0 * x, t**2 - 2.0 / length * r, t**3 - 3.0 / length * r]
    for knot in knots[1:-2]:
        width = knots[-1] - knot
        basis.append((np.maximum(x - knot, 0.0) / width) ** 3 - 3.0 / width * r)
    return basis


def _basis_at_knots(knots: Array) -> Array:
    """(…, n, n): the functions (columns) at the knots (rows), the cases of `knots` (n, …) first."""
    basis = np.stack(_clamped_basis(knots, knots), axis=-1)
    return np.moveaxis(basis, 0, -2)


def _held(axis: tuple[Any, ...]) -> Array:
    """The knots of an axis and two more beyond each end; (n + 4, …) of numbers that are arrays."""
    left, right = axis[1] - axis[0], axis[-1] - axis[-2]
    outside = axis[0] - left, axis[0] - left * 0.5, axis[-1] + right * 0.5, axis[-1] + right
    return np.stack(np.broadcast_arrays(*outside[:2], *axis, *outside[2:]))


def _edges_repeated(table: tuple[tuple[Any, ...], ...]) -> Array:
    """(…, rows + 4, columns + 4) of a table, of numbers or of arrays over cases."""
    cells = np.broadcast_arrays(*(cell for row in table for cell in row))
    values = np.stack(cells, axis=-1).reshape(*cells[0].shape, len(table), len(table[0]))
    return np.pad(values, [(0, 0)] * cells[0].ndim + [(2, 2)] * 2, mode="edge")


def _numbers(values: Array, axes: int) -> Any:
    """Tuples of numbers, or of arrays over cases, by the first `axes`: what can be taken apart."""
    if axes:
        return tuple(_numbers(part, axes - 1) for part in values)
    return values if values.ndim else float(values)


@dataclass(frozen=True, kw_only=True)
class TabulatedAerodynamics:
    """C_L and C_D on a grid: `angle_of_attack` (rad) × `mach`, smooth as Eq. (1)."""

    angle_of_attack: tuple[float, ...]
    mach: tuple[float, ...]
    lift: tuple[tuple[float, ...], ...]
    drag: tuple[tuple[float, ...], ...]
    needs_mach: ClassVar[bool] = True
    # knots of α and of M, weights of C_L and of C_D on the products of their basis functions
    weights: tuple[Any, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("angle_of_attack", "mach"):
            axis = getattr(self, name)
            if len(axis) < 2 or any(np.any(b <= a) for a, b in pairwise(axis)):
                raise ValueError(
                    f"aerodynamics.{name}: expected at least two strictly increasing values, "
                    f"got {list(axis)}"
                )
        shape = (len(self.angle_of_attack), len(self.mach))
        for name in ("lift", "drag"):
            rows = [len(row) for row in getattr(self, name)]
            if rows != [shape[1]] * shape[0]:
                raise ValueError(
                    f"aerodynamics.{name}: expected {shape[0]} rows (angle_of_attack) of "
                    f"{shape[1]} numbers (mach), got rows of {rows}"
                )
        alpha, mach = _held(self.angle_of_attack), _held(self.mach)
        across_alpha, across_mach = _basis_at_knots(alpha), _basis_at_knots(mach)
        weights: list[Any] = [alpha, mach]
        for table in (self.lift, self.drag):
            values = _edges_repeated(table)
            half = np.linalg.solve(across_alpha, values)
            found = np.linalg.solve(across_mach, np.swapaxes(half, -1, -2))
            weights.append(np.moveaxis(found, (-1, -2), (0, 1)))  # cases last, as in a flight model
        nested = (_numbers(w, axes) for w, axes in zip(weights, (1, 1, 2, 2), strict=True))
        object.__setattr__(self, "weights", tuple(nested))

    def coefficients(self, angle_of_attack: Any, mach: Any) -> tuple[Any, Any]:
        """(C_L, C_D), the edge held outside the table."""
        alpha_knots, mach_knots, lift, drag = self.weights
        alpha = np.minimum(np.maximum(angle_of_attack, alpha_knots[0]), alpha_knots[-1])
        mach = np.minimum(np.maximum(mach, mach_knots[0]), mach_knots[-1])
        left, right = _clamped_basis(alpha_knots, alpha), _clamped_basis(mach_knots, mach)

        def evaluate(table: tuple[Any, ...]) -> Any:
            rows = [sum(w * b for w, b in zip(row, right, strict=True)) for row in table]
            return sum(row * b for row, b in zip(rows, left, strict=True))

        return evaluate(lift), evaluate(drag)
