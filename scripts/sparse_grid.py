"""Interpolation over a sparse grid: the combination technique of Griebel, Schneider and Zenger (1992).

An axis of level l has 1, 3, 5, 9, … points, each level those of the last and the middles between them.
A grid of levels l_1 … l_d is a small full one; over all whose levels sum to L − q

    u_L = Σ_{q=0}^{d−1} (−1)^q C(d − 1, q) Σ_{|l| = L−q} u_l

interpolates with the points of their union: 13 in six dimensions where L = 1, 85 where L = 2 and 389
where L = 3; a full grid of three points an axis has 729.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import comb

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def axis_of_level(level: int) -> Array:
    """Points in [−1, 1]; level 0 has the middle alone."""
    return np.zeros(1) if level == 0 else np.linspace(-1.0, 1.0, 2**level + 1)


def combination(dimensions: int, level: int) -> list[tuple[int, tuple[int, ...]]]:
    """Coefficient and levels of every full grid of u_L."""
    return [
        ((-1) ** q * comb(dimensions - 1, q), levels)
        for q in range(min(dimensions, level + 1))
        for levels in _summing_to(level - q, dimensions)
    ]


def _summing_to(total: int, parts: int) -> Iterator[tuple[int, ...]]:
    if parts == 1:
        yield (total,)
        return
    for first in range(total + 1):
        for rest in _summing_to(total - first, parts - 1):
            yield (first, *rest)
