"""Eq. (1) of `family` for every case: its matrices, factored, and its solutions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotrs

from ampi.scp.condensed.convexify import STIFF
from ampi.scp.condensed.family_condensing import CondensedFamily, FamilyCurvature

Array = NDArray[np.float64]
Cases = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class NewtonSystem:
    """Eq. (1) with its matrices factored."""

    linear: CondensedFamily
    curvature: FamilyCurvature
    give: Array  # 1/2w, (m,)
    factors: list[Factors | None]  # None where H is not positive definite under the target

    @classmethod
    def factored(
        cls, linear: CondensedFamily, curvature: FamilyCurvature, hessian: Array
    ) -> NewtonSystem:
        """With H (c, n_z, n_z)."""
        target = linear.problem.target
        give = np.zeros(len(target))
        np.divide(0.5, target.weight, out=give, where=target.weight > 0.0)
        pairs = zip(hessian, linear.final_map[:, target.state], strict=True)
        return cls(linear, curvature, give, [Factors.of(*pair, give) for pair in pairs])

    def solution(self, gradient: Array, error: Array, cases: Cases) -> tuple[Array, Array]:
        """z (k, n_z) and λ (k, m) of `cases` for these right sides; not a number without factors."""
        z, multipliers = np.full_like(gradient, np.nan), np.full_like(error, np.nan)
        for k, case in enumerate(cases):
            factors = self.factors[case]
            if factors is not None:
                z[k], multipliers[k] = factors.solution(gradient[k], error[k])
        return z, multipliers


@dataclass(frozen=True, eq=False)
class Factors:
    """Of Eq. (1) for one case.

    With some of the target's stiffness, S = H + Cᵀ s C = L Lᵀ and B = I − s/2w, Eq. (1) is

        (C S⁻¹ Cᵀ B + 1/2w) λ = e − C S⁻¹ (g + Cᵀ s e),   z = −S⁻¹ (g + Cᵀ s e + Cᵀ B λ),

    and one Cholesky factor is both the solution and the test.
    """

    cholesky: Array  # L
    rows: Array  # C, (m, n_z)
    stiff: Array  # s, (m,)
    left: Array  # B, (m,)
    spread: Array  # S⁻¹ Cᵀ, (n_z, m)
    schur: Array  # of λ, (m, m)

    @classmethod
    def of(cls, hessian: Array, rows: Array, give: Array) -> Factors | None:
        """None unless H is positive definite under the target."""
        norms = np.einsum("ij,ij->i", rows, rows)
        with np.errstate(divide="ignore"):
            stiff = np.minimum(STIFF * float(np.linalg.norm(hessian)) / norms, 1.0 / give)
        cholesky, info = dpotrf(hessian + (rows.T * stiff) @ rows, lower=1)
        if info != 0:
            return None
        spread, left = dpotrs(cholesky, rows.T, lower=1)[0], 1.0 - stiff * give
        schur = (rows @ spread) * left + np.diag(give)
        return cls(cholesky, rows, stiff, left, spread, schur)

    def solution(self, gradient: Array, error: Array) -> tuple[Array, Array]:
        """z and λ; not a number where the targets' rows depend on each other."""
        right = gradient + (self.stiff * error) @ self.rows
        half = dpotrs(self.cholesky, right, lower=1)[0]
        try:
            multipliers = np.linalg.solve(self.schur, error - self.rows @ half)
        except np.linalg.LinAlgError:
            return np.full_like(gradient, np.nan), np.full_like(error, np.nan)
        return -half - self.spread @ (self.left * multipliers), multipliers
