"""Is the database true, and what does interpolating it cost?

`audit` answers five questions with numbers of its own making, not with those stored in the file:

1. Truth. Every case is flown again by DOP853 under its own bank angle (ampi.propagation).
2. Limits. On that flight every limit is read on a 1 s grid, between the nodes.
3. Interpolation. At random points of the hypercube the reference of each guidance mode is compared
   with the optimal control problem solved there: greatest error over the nodes of the flight, and the
   miss distance when the interpolated bank angle is flown open loop to the interpolated final time.
4. Coherence. Second differences over the grid name the cases that stand out (`coherence`); bank angle,
   cost, flights halfway and continuation name those of another branch (`branches`).
5. Error map. Which cell of which axis interpolates worst, and where one more point would pay most
   (database.audit.error_map).
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.dataset import TrajectoryDataset
from ampi.loading import guidance_table
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.onboard.reference import Mode, ReferenceGenerator
from ampi.onboard.table import GuidanceTable
from ampi.physics.planet import great_circle_distance
from ampi.physics.state import (
    ALTITUDE,
    ANGLE_OF_ATTACK,
    BANK,
    LATITUDE,
    LONGITUDE,
    N_STATES,
    SPEED,
)
from ampi.propagation.adaptive_step import IntegrationError
from ampi.propagation.reintegration import reintegrate_many
from ampi.scp.solve import optimum
from ampi.simulation.uniform_numbers import require_whole
from ampi.trajectory import Status, Trajectory
from ampi.workers.in_order import in_workers
from ampi.workers.job import JobError, finished
from ampi.workers.supervisor import require_workers
from database.audit.branches import Branches, branches
from database.audit.coherence import THRESHOLD, Coherence, coherence, on_turn_of_rows
from database.audit.error_map import CellError, error_map
from database.plan.grid import Grid

Array = NDArray[np.float64]

CHUNK = 81
PORTION = 4  # random points that are solved one after the other in a process
PERCENTILE = 90.0
COLUMNS = ("altitude_m", "speed_m_per_s", "bank_deg", "final_time_s", "open_loop_miss_km")
MODES = (Mode.MPI, Mode.AMPI, Mode.QUADRATIC)


@dataclass(frozen=True)
class ErrorSummary:
    """Median, 90th percentile and worst of an error over its cases."""

    median: float
    percentile_90: float
    worst: float

    @classmethod
    def of(cls, values: Array) -> ErrorSummary:
        """From one error per case; NaN is an error that nobody knows, ∞ that of a flight with no end."""
        values = values[~np.isnan(values)]
        if len(values) == 0:
            return cls(np.nan, np.nan, np.nan)
        with np.errstate(invalid="ignore"):  # between ∞ and ∞ numpy finds no number
            found = np.percentile(values, [50.0, PERCENTILE, 100.0])
        return cls(*np.nan_to_num(found, nan=np.inf, posinf=np.inf).tolist())


@dataclass(frozen=True, eq=False)
class PerCase:
    """Every solved case on its own; c of them."""

    case: NDArray[np.int64]  # (c,)
    position_error_m: Array  # (c,), greatest along the flight
    altitude_error_m: Array  # (c,)
    speed_error_m_per_s: Array  # (c,)
    limits_used: Array  # (c, l), greatest use of each limit, between the nodes


@dataclass(frozen=True)
class AuditReport:
    """The answers."""

    cases: int
    statuses: dict[str, int]
    position_error: ErrorSummary  # m, greatest along each flight
    altitude_error: ErrorSummary  # m
    speed_error: ErrorSummary  # m/s
    limits: dict[str, float]  # greatest use of each, between the nodes
    probes: int
    unsolved_probes: int
    hidden_probes: int  # whose cell has a case without a solution: AMPI has no reference there
    interpolation: dict[str, dict[str, ErrorSummary]]  # mode → column → error
    coherence: Coherence
    branches: Branches
    error_map: tuple[CellError, ...]
    per_case: PerCase

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        numbers = asdict(self)
        smooth = numbers["coherence"]
        rows = smooth.pop("rows")
        for key in ("scale", "worst"):
            smooth[key] = dict(zip(rows, getattr(self.coherence, key).tolist(), strict=True))
        smooth["curvature"] = [
            dict(zip(rows, b.tolist(), strict=True)) for b in self.coherence.curvature
        ]
        smooth["roughness"] = self.coherence.roughness.ravel().tolist()
        smooth["threshold"] = THRESHOLD
        for cell, plain in zip(self.error_map, numbers["error_map"], strict=True):
            plain["gain_per_case"] = cell.gain_per_case
        numbers["per_case"] = {k: v.tolist() for k, v in vars(self.per_case).items()}
        return numbers


def audit(
    dataset: TrajectoryDataset,
    *,
    probes: int = 100,
    seed: int = 2016,
    n_jobs: int = 2,
    advance: Callable[[int], None] | None = None,
) -> AuditReport:
    """Audit a database; `advance` is called with the number of cases or probes just done.

    Parameters
    ----------
    dataset
        From `read_dataset`.
    probes
        Random points of the hypercube, uniform, at which the problem is solved (0 for none).
    seed
        Of the random points.
    n_jobs
        Worker processes for the probes.
    """
    if not isinstance(dataset, TrajectoryDataset):
        raise ValueError(
            f"dataset: expected a database, from ampi.dataset.read_dataset(path), got {dataset!r:.60}"
        )
    if isinstance(probes, bool) or not isinstance(probes, int) or probes < 0:
        raise ValueError(f"probes: expected a non-negative number, got {probes!r}")
    require_whole("seed", seed)
    require_workers(n_jobs)
    notify = advance or (lambda count: None)
    flown = _fly_again(dataset, notify)
    names = PathLimits.of(dataset.mission).names
    peak = flown.limits_used.max(axis=0, initial=0.0)
    probed = _probe(dataset, probes, seed, n_jobs, notify)
    return AuditReport(
        cases=int(dataset.status.size),
        statuses={
            s.name: int(np.sum(dataset.status == int(s))) for s in Status if s in dataset.status
        },
        position_error=ErrorSummary.of(flown.position_error_m),
        altitude_error=ErrorSummary.of(flown.altitude_error_m),
        speed_error=ErrorSummary.of(flown.speed_error_m_per_s),
        limits={n: float(v) for n, v in zip(names, peak, strict=True)},
        probes=probes,
        unsolved_probes=probed.unsolved,
        hidden_probes=probed.hidden,
        interpolation={
            mode.value: {
                c: ErrorSummary.of(probed.errors[mode.value][:, i]) for i, c in enumerate(COLUMNS)
            }
            for mode in MODES
        },
        coherence=coherence(dataset),
        branches=branches(
            dataset.mission,
            {c: dataset.trajectory(c) for c in np.flatnonzero(dataset.solved.ravel()).tolist()},
        ),
        error_map=error_map(dataset, n_jobs=n_jobs, seed=seed),
        per_case=flown,
    )


def _fly_again(dataset: TrajectoryDataset, notify: Callable[[int], None]) -> PerCase:
    mission = dataset.mission
    points = Grid.from_mission(mission).points()
    good = np.flatnonzero(dataset.solved.ravel())
    states = dataset.states.reshape(-1, *dataset.states.shape[-2:])[good]
    final_time = dataset.final_time.ravel()[good]
    errors, peak = np.zeros((3, len(good))), np.zeros((len(good), dataset.peak.shape[-1]))
    for i in range(0, len(good), CHUNK):
        part = slice(i, i + CHUNK)
        family = mission.family(points[good[part]])
        check = reintegrate_many(
            family, mission.pseudospectral_mesh, states[part], final_time[part]
        )
        errors[:, part] = check.position_error, check.altitude_error, check.speed_error
        peak[part] = check.peak
        notify(len(final_time[part]))
    position, altitude, speed = errors
    return PerCase(good, position, altitude, speed, peak)


@dataclass(frozen=True, eq=False)
class _Probed:
    errors: dict[str, Array]  # mode → (points, columns), NaN where a hole is all that it has
    unsolved: int
    hidden: int


def _probe(
    dataset: TrajectoryDataset,
    probes: int,
    seed: int,
    n_jobs: int,
    notify: Callable[[int], None],
) -> _Probed:
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    low = np.array([axis[0] for axis in dataset.axes])
    high = np.array([axis[-1] for axis in dataset.axes])
    points = rng.uniform(low, high, size=(probes, len(low)))
    table = guidance_table(dataset, "fly")
    ampi = ReferenceGenerator(table, Mode.AMPI)
    whole = [p for p in points if not ampi.reference(p).hole]
    notify(len(points) - len(whole))
    found: list[dict[str, Array]] = []
    jobs = [
        Probes(dataset.mission, table, whole[k : k + PORTION])
        for k in range(0, len(whole), PORTION)
    ]
    with closing(in_workers(__name__, jobs, n_jobs)) as results:
        for portion in results:
            notify(len(portion))
            found += [errors for errors in portion if errors is not None]
    errors = {
        mode.value: np.array([row[mode.value] for row in found]).reshape(-1, len(COLUMNS))
        for mode in MODES
    }
    return _Probed(errors, len(whole) - len(found), len(points) - len(whole))


@dataclass(frozen=True, eq=False)
class Probes:
    """Some random points, as a job (ampi.workers.job): the table travels once for all of them."""

    mission: Mission
    table: GuidanceTable
    points: list[Array]

    def compute(self, announce: Callable[[int], None]) -> Future[list[dict[str, Array] | None]]:
        """Solve the problem at each."""
        announce(0)
        return finished([_probe_point(self.mission, self.table, p) for p in self.points])

    def without(self, attempt: int) -> Probes:
        """There is one way only."""
        return self

    def give_up(self, reason: str) -> list[dict[str, Array] | None]:
        """Points that kill a process say nothing of the database."""
        raise JobError(f"{len(self.points)} random points could not be solved: {reason}")


def _probe_point(mission: Mission, table: GuidanceTable, point: Array) -> dict[str, Array] | None:
    """Errors of every mode at one point; None if the problem there could not be solved."""
    here = mission.with_parameters(point)
    states, rate, final_time = nodal_reference(table, Mode.AMPI, point)
    mesh = mission.pseudospectral_mesh
    guess = Trajectory(mesh, states, rate, final_time, np.nan, Status.SOLVED)
    if len(states) > N_STATES:
        angle_rate = states[ANGLE_OF_ATTACK] @ mesh.derivative(final_time).T
        guess = replace(guess, angle_of_attack_rate=angle_rate)
    truth = optimum(here, guess=guess)
    if not truth.status.ok:
        return None
    errors = {}
    for mode in MODES:
        generator = ReferenceGenerator(table, mode)
        made = generator.reference(point)
        errors[mode.value] = (
            np.full(len(COLUMNS), np.nan)
            if made.hole
            else _errors(here, truth, _states(generator), made.final_time)
        )
    return errors


def nodal_reference(table: GuidanceTable, mode: Mode, point: Array) -> tuple[Array, Array, float]:
    """Interpolated nodal states (7 or 8, n), bank rate (n,) and final time, before LD→HD."""
    generator = ReferenceGenerator(table, mode)
    final_time = generator.reference(point).final_time
    rate = generator.nodal_values[table.layout.bank_rate].copy()
    return _states(generator), rate, final_time


def _states(generator: ReferenceGenerator) -> Array:
    """Of the reference last made, at the nodes."""
    return generator.table.layout.flight_states(generator.nodal_values).copy()


def _errors(mission: Mission, truth: Trajectory, states: Array, final_time: float) -> Array:
    flown = states.copy()
    flown[:BANK, 0] = mission.entry_state
    target, mesh = mission.target, mission.pseudospectral_mesh
    try:
        end = reintegrate_many(
            MissionFamily.of([mission]), mesh, flown[None], np.array([final_time]), np.inf
        ).states[0, :, -1]
    except IntegrationError:
        miss = np.inf
    else:
        radius = mission.flight_model.planet.equatorial_radius
        miss = great_circle_distance(
            end[LONGITUDE], end[LATITUDE], target.longitude, target.latitude, radius
        )
    difference = np.abs(on_turn_of_rows(states, truth.states) - truth.states).max(axis=1)
    return np.array(
        [
            difference[ALTITUDE],
            difference[SPEED],
            np.degrees(difference[BANK]),
            abs(final_time - truth.final_time),
            miss / 1e3,
        ]
    )
