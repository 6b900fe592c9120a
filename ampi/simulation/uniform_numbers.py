"""The uniform numbers that flights are made from: a stream per flight, a place in it per input.

Flight i of a pool reads the stream of SeedSequence(seed, spawn_key=(pool, i)): it does not depend on the
number of flights, on workers, or on the order of execution. An input keeps its place in the stream
whatever else a world draws, so two worlds are compared on the same draws of what they share. The pools
are disjoint streams: what a design was tuned on is not what it is reported on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

POOLS = ("reported", "tuning")
CELLS = 2.0**52  # of [0, 1]; a uniform number is the middle of one


def require_count(n: int) -> None:
    """Raise ValueError if this is no number of flights."""
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or n < 1:
        raise ValueError(f"n: expected at least one flight, a whole number; got {n!r}")


def require_whole(name: str, value: int) -> None:
    """Raise ValueError if `value` is no seed or number of a flight."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 0:
        raise ValueError(f"{name}: expected a whole number, 0 or greater, got {value!r}")


def uniform_numbers(
    places: Sequence[int], n: int, *, seed: int, pool: str = "reported", first: int = 0
) -> Array:
    """Uniform numbers (n, places) of flights first … first + n − 1, each inside (0, 1).

    Raises
    ------
    ValueError
        If the number of flights, the seed, the pool or the first flight is none.
    """
    require_count(n)
    require_whole("seed", seed)
    require_whole("first", first)
    if pool not in POOLS:
        raise ValueError(f"pool: expected one of {', '.join(POOLS)}, got {pool!r}")
    uniforms, wanted = np.empty((n, len(places))), np.array(places, dtype=np.int64)
    length = int(wanted.max(initial=-1)) + 1
    for i in range(n):
        key = (POOLS.index(pool), int(first) + i)
        stream = np.random.PCG64(np.random.SeedSequence(int(seed), spawn_key=key))
        uniforms[i] = stream.random_raw(length)[wanted] >> np.uint64(12)
    return np.asarray((uniforms + 0.5) / CELLS)


def seeds_of(uniforms: Array) -> NDArray[np.uint64]:
    """The number of the cell that each uniform number lies in: a seed of its own."""
    return np.asarray(uniforms * CELLS).astype(np.uint64)
