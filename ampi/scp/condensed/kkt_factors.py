"""Eq. (1) of `newton` for one case: one Cholesky factor is both the solution and the test."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotrs

from ampi.scp.condensed.convexify import STIFF

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class KktFactors:
    """Of Eq. (1) for one case, K the rows of the target and those of the limits that are held.

    With some of the rows' stiffness, S = H + Kᵀ s K = L Lᵀ and B = I − s/2w, Eq. (1) is

        (K S⁻¹ Kᵀ B + 1/2w) λ = e − K S⁻¹ (g + Kᵀ s e),   z = −S⁻¹ (g + Kᵀ s e + Kᵀ B λ),

    and one Cholesky factor is both the solution and the test.
    """

    cholesky: Array  # L
    rows: Array  # K, (r, n_z)
    stiff: Array  # s, (r,)
    left: Array  # B, (r,)
    spread: Array  # S⁻¹ Kᵀ, (n_z, r)
    schur: Array  # of λ, (r, r)

    @classmethod
    def of(
        cls, hessian: Array, rows: Array, compliance: Array, stiffness: float = STIFF
    ) -> KktFactors | None:
        """None unless H is positive definite under the rows; `compliance` is 1/2w, (r,).

        `stiffness` is at most that of a row, over the norm of H: where rows almost depend on each other
        little of it is left, and one that is too small shows as an H that is not positive definite.
        """
        norms = np.einsum("ij,ij->i", rows, rows)
        with np.errstate(all="ignore"):
            stiff = np.minimum(stiffness * float(np.linalg.norm(hessian)) / norms, 1.0 / compliance)
            cholesky, info = dpotrf(hessian + (rows.T * stiff) @ rows, lower=1)
        if info != 0:
            return None
        spread, left = dpotrs(cholesky, rows.T, lower=1)[0], 1.0 - stiff * compliance
        schur = (rows @ spread) * left + np.diag(compliance)
        return cls(cholesky, rows, stiff, left, spread, schur)

    def solution(self, gradient: Array, error: Array) -> tuple[Array, Array]:
        """z and λ; not a number where the rows depend on each other."""
        right = gradient + (self.stiff * error) @ self.rows
        half = dpotrs(self.cholesky, right, lower=1)[0]
        try:
            multipliers = np.linalg.solve(self.schur, error - self.rows @ half)
        except np.linalg.LinAlgError:
            return np.full_like(gradient, np.nan), np.full_like(error, np.nan)
        return -half - self.spread @ (self.left * multipliers), multipliers
