"""Is the family smooth in p? Second differences over the grid, and the cases that stand out of it.

Along a line of the grid, at three neighbouring points a < b < c of an axis, the middle optimum misses
the chord of its neighbours by

    δ = f_b − [(c − b) f_a + (b − a) f_c] / (c − a) = −(b − a)(c − b) f[a, b, c],             (1)

with f[a, b, c] the second divided difference: small where the optima are one smooth function of p, on
any uneven axis. |δ| is taken at every node and its greatest kept, for each state and for the final time.
What counts as small is the family's own roughness: for each row

    s = max over the axes of (median |δ| + 1.4826 MAD |δ|),                                    (2)

which a few bad cases cannot move, and at least `RESOLUTION` of the row's range: below, optima differ by
their convergence. On an uneven axis wide triples miss more than the median one; there

    s of a triple = max(s, (b − a)(c − b) · (median |f| + 1.4826 MAD |f|)),                    (2a)

which on an even axis is s. |δ| / s is the irregularity of a triple. An optimum of another branch
spoils every line through it, a good one beside it only the line they share, so

    roughness of a case = min over the triples that hold it of max over the rows of |δ| / s.   (3)

Every triple above `THRESHOLD` must have somebody to blame: the roughest of its three cases, and of
equally rough ones the farthest from the hypercentre. With a single line (d = 1) all three are equally
rough and the blame is a guess; re-solving the case (database/repair.py) tells. A path limit that acts
in a case and in none beside it is a kink of the family too: the case is named with that limit.

All of this is relative to the family, and what no triple measures is NaN: unknown, not smooth. Whether
neighbours are optima of one branch at all, in degrees and kilometres, database/audit/branches.py says.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.dataset import TrajectoryDataset
from ampi.missions.path_limits import KEPT, PathLimits
from ampi.physics.angles import on_turn_of
from ampi.physics.state import CIRCULAR_STATES, STEERED_STATES
from database.plan.grid import Grid

Array = NDArray[np.float64]

# The 729 optima of SHEFEX-3 reach 5 (their 2187 with density 6), a case of its other branch 16 to 40.
THRESHOLD = 10.0
RESOLUTION = 1e-5


@dataclass(frozen=True)
class Outlier:
    """A case that stands out of its family."""

    case: int
    index: tuple[int, ...]
    parameters: dict[str, float]  # SI, rad
    roughness: float  # Eq. (3)
    limit: str | None  # a path limit that acts there and in no case beside it


@dataclass(frozen=True, eq=False)
class Coherence:
    """Roughness of every case and of every row, and who stands out."""

    triples: int
    rows: tuple[str, ...]  # names of the states and of the final time: r
    scale: Array  # (r,), Eq. (2): SI, rad
    curvature: tuple[
        Array, ...
    ]  # of each axis, (r,): median + 1.4826 MAD of |f[a, b, c]|, Eq. (2a)
    worst: Array  # (r,), greatest |δ| / s of each row
    roughness: Array  # (p…), Eq. (3); NaN where no triple of solved cases holds the case
    outliers: tuple[Outlier, ...]


def family_rows(dataset: TrajectoryDataset) -> Array:
    """States and final time at the nodes, (p…, r, n)."""
    final_time = dataset.final_time[..., None, None]
    n = dataset.states.shape[-1]
    return np.concatenate(
        [dataset.states, np.broadcast_to(final_time, (*dataset.shape, 1, n))], axis=-2
    )


def coherence(dataset: TrajectoryDataset) -> Coherence:
    """Measure a database; failed cases take no part."""
    grid, rows = Grid.from_mission(dataset.mission), family_rows(dataset)
    names = (*STEERED_STATES[: dataset.mission.n_states], "final_time")
    misses = {
        i: chord_misses(axis, np.moveaxis(rows, i, 0))
        for i, axis in enumerate(dataset.axes)
        if len(axis) > 2
    }
    if not misses:
        unknown = np.full(len(names), np.nan)
        curvature = (unknown,) * len(dataset.axes)
        return Coherence(0, names, unknown, curvature, unknown, np.full(dataset.shape, np.nan), ())
    scale = family_scale(list(misses.values()), rows)
    curvatures = {i: _typical(miss / _product(dataset.axes[i], miss)) for i, miss in misses.items()}
    unknown = np.full(len(names), np.nan)
    curvature = tuple(curvatures.get(i, unknown) for i in range(len(dataset.axes)))
    ratios = {
        i: miss / triple_scale(dataset.axes[i], scale, curvature[i], miss)
        for i, miss in misses.items()
    }
    roughness = np.full(dataset.shape, np.inf)
    for i, ratio in ratios.items():
        along, worst = np.moveaxis(roughness, i, 0), _known(ratio.max(axis=-1), np.inf)
        for k in range(3):  # a triple's three cases
            part = along[k : k + len(worst)]
            np.minimum(part, worst, out=part)
    roughness = _known(roughness, np.nan)
    blamed = _blamed(grid, roughness, ratios)
    return Coherence(
        triples=sum(int(np.isfinite(r).all(axis=-1).sum()) for r in ratios.values()),
        rows=names,
        scale=scale,
        curvature=curvature,
        worst=np.fmax.reduce(np.concatenate([r.reshape(-1, len(names)) for r in ratios.values()])),
        roughness=roughness,
        outliers=tuple(_outlier(dataset, grid, case, roughness) for case in blamed),
    )


def on_turn_of_rows(rows: Array, reference: Array) -> Array:
    """Rows (…, r, n), states first, with their angles on the turn nearest to `reference`'s."""
    turned = np.array(rows)
    angular = [row for row in CIRCULAR_STATES if row < rows.shape[-2]]
    turned[..., angular, :] = on_turn_of(rows[..., angular, :], reference[..., angular, :])
    return turned


def chord_misses(axis: Array, rows: Array) -> Array:
    """|δ| of Eq. (1), greatest over the nodes: rows (k, …, r, n) along `axis` (k,) → (k − 2, …, r)."""
    share = (axis[1:-1] - axis[:-2]) / (axis[2:] - axis[:-2])
    w = share.reshape(-1, *[1] * (rows.ndim - 1))
    before, after = (on_turn_of_rows(end, rows[1:-1]) for end in (rows[:-2], rows[2:]))
    miss: Array = np.abs(rows[1:-1] - (1.0 - w) * before - w * after).max(axis=-1)
    return miss


def family_scale(misses: list[Array], rows: Array) -> Array:
    """s of Eq. (2), (r,), from the misses and from the rows (p…, r, n) themselves."""
    flat = np.moveaxis(rows, -2, 0).reshape(rows.shape[-2], -1)
    low, high = np.nanmin(flat, axis=1), np.nanmax(flat, axis=1)
    scale: Array = np.fmax.reduce([_typical(miss) for miss in misses])
    scale = np.fmax(scale, RESOLUTION * (high - low))
    return np.where(scale > 0.0, scale, np.inf)


def triple_scale(axis: Array, scale: Array, curvature: Array, miss: Array) -> Array:
    """s of Eq. (2a) for the triples of an axis, of the shape of their misses or one that broadcasts."""
    wide: Array = np.fmax(scale, _product(axis, miss) * curvature)
    return wide


def _product(axis: Array, miss: Array) -> Array:
    """(b − a)(c − b) of an axis' triples, (k − 2, 1 …)."""
    step = np.diff(axis)
    return (step[:-1] * step[1:]).reshape(-1, *[1] * (miss.ndim - 1))


def _typical(values: Array) -> Array:
    """Median + 1.4826 MAD over all but the last axis, (r,); NaN if failed cases hide all."""
    flat = values.reshape(-1, values.shape[-1])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a line of failed cases has no median
        median = np.nanmedian(flat, axis=0)
        spread = np.nanmedian(np.abs(flat - median), axis=0)
    typical: Array = median + 1.4826 * spread
    return typical


def case_roughness(
    axes: tuple[Array, ...], rows: Array, index: tuple[int, ...], family: Coherence
) -> float:
    """Eq. (3) of one case, from the lines through it, on the scale of its family; NaN if unknown."""
    found = [np.inf]
    for i, axis in enumerate(axes):
        low, high = max(0, index[i] - 2), min(len(axis), index[i] + 3)
        if high - low < 3:
            continue
        through: Any = (*index[:i], slice(low, high), *index[i + 1 :])
        line = rows[through]
        miss = chord_misses(axis[low:high], line)
        scale = triple_scale(axis[low:high], family.scale, family.curvature[i], miss)
        found += (miss / scale).max(axis=-1).tolist()
    known = [value for value in found if np.isfinite(value)]
    return min(known, default=np.nan)


def _blamed(grid: Grid, roughness: Array, ratios: dict[int, Array]) -> list[int]:
    distance = np.zeros(grid.shape, dtype=int)
    for i, centre in enumerate(grid.centre):
        shape = [1] * len(grid.shape)
        shape[i] = -1
        distance += np.abs(np.arange(grid.shape[i]) - centre).reshape(shape)
    blamed: set[int] = set()
    for i, ratio in ratios.items():
        for place in np.argwhere(_known(ratio.max(axis=-1), 0.0) > THRESHOLD):
            k, others = int(place[0]), place[1:].tolist()
            three = [(*others[:i], k + step, *others[i:]) for step in range(3)]
            worst = max(three, key=lambda at: (float(roughness[at]), int(distance[at])))
            blamed.add(int(np.ravel_multi_index(worst, grid.shape)))
    return sorted(blamed, key=lambda case: (-float(roughness.ravel()[case]), case))


def _outlier(dataset: TrajectoryDataset, grid: Grid, case: int, roughness: Array) -> Outlier:
    index = tuple(int(i) for i in np.unravel_index(case, grid.shape))
    point = dict(zip(grid.names, grid.point(case).tolist(), strict=True))
    mission = dataset.mission
    limits = PathLimits.of(mission).names
    acting = np.array([mission.limits.share(name) * (1.0 - 0.5 * KEPT) for name in limits])
    acts = dataset.peak.reshape(grid.size, -1) >= acting
    alone = acts[case] & ~acts[grid.beside(case)].any(axis=0)
    limit = next((n for n, only in zip(limits, alone, strict=True) if only), None)
    return Outlier(case, index, point, float(roughness[index]), limit)


def _known(values: Array, otherwise: float) -> Array:
    return np.where(np.isfinite(values), values, otherwise)
