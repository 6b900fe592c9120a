"""Do neighbours on the grid hold optima of one branch? Measures in degrees and kilometres, then proof.

Roughness (`coherence`) compares a family with itself: one that lies on two branches throughout
is rough everywhere and calls that smooth. Nor does an axis of two points have a second difference. What
is measured here between two neighbours knows nothing of the family:

1. Bank angle. Neighbours whose bank angles differ by more than `bank` at a node are *unlike*.
2. Cost. So are neighbours whose costs differ by more than `cost` of the greater.
3. Flight. Halfway between two unlike neighbours the interpolated bank angle is flown open loop. Less
   than `flown` from the interpolated flight, guidance may use it, and the two count as joined.
4. Continuation. Others are joined if the optimum of one, followed to the other's parameters in steps
   that move it by less than `bank` each, arrives at the optimum that stands there: the same bank angle
   within `bank`, the same cost within `same_cost`. A jump on the way is another branch.

The neighbours left are *parted*. Without the parted ones the grid falls into branches, and the cases of
one that is parted from a greater one are *astray*. Where two sheets of a fold meet, the grid may hang
together round its end: then that case of a parted pair is astray which is farther from the hypercentre.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ampi.missions.mission import Mission
from ampi.physics.angles import wrapped
from ampi.physics.state import BANK
from ampi.propagation.reintegration import flight_checks
from ampi.scp.condensed.settings import SolverSettings
from ampi.scp.solve import solve, solve_family
from ampi.trajectory import Status, Trajectory
from database.audit.coherence import on_turn_of_rows
from database.factory.attempts import PATH_STEPS, Attempt, path_to, solve_one
from database.plan.grid import Grid
from database.records.campaign import Campaign, Solver

Array = NDArray[np.float64]
Cases = NDArray[np.int64]

CHUNK = 81


@dataclass(frozen=True, kw_only=True)
class BranchSettings:
    """What counts as unlike, and how much is flown and followed before two optima count as parted."""

    # Halfway between bank angles 2Δ apart the lift has 1 − cos Δ less of either component than on the
    # mean: 1.5 % at 20 degrees, what the density does in a quiet week. From +20 to −20 degrees it is
    # 6 %.
    bank: float = float(np.radians(20.0))  # rad
    cost: float = 0.5  # of the greater
    same_cost: float = 0.05  # of the greater
    # What a tracker can take out of one flight. SHEFEX-3's neighbours reach 7 km, two branches 45 to
    # 150 km.
    flown: float = 10e3  # m
    least_flown: int = 32  # pairs, the least alike: a number in kilometres for every family
    followed: int = 3  # pairs between two branches, the most alike, before they count as parted
    followed_within: int = 64  # pairs of one branch, the least alike: two sheets that meet are few


SETTINGS = BranchSettings()


@dataclass(frozen=True)
class Branch:
    """Cases that no parted pair separates from each other, astray from the rest."""

    cases: tuple[int, ...]
    bank_at_entry: tuple[float, float]  # rad, least and greatest
    cost_ratio: float  # median over its parted pairs: its cost over that of the case beyond


@dataclass(frozen=True)
class Branches:
    """What holds the family together, and who is astray."""

    pairs: int  # of neighbours, both solved
    unlike: int
    flown: int
    worst_flown: (
        float  # m, halfway between the neighbours flown; NaN with none, ∞ if one hits the ground
    )
    worst_pair: tuple[int, int] | None
    parted: tuple[tuple[int, int], ...]
    main_bank_at_entry: tuple[float, float]  # rad, of the cases that are not astray
    astray: tuple[Branch, ...]

    @property
    def cases(self) -> tuple[int, ...]:
        """Every case astray."""
        return tuple(sorted(case for branch in self.astray for case in branch.cases))


def branches(
    mission: Mission,
    optima: Mapping[int, Trajectory],
    solver: Solver = solve,
    settings: SolverSettings | None = None,
) -> Branches:
    """Measure a family.

    Parameters
    ----------
    mission
        With the grid.
    optima
        Solved cases by number.
    solver
        The optimiser that found them: it follows an optimum to its neighbour.
    settings
        Those of `ampi.solve`.
    """
    grid = Grid.from_mission(mission)
    bank = np.full((grid.size, mission.pseudospectral_mesh.n_nodes), np.nan)
    cost = np.full(grid.size, np.nan)
    for case, optimum in optima.items():
        bank[case], cost[case] = optimum.states[BANK], optimum.cost
    solved = np.isin(np.arange(grid.size), list(optima))
    pairs = grid.pairs()
    pairs = pairs[solved[pairs].all(axis=1)]
    one, other = pairs.T
    apart = np.abs(wrapped(bank[one] - bank[other])).max(axis=1, initial=0.0)
    unlike = (apart > SETTINGS.bank) | (_cost_gap(cost[one], cost[other]) > SETTINGS.cost)
    least_alike = np.argsort(-apart, kind="stable")
    flown = np.union1d(np.flatnonzero(unlike), least_alike[: SETTINGS.least_flown])
    error = np.full(len(pairs), np.nan)
    error[flown] = _flown_halfway(mission, grid, optima, pairs[flown])
    doubtful = [k for k in least_alike if unlike[k] and not error[k] <= SETTINGS.flown]
    campaign = Campaign(mission.toml, Path(), solver, settings or SolverSettings())
    parted = _parted(campaign, optima, pairs, doubtful)
    groups = astray(grid, solved, parted)
    away = [case for group in groups for case in group]
    worst = int(np.nanargmax(error)) if len(flown) else None
    return Branches(
        pairs=len(pairs),
        unlike=int(unlike.sum()),
        flown=len(flown),
        worst_flown=np.nan if worst is None else float(error[worst]),
        worst_pair=None if worst is None else _plain(pairs[worst]),
        parted=tuple(_plain(pair) for pair in parted),
        main_bank_at_entry=_range(np.delete(bank[:, 0], away)),
        astray=tuple(
            Branch(tuple(group), _range(bank[group, 0]), _cost_ratio(group, parted, cost))
            for group in groups
        ),
    )


def continued(campaign: Campaign, case: int, goal: int, optimum: Trajectory) -> Trajectory | None:
    """The optimum of `case` followed to the parameters of its neighbour `goal`; None if it ends.

    In one step if that moves the bank angle by less than `bank`, else in more and shorter ones: what
    jumps however short they are has left the branch. Newton's iteration alone is asked for the one step:
    where it needs help, what helps it finds another branch as gladly as this one.
    """
    for steps in (1, *PATH_STEPS):
        found = optimum
        for mission in path_to(campaign.mission, campaign.grid, goal, Attempt(case, steps)):
            if campaign.together and steps == 1:
                there = solve_family(campaign.family_of(mission), [found])[0]
            else:
                there = solve_one(campaign, mission, found)
            if there is None or not there.status.ok or unlikeness(there, found) > SETTINGS.bank:
                break
            found = there
        else:
            return found
    return None


def unlikeness(one: Trajectory, other: Trajectory) -> float:
    """Greatest difference of two bank angles (rad), at the nodes."""
    return float(np.abs(wrapped(one.states[BANK] - other.states[BANK])).max())


def same_optimum(one: Trajectory, other: Trajectory) -> bool:
    """Whether two flights from the same parameters are one optimum, to what convergence leaves."""
    return (
        unlikeness(one, other) <= SETTINGS.bank
        and not _cost_gap(one.cost, other.cost) > SETTINGS.same_cost
    )


def halfway(one: Trajectory, other: Trajectory) -> Trajectory:
    """The flight that interpolation finds in the middle between two optima."""
    rates = 0.5 * (one.controls + other.controls)
    return Trajectory(
        mesh=one.mesh,
        states=0.5 * (one.states + on_turn_of_rows(other.states, one.states)),
        bank_rate=rates[0],
        angle_of_attack_rate=rates[1] if len(rates) > 1 else None,
        final_time=0.5 * (one.final_time + other.final_time),
        cost=np.nan,
        status=Status.SOLVED,
    )


def suspects(grid: Grid, bank: NDArray[np.floating[Any]]) -> list[int]:
    """Cases that may be astray, from the bank angles (c, s) at some `stations` alone; NaN if unsolved.

    Between two neighbours one jumps by more than `bank`, and no line through the cases before or behind
    them leads there. Nothing is flown or solved: a doubt, for `branches` to settle.
    """
    bank, number = bank.reshape(*grid.shape, -1), np.arange(grid.size).reshape(grid.shape)
    found = []
    for i, axis in enumerate(grid.axes):
        cases, step = np.moveaxis(number, i, 0), np.diff(axis).astype(bank.dtype)
        step = step.reshape(-1, *[1] * (len(grid.shape) - 1))
        doubtful = np.zeros(cases[1:].shape, dtype=bool)
        for station in range(bank.shape[-1]):  # one by one: a grid may have millions of cases
            jump = wrapped(np.diff(np.moveaxis(bank[..., station], i, 0), axis=0))
            doubt = np.abs(jump) > SETTINGS.bank
            doubt[1:] &= ~(np.abs(jump[1:] - jump[:-1] * (step[1:] / step[:-1])) <= SETTINGS.bank)
            doubt[:-1] &= ~(np.abs(jump[:-1] - jump[1:] * (step[:-1] / step[1:])) <= SETTINGS.bank)
            doubtful |= doubt
        found.append(np.stack([cases[:-1][doubtful], cases[1:][doubtful]], axis=1))
    groups = astray(grid, np.isfinite(bank[..., 0]).ravel(), np.concatenate(found))
    return sorted(case for group in groups for case in group)


def branch_doubt(suspects: Sequence[int], path: Path) -> str:
    """What to say of `suspects` in a database, and what to do."""
    count = f"{len(suspects)} cases" if len(suspects) > 1 else "1 case"
    return (
        f"{count} may lie on another branch than the rest, or too far from it to interpolate: the bank "
        f"angle jumps by more than {np.degrees(SETTINGS.bank):.0f} deg beside them; to see which, and "
        f"mend it: ampi audit {shlex.quote(str(path))} --repair"
    )


def astray(grid: Grid, solved: NDArray[np.bool_], parted: Cases) -> list[list[int]]:
    """The branches that are parted from a greater one, by their cases, from the parted pairs (k, 2).

    What failed cases (`solved` (c,)) alone cut off is not astray: nobody knows.
    """
    if not len(parted):
        return []
    pairs = grid.pairs()
    pairs = pairs[solved[pairs].all(axis=1)]
    whole = ~np.isin(pairs @ [grid.size, 1], parted @ [grid.size, 1])
    branch = _components(grid.size, pairs[whole])
    size = np.bincount(branch, weights=solved)
    size[branch[np.ravel_multi_index(grid.centre, grid.shape)]] += 0.5  # of two as great
    one, other = branch[parted].T
    lesser = np.unique(np.where(size[one] < size[other], one, other)[one != other])
    groups = [np.flatnonzero(branch == number).tolist() for number in lesser]
    index = np.stack(np.unravel_index(parted, grid.shape), axis=-1)  # (k, 2, d)
    distance = np.abs(index - np.array(grid.centre)).sum(axis=-1)
    farther = parted[np.arange(len(parted)), (distance[:, 1] >= distance[:, 0]).astype(int)]
    fold = np.setdiff1d(farther[one == other], [case for group in groups for case in group])
    return sorted([*groups, *([case] for case in fold.tolist())], key=lambda g: (-len(g), g))


def _parted(
    campaign: Campaign, optima: Mapping[int, Trajectory], pairs: Cases, doubtful: list[int]
) -> Cases:
    """Of the `doubtful` pairs, by number and the least alike first, those that are parted, (k, 2)."""
    sure = np.delete(pairs, doubtful, axis=0)
    branch = _components(campaign.grid.size, sure)

    def joined(k: int) -> bool:
        """Arriving elsewhere is as good a proof as arriving: back from there leads the same way."""
        for case, goal in (_plain(pairs[k]), _plain(pairs[k][::-1])):
            arrived = continued(campaign, case, goal, optima[case])
            if arrived is not None:
                return same_optimum(arrived, optima[goal])
        return False

    followed: dict[tuple[int, int], int] = {}
    apart: list[int] = []
    unfollowed: list[int] = []
    for k in reversed(doubtful):  # between branches: a single pair may join them
        here, there = sorted(branch[pairs[k]].tolist())
        if here == there or followed.get((here, there), 0) == SETTINGS.followed:
            unfollowed.append(k)
        elif joined(k):
            branch[branch == there] = here
        else:
            followed[here, there] = followed.get((here, there), 0) + 1
            apart.append(k)
    within = [k for k in unfollowed if len(set(branch[pairs[k]].tolist())) == 1]
    apart += [k for k in unfollowed if k not in set(within)]
    apart += [k for k in within[::-1][: SETTINGS.followed_within] if not joined(k)]
    return pairs[sorted(apart)]


def _flown_halfway(
    mission: Mission, grid: Grid, optima: Mapping[int, Trajectory], pairs: Cases
) -> Array:
    """Position error (m) of the flight halfway between the two of each pair, (k,)."""
    error, everywhere = np.empty(len(pairs)), grid.points()
    for k in range(0, len(pairs), CHUNK):
        part = pairs[k : k + CHUNK]
        flights = [halfway(optima[int(one)], optima[int(other)]) for one, other in part]
        points = 0.5 * (everywhere[part[:, 0]] + everywhere[part[:, 1]])
        error[k : k + CHUNK] = _position_error(mission, points, flights)
    return error


def _position_error(mission: Mission, points: Array, flights: list[Trajectory]) -> Array:
    """Of flights at these parameters (k, d), open loop; ∞ for one that cannot be flown to its end."""
    states = np.array([flight.states for flight in flights])
    final_time = np.array([flight.final_time for flight in flights])
    family, mesh = mission.family(points), mission.pseudospectral_mesh
    flown = flight_checks(family, mesh, states, final_time, np.inf)
    return np.array([check.position_error for check in flown])


def _components(size: int, pairs: Cases) -> NDArray[np.int32]:
    """The part of the grid that each case belongs to, (c,), if these pairs hold together."""
    links = coo_array((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(size, size))
    labels: NDArray[np.int32] = connected_components(links, directed=False)[1]
    return labels


def _cost_gap(one: Any, other: Any) -> Any:
    """Difference of two costs over the greater."""
    with np.errstate(invalid="ignore"):  # two costs of 0 are the same
        return np.abs(one - other) / np.maximum(np.abs(one), np.abs(other))


def _cost_ratio(group: list[int], parted: Cases, cost: Array) -> float:
    """Median cost of the group's cases over that of the case beyond, over its parted pairs."""
    here = np.isin(parted, group)
    across = np.concatenate(
        [parted[here[:, 0] & ~here[:, 1]], parted[here[:, 1] & ~here[:, 0], ::-1]]
    )
    return float(np.median(cost[across[:, 0]] / cost[across[:, 1]]))


def _range(values: Array) -> tuple[float, float]:
    return float(np.nanmin(values)), float(np.nanmax(values))


def _plain(pair: Cases) -> tuple[int, int]:
    return int(pair[0]), int(pair[1])
