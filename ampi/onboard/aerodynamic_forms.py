"""Lift and drag coefficients over angle of attack and Mach number, as data that flies.

Three forms, each the one of `ampi.physics.aerodynamics` to the last digits, of arrays of numbers:
modified Newtonian, a polynomial polar, and a tensor product of cubic splines in truncated powers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class NewtonianForm:
    """C_N = a sin²α + b sin α, C_A constant; C_L and C_D by rotation."""

    normal_quadratic: float
    normal_linear: float
    axial: float
    needs_mach: ClassVar[bool] = False

    def coefficients(self, angle_of_attack: Any, mach: Any) -> tuple[Any, Any]:
        """(C_L, C_D) at `angle_of_attack` (rad)."""
        sine, cosine = np.sin(angle_of_attack), np.cos(angle_of_attack)
        normal = (self.normal_quadratic * sine + self.normal_linear) * sine
        return normal * cosine - self.axial * sine, normal * sine + self.axial * cosine


@dataclass(frozen=True, kw_only=True, eq=False)
class PolarForm:
    """C_L = Σ l_k α^k (α in degrees), C_D = Σ d_k C_L^k."""

    lift: Array  # (k,), ascending powers
    drag: Array
    needs_mach: ClassVar[bool] = False

    def __post_init__(self) -> None:
        for array in (self.lift, self.drag):
            array.setflags(write=False)

    def coefficients(self, angle_of_attack: Any, mach: Any) -> tuple[Any, Any]:
        """(C_L, C_D) at `angle_of_attack` (rad)."""
        lift = _horner(self.lift, angle_of_attack * (180.0 / np.pi))
        return lift, _horner(self.drag, lift)


@dataclass(frozen=True, kw_only=True, eq=False)
class SplineForm:
    """Σ_ij w_ij b_i(α) b_j(M) of truncated powers on the knots of each axis, clamped at their ends."""

    angle_of_attack: Array  # (a,) knots, rad
    mach: Array  # (m,) knots
    lift: Array  # (a, m) weights
    drag: Array
    needs_mach: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for array in (self.angle_of_attack, self.mach, self.lift, self.drag):
            array.setflags(write=False)

    def coefficients(self, angle_of_attack: Any, mach: Any) -> tuple[Any, Any]:
        """(C_L, C_D) at `angle_of_attack` (rad) and `mach`, the edge held outside the knots."""
        left, right = _basis(self.angle_of_attack, angle_of_attack), _basis(self.mach, mach)
        return _tensor(self.lift, left, right), _tensor(self.drag, left, right)


AerodynamicForm = NewtonianForm | PolarForm | SplineForm


def _horner(coefficients: Array, x: Any) -> Any:
    total = 0.0 * x + coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        total = total * x + coefficient
    return total


def _basis(knots: Array, x: Any) -> Array:
    """(k, …): the k functions that span the cubic splines with zero slope at both ends."""
    x = np.minimum(np.maximum(x, knots[0]), knots[-1])
    length, last = knots[-1] - knots[0], knots[-1] - knots[-2]
    t = (x - knots[0]) / length
    # r has slope 1 at the right end; subtracting f'(end) r from f takes its slope there away
    r = np.maximum(x - knots[-2], 0.0) ** 3 / (3.0 * (last * last))
    inner = knots[1:-2].reshape(-1, *(1,) * np.ndim(x))
    width = knots[-1] - inner
    rest = (np.maximum(x - inner, 0.0) / width) ** 3 - 3.0 / width * r
    first = np.stack([np.ones_like(t), t**2 - 2.0 / length * r, t**3 - 3.0 / length * r])
    return np.concatenate([first, rest])


def _tensor(weights: Array, left: Array, right: Array) -> Array:
    """Σ_ij w_ij left_i right_j of (a, …) and (m, …), one term after the other."""
    axes = max(left.ndim, right.ndim) - 1  # of the points, of which one factor may have fewer
    left, right = _with_axes(left, axes), _with_axes(right, axes)
    rows = np.add.reduce(weights.reshape(*weights.shape, *(1,) * axes) * right, axis=1)
    return np.asarray(np.add.reduce(rows * left, axis=0))


def _with_axes(basis: Array, axes: int) -> Array:
    """(k, …) with so many axes of points, behind those of the functions."""
    return basis.reshape(len(basis), *(1,) * (axes + 1 - basis.ndim), *basis.shape[1:])
