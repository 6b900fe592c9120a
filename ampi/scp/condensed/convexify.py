"""Making the reduced Hessian convex without spoiling Newton's method.

Near a solution the target is met (no elastic component), and what must be positive definite is the
Hessian on the tangent space C z = 0 of the target. There `convexify_on_tangent` clips eigenvalues on
that space only, and adds the least that makes the whole convex on its complement, where the target
itself decides the step. A multiple of the identity there was tried: it damps all directions like the
worst one, and where many kinks are held the iteration stops short of an optimum. The full-space Hessian
of a nonlinear target is often indefinite even at a strict minimum; clipping it there was tried, and
turns quadratic into linear convergence.

With A = [Y N] orthogonal, N spanning the tangent space, and H̃ = AᵀHA:

    H̃_NN ← eigenvalues |·| clipped at δ,                                       (1)
    H̃_YY ← H̃_YY + T,  S + T with eigenvalues clipped at δ,  S = H̃_YY − H̃_YN H̃_NN⁻¹ H̃_NY. (2)

Near a solution Eq. (1) has nothing to do. Then nothing need be rotated either: with any ρ that makes
H + ρ Y Yᵀ positive definite,

    S = (Yᵀ (H + ρ Y Yᵀ)⁻¹ Y)⁻¹ − ρ I.                                         (3)

Where the objective has no effort, true curvatures lie far below any δ that is safe far from a solution,
and the iteration becomes a gradient descent. That shows in the reduction: along a direction without
curvature it is twice what a model with δ predicts. There `CurvatureFloor` lowers δ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.linalg.lapack import dpotrf, dtrtrs

Array = NDArray[np.float64]

STIFF = 10.0  # ρ of Eq. (3) over the norm of H: enough for most, and S keeps 14 digits


@dataclass
class CurvatureFloor:
    """δ over one run, relative: lowered when it hides the true curvature, raised when steps fail."""

    greatest: float
    value: float
    least: float = 1e-7
    factor: float = 4.0
    lower_above: float = 1.5  # of actual over predicted reduction
    raise_below: float = 0.25

    def update(self, ratio: float, *, accepted: bool) -> None:
        """After a step that achieved `ratio`."""
        if accepted and ratio > self.lower_above:
            self.value = max(self.value / self.factor, self.least)
        elif ratio < self.raise_below:
            self.value = min(self.value * self.factor, self.greatest)


def convexify_on_tangent(hessian: Array, target_map: Array, floor: float) -> Array:
    """Positive definite matrix equal to `hessian` wherever that is convex on C z = 0.

    Parameters
    ----------
    hessian
        Reduced Hessian (n, n), symmetric.
    target_map
        C (m, n), full row rank; m = 0 clips on the whole space.
    floor
        δ > 0, least eigenvalue.
    """
    m = min(len(target_map), len(hessian))
    if m:
        normal = np.linalg.qr(target_map.T)[0][:, :m]
        convex = _with_convex_complement(hessian, normal, floor)
        if convex is not None:
            return convex
    basis = np.linalg.qr(target_map.T, mode="complete")[0] if m else np.eye(len(hessian))
    rotated = basis.T @ hessian @ basis
    tangent = 0.5 * (rotated[m:, m:] + rotated[m:, m:].T)
    if dpotrf(tangent - floor * np.eye(len(tangent)), lower=1)[1] != 0:
        values, vectors = eigh(tangent, driver="evd")
        tangent = (vectors * np.maximum(np.abs(values), floor)) @ vectors.T
        rotated[m:, m:] = tangent
    if m:
        cross = rotated[:m, m:]
        schur = rotated[:m, :m] - cross @ np.linalg.solve(tangent, cross.T)
        rotated[:m, :m] += _missing(schur, floor)
    convex = basis @ rotated @ basis.T
    return np.asarray(0.5 * (convex + convex.T))


def _with_convex_complement(hessian: Array, normal: Array, floor: float) -> Array | None:
    """Eqs. (2) and (3), where the tangent space of `normal` Y (n, m) needs nothing; else None."""
    stiffness = STIFF * float(np.linalg.norm(hessian))
    stiff = 0.5 * (hessian + hessian.T) + stiffness * (normal @ normal.T)
    if dpotrf(stiff - floor * np.eye(len(stiff)), lower=1)[1] != 0:
        return None
    half = dtrtrs(dpotrf(stiff, lower=1)[0], normal, lower=1)[0]
    schur = np.linalg.inv(half.T @ half) - stiffness * np.eye(normal.shape[1])
    convex = hessian + normal @ _missing(schur, floor) @ normal.T
    return np.asarray(0.5 * (convex + convex.T))


def _missing(schur: Array, floor: float) -> Array:
    """T of Eq. (2)."""
    values, vectors = np.linalg.eigh(0.5 * (schur + schur.T))
    return np.asarray((vectors * np.maximum(floor - values, 0.0)) @ vectors.T)
