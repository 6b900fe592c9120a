"""Gaussian copula: uniform numbers that are correlated as if they were normal (Nelsen 2006, 2.3.6).

With z = Φ⁻¹(u) and the Cholesky factor L of the correlation matrix, u' = Φ(L z). Each u' is uniform, so
every number keeps its own distribution; between normal ones the correlation is that of the matrix.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from ampi.simulation.distributions import LEAST

Array = NDArray[np.float64]

SMALLEST_EIGENVALUE = 1e-10  # of a correlation matrix that counts as positive definite


@dataclass(frozen=True, eq=False)
class Copula:
    """Names that are correlated, and the lower Cholesky factor of their correlation matrix."""

    names: tuple[str, ...]
    factor: Array

    @classmethod
    def of(cls, names: tuple[str, ...], pairs: Mapping[frozenset[str], float]) -> Copula:
        """From the correlations of pairs; the others are uncorrelated.

        Raises
        ------
        ValueError
            If the matrix is not positive definite.
        """
        matrix = np.array(
            [[1.0 if a == b else pairs.get(frozenset((a, b)), 0.0) for b in names] for a in names]
        ).reshape(len(names), len(names))
        least = float(np.linalg.eigvalsh(matrix).min(initial=1.0))
        if least < SMALLEST_EIGENVALUE:
            raise ValueError(
                f"correlation: expected a positive definite matrix of {', '.join(names)}, got one "
                f"whose least eigenvalue is {least:.3g}"
            )
        factor = np.linalg.cholesky(matrix)
        factor.setflags(write=False)
        return cls(names, factor)

    def correlate(self, uniforms: Mapping[str, Array]) -> dict[str, Array]:
        """The uniform numbers (n,) by name, those of `names` correlated.

        The sums are written out: a matrix product rounds differently for one flight and for many.
        """
        found, z = dict(uniforms), [ndtri(uniforms[name]) for name in self.names]
        for i, name in enumerate(self.names):
            terms = [float(self.factor[i, j]) * z[j] for j in range(i + 1) if self.factor[i, j]]
            if (
                len(terms) > 1
            ):  # else uncorrelated with those before it: the number stays, to the bit
                total = terms[0]
                for term in terms[1:]:
                    total = total + term
                found[name] = np.clip(ndtr(total), LEAST, 1.0 - LEAST)
        return found
