"""What a build did: how many cases are solved, how well, and which are not and why.

Failures are told in three lines: where they lie, why, and how the others can fly all the same.
"""

from __future__ import annotations

import math
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.missions.parameters import Parameter
from ampi.trajectory import Status
from database.audit.branches import branch_doubt, suspects
from database.file.encoded_block import STATIONS, BlockSummary
from database.plan.grid import Grid

FEW = 2  # failures that are named one by one
MOST_PLACES = 2  # axis values that are named before the rest is "elsewhere"
MOST_LETTERS = 240  # of an error


@dataclass(frozen=True)
class Failure:
    """A case without a solution."""

    case: int
    index: tuple[int, ...]  # on the grid
    values: dict[str, float]  # of the parameters, by key and in the key's unit
    status: Status
    message: str  # every attempt

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {**asdict(self), "status": self.status.name}


@dataclass(frozen=True)
class BuildReport:
    """What a build did."""

    path: Path
    cases: int
    solved: int
    resumed: int  # cases found already solved
    already_whole: bool  # nothing was to be done
    failures: tuple[Failure, ...]
    failure_summary: tuple[str, ...]
    median_iterations: float
    worst_iterations: int
    seconds: float
    solve_seconds: float  # wall time up to the merge: solves and re-integrations
    worst_position_error: float  # m, of the solved cases
    worst_limit: float  # greatest use of a limit between their nodes
    suspects: tuple[int, ...]  # cases that may lie on another branch (database.audit.branches)

    @property
    def doubts(self) -> tuple[str, ...]:
        """What speaks against flying the file as it is: neighbours that seem to lie on two branches."""
        return (branch_doubt(self.suspects, self.path),) if self.suspects else ()

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            **vars(self),
            "path": str(self.path),
            "failures": [failure.as_dict() for failure in self.failures],
            "doubts": self.doubts,
        }


@dataclass(eq=False)
class Tally:
    """What the report says, gathered while the blocks of a file pass by."""

    mission: Mission
    bank: NDArray[np.float32]  # (c, s), rad: of each case at the stations; NaN if unsolved
    iterations: Counter[int] = field(default_factory=Counter)  # how many solved cases took so many
    failures: list[Failure] = field(default_factory=list)
    worst_position_error: float = float("nan")
    worst_limit: float = float("nan")

    @classmethod
    def of(cls, mission: Mission) -> Tally:
        """Before the first block."""
        cases = math.prod(len(p.offsets) for p in mission.parameters)
        return cls(mission, np.full((cases, STATIONS), np.nan, np.float32))

    def count(self, cases: NDArray[np.int64], block: BlockSummary) -> None:
        """Add a block and its cases (c,)."""
        numbers = block.numbers
        good = numbers["status"][:, 0] == int(Status.SOLVED)
        self.bank[cases] = np.where(good[:, None], numbers["bank"], np.nan)
        self.iterations.update(numbers["iterations"][good, 0].tolist())
        error, peak = numbers["position_error"][good], numbers["peak"][good]
        self.worst_position_error = _worst(self.worst_position_error, error)
        self.worst_limit = _worst(self.worst_limit, peak)
        for place, (status, message) in block.unsolved.items():
            self.fail(int(cases[place]), status, message)

    def fail(self, case: int, status: Status, message: bytes) -> None:
        """Add a case without a solution."""
        parameters = self.mission.parameters
        shape = tuple(len(p.offsets) for p in parameters)
        index = tuple(int(i) for i in np.unravel_index(case, shape))
        self.failures.append(
            Failure(
                case=case,
                index=index,
                values={
                    p.key: in_unit_of_key(p, i) for p, i in zip(parameters, index, strict=True)
                },
                status=status,
                message=message.decode("utf-8", "replace"),
            )
        )

    def report(
        self,
        path: Path,
        *,
        resumed: int,
        already_whole: bool,
        seconds: float = 0.0,
        solve_seconds: float = 0.0,
    ) -> BuildReport:
        """After the last block."""
        return BuildReport(
            path=path,
            cases=len(self.bank),
            solved=self.iterations.total(),
            resumed=resumed,
            already_whole=already_whole,
            failures=tuple(self.failures),
            failure_summary=failure_summary(self.failures, self.mission.parameters, path),
            median_iterations=_median(self.iterations),
            worst_iterations=max(self.iterations, default=0),
            seconds=seconds,
            solve_seconds=solve_seconds,
            worst_position_error=self.worst_position_error,
            worst_limit=self.worst_limit,
            suspects=tuple(suspects(Grid.from_mission(self.mission), self.bank)),
        )


def failure_summary(
    failures: Sequence[Failure], parameters: Sequence[Parameter], path: Path
) -> tuple[str, ...]:
    """Where, why, and what to do; no line where all is solved."""
    if not failures:
        return ()
    shape = {p.key: len(p.offsets) for p in parameters}
    cases = math.prod(shape.values())
    places = _places(failures, parameters)
    (first, _), hit = places[0]
    if len(failures) <= FEW:
        told = ", ".join(f"case {one.case} at {_at(one.values)}" for one in failures)
    elif hit == len(failures):
        there = cases // shape[first]
        told = f"all of them at {_at(dict([places[0][0]]))}, where there are {there} cases"
    else:
        told = ", ".join(
            f"{count} at {_at(dict([place]))}" for place, count in places[:MOST_PLACES]
        )
        rest = len(failures) - sum(count for _, count in places[:MOST_PLACES])
        told += f", {rest} elsewhere" if rest else ""
    return (
        f"{len(failures)} of {cases} cases not solved: {told}",
        f"reasons: {_reasons(failures)}",
        f"{_way_out(places, shape, path)}; --json names every case and what was tried",
    )


def _places(
    failures: Sequence[Failure], parameters: Sequence[Parameter]
) -> list[tuple[tuple[str, float], int]]:
    """Axis values, none of them nominal, that hold all failures, and how many of the rest each holds.

    The one that holds most comes first; of equal ones, that of the first axis.
    """
    nominal = {(p.key, in_unit_of_key(p, p.offsets.index(0.0))) for p in parameters}
    found, left = [], list(failures)
    while left:
        counts = Counter(place for one in left for place in one.values.items())
        place = max((place for place in counts if place not in nominal), key=counts.__getitem__)
        found.append((place, counts[place]))
        left = [one for one in left if one.values[place[0]] != place[1]]
    return found


def _reasons(failures: Sequence[Failure]) -> str:
    """Each status once, the commonest first; an error with what it was, of its first case."""
    counts = Counter(one.status for one in failures)
    told = []
    for status, count in counts.most_common():
        sentence = status.sentence
        if status is Status.ERROR:
            sentence = next(one.message for one in failures if one.status is status)[-MOST_LETTERS:]
        told.append(f"{count} × {sentence}")
    return " ".join(told)


def _way_out(
    places: Sequence[tuple[tuple[str, float], int]], shape: Mapping[str, int], path: Path
) -> str:
    """A crop, by dropping few axis values if they hold all failures, and what flies without one."""
    crop = "--box"
    if len(places) <= MOST_PLACES:
        crop = " ".join(f"--drop {key}={value:.6g}" for (key, value), _ in places)
        dropped = Counter(key for (key, _), _ in places)
        kept = math.prod(n - dropped[key] for key, n in shape.items())
        crop += f" keeps the other {kept} cases"
    else:
        crop += " keeps the largest box without them"
    command = f"ampi crop {shlex.quote(str(path))} {crop}"
    return f"{command}; with --holes fly, fly and guide take the file as it is"


def _at(values: Mapping[str, float]) -> str:
    return ", ".join(f"{key} = {value:.6g}" for key, value in values.items())


def in_unit_of_key(parameter: Parameter, index: int) -> float:
    """Of a grid point on an axis, in the unit of its key."""
    number = parameter.number
    return number.nominal / number.per_unit + parameter.offsets[index]


def _median(counts: Counter[int]) -> float:
    """Of numbers that are counted; NaN of none."""
    if not counts:
        return float("nan")
    values = sorted(counts)
    upto, half = np.cumsum([counts[value] for value in values]), 0.5 * counts.total()
    low, high = np.searchsorted(upto, half), np.searchsorted(upto, half, side="right")
    return 0.5 * (values[low] + values[high])


def _worst(before: float, values: NDArray[np.float64]) -> float:
    return float(np.fmax.reduce(values, axis=None, initial=before))
