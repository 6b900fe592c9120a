"""What a miss comes from: rank correlations and Sobol indices over all that is dispersed.

Rank correlations see what is monotonic, and a miss that grows with an error of either sign is not:
correlate the signed miss along and across too, or the size of the input, |u − ½|. Sobol indices see
everything, at the price of n (m + 2) flights for m inputs: two matrices A and B of n rows in the unit
cube, and the m matrices A_B⁽ⁱ⁾, A with column i from B. With the outputs f, less their mean over A, B,

    first order   S_i = 1/n Σ f(B) (f(A_B⁽ⁱ⁾) − f(A)) / Var f     (share of the variance by i alone)
    total         T_i = 1/2n Σ (f(A) − f(A_B⁽ⁱ⁾))² / Var f        (i with all its interactions)     (1)

(Saltelli et al. 2010, Table 2, b and f). Their intervals resample the rows; rows of a Sobol sequence are
more even than random ones, so the intervals are rather too wide.

References
----------
Saltelli et al. (2010), Computer Physics Communications 181, 259–270.
Bonett, Wright (2000), Psychometrika 65, 23–28.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ampi.simulation.estimates.bootstrap import RESAMPLES, Estimate
from ampi.simulation.estimates.proportions import CONFIDENCE

Array = NDArray[np.float64]
Scale = Literal["logarithm", "rank", "plain"]

FEWEST = 4  # flights of a rank correlation: Fisher's z divides by n − 3
NEAR = 1.0  # m: closer misses are alike on the logarithmic scale


def rank_correlations(inputs: Array, output: Array, names: Sequence[str]) -> dict[str, Estimate]:
    """Spearman's ρ of an output (n,) with every input, (n, m), and its interval by Fisher's z.

    The error of z is that of Bonett and Wright, √((1 + ρ²/2)/(n − 3)). An output that is infinite or NaN
    ranks as the farthest; an input that does not vary has none (NaN).
    """
    from scipy.special import ndtri
    from scipy.stats import rankdata

    n, m = inputs.shape
    if output.shape != (n,) or len(names) != m or n < FEWEST:
        raise ValueError(
            f"rank_correlations: expected inputs (n, m), outputs (n,) and m names of at least {FEWEST} "
            f"flights, got {inputs.shape}, {output.shape} and {len(names)}"
        )
    ranks = rankdata(np.where(np.isnan(output), np.inf, output))
    reach = ndtri(0.5 + 0.5 * CONFIDENCE)
    found = {}
    for name, values in zip(names, inputs.T, strict=True):
        rho = _correlation(rankdata(values), ranks)
        error = reach * math.sqrt((1.0 + 0.5 * rho**2) / (n - 3))
        z = math.atanh(rho) if abs(rho) < 1.0 else math.copysign(math.inf, rho)
        found[name] = Estimate(rho, math.tanh(z - error), math.tanh(z + error))
    return found


def _correlation(one: Array, other: Array) -> float:
    off, away = one - one.mean(), other - other.mean()
    size = math.sqrt(float(off @ off) * float(away @ away))
    return float(np.clip(off @ away / size, -1.0, 1.0)) if size > 0.0 else math.nan


@dataclass(frozen=True, eq=False)
class SobolDesign:
    """The flights that Sobol indices of m inputs are read from."""

    names: tuple[str, ...]  # (m,)
    uniforms: Array  # (n (m + 2), m), in the open unit cube: A, B, A_B⁽¹⁾ … A_B⁽ᵐ⁾

    @property
    def rows(self) -> int:
        """n, of each matrix."""
        return len(self.uniforms) // (len(self.names) + 2)


@dataclass(frozen=True)
class SobolIndices:
    """Shares of the output's variance; estimates may lie a little outside 0 … 1."""

    first: dict[str, Estimate]  # of the input alone
    total: dict[str, Estimate]  # with its interactions
    lost: int  # flights that did not arrive and count as the farthest that did


def sobol_design(n: int, names: Sequence[str], seed: int) -> SobolDesign:
    """Uniform numbers for n (m + 2) flights by a scrambled Sobol sequence; n a power of 2."""
    from scipy.stats.qmc import Sobol

    if n < 2 or n & (n - 1):
        raise ValueError(f"n: expected a power of 2, got {n!r}")
    m = len(names)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2,)))
    both = Sobol(2 * m, bits=52, seed=rng).random(n) + 2.0**-53  # middles of cells: neither 0 nor 1
    first, second = both[:, :m], both[:, m:]
    mixed = np.tile(first, (m, 1, 1))
    mixed[np.arange(m), :, np.arange(m)] = second.T
    uniforms = np.concatenate([first, second, *mixed])
    return SobolDesign(tuple(names), uniforms)


def sobol_from(
    design: SobolDesign, output: Array, scale: Scale = "logarithm", *, seed: int = 0
) -> SobolIndices:
    """Indices from the outputs (n (m + 2),) of the design's flights, in their order.

    `scale`: "logarithm" of a miss, in which a few far flights do not decide everything; "rank"; "plain".
    A flight that did not arrive, infinite or NaN, counts as the farthest that did.
    """
    n, m = design.rows, len(design.names)
    if output.shape != (n * (m + 2),):
        raise ValueError(
            f"output: expected {n * (m + 2)} numbers of this design, got {output.shape}"
        )
    finite = np.isfinite(output)
    if not np.any(finite) or np.ptp(output[finite]) == 0.0:
        raise ValueError("output: expected flights that arrived and differ, got none")
    values = np.where(finite, output, np.max(output[finite]))
    f = _on_scale(values, scale).reshape(m + 2, n)
    f = f - f[:2].mean()
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(3,)))
    times = rng.multinomial(n, np.full(n, 1.0 / n), RESAMPLES).astype(np.float64)
    value = _indices(f, np.ones((1, n)))[:, 0]
    resampled = _indices(f, times)
    first, total = (
        {name: Estimate.between(v, r) for name, v, r in zip(design.names, vs, rs.T, strict=True)}
        for vs, rs in zip(value, resampled, strict=True)
    )
    return SobolIndices(first, total, int(np.count_nonzero(~finite)))


def _on_scale(output: Array, scale: Scale) -> Array:
    from scipy.stats import rankdata

    if scale == "logarithm":
        return np.log(np.maximum(output, NEAR))
    if scale == "rank":
        return rankdata(output)
    if scale == "plain":
        return output
    raise ValueError(f"scale: expected logarithm, rank or plain, got {scale!r}")


def _indices(f: Array, times: Array) -> Array:
    """S and T, (2, b, m), Eq. (1), from f (m + 2, n): row j of the design counts `times` (b, n)."""
    n = f.shape[1]
    a, b, mixed = f[0], f[1], f[2:]
    mean = times @ (a + b) / (2 * n)
    variance = (times @ (a**2 + b**2) / (2 * n) - mean**2)[:, None]
    first, total = times @ (b * (mixed - a)).T / n, times @ ((a - mixed) ** 2).T / (2 * n)
    return np.stack([first, total]) / variance
