"""Monte-Carlo campaigns: many closed-loop entries, the same draws for every guidance mode.

Flights are flown in batches of a fixed size, whatever the number of workers: every flight sees the
same arithmetic, so a campaign's numbers are identical on one core and on many.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future
from contextlib import closing
from dataclasses import dataclass
from io import BytesIO
from lzma import LZMAError
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.missions.path_limits import KEPT
from ampi.onboard.reference import Mode
from ampi.outputs import written
from ampi.physics.planet import bearing, great_circle_distance
from ampi.physics.state import N_STATES
from ampi.simulation.closed_loop import FlightBatch, FlightStatus, fly_batch
from ampi.simulation.dispersions import Dispersions, Distribution
from ampi.workers.job import JobError, finished
from ampi.workers.supervisor import in_workers, require_workers

Array = NDArray[np.float64]

# what a few wrong bytes in an archive raise
DAMAGED = (BadZipFile, LZMAError, zlib.error, OSError, EOFError, RuntimeError, MemoryError)
SOURCES = {  # of what `fly` takes
    "mission": "a mission, from ampi.load_mission(name)",
    "guidance": "guidance, from ampi.load_guidance(path)",
    "dispersions": "ampi.Dispersions, or None for those of the mission's grid",
}
DIGEST = "sha256"  # in a file of flights: of all else in it
BATCH = 100  # flights; fixed, or the last bits would depend on the number of workers


@dataclass(frozen=True, eq=False)
class Flights:
    """A campaign in one guidance mode: n flights, k recorded points (NaN after a flight's end)."""

    mission: str
    mission_sha256: str
    mode: Mode
    seed: int
    cycle: float  # s, of guidance
    distribution: str
    half_widths: Array  # (d,), of the dispersions; SI, rad
    centre: Array  # (d,), of the dispersions, as offset from the nominal p
    parameters: Array  # (n, d), as drawn; SI, rad
    clipped: NDArray[np.bool_]  # (n,), outside the hypercube
    hole: NDArray[np.bool_]  # (n,), their reference is borrowed from beside an unsolved case
    status: NDArray[np.int64]  # (n,), FlightStatus
    final_states: Array  # (n, 7), where the speed reached its target
    final_time: Array  # (n,), s
    miss: Array  # (n,), m: great-circle distance to the target
    along: Array  # (n,), m: miss along the nominal ground track, positive beyond the target
    across: Array  # (n,), m: miss across it, positive to the right
    altitude_error: Array  # (n,), m
    speed_error: Array  # (n,), m/s
    times: Array  # (k,), s
    states: Array  # (n, 7, k)
    reference_states: Array  # (n, 7, k)
    bank_rate: Array  # (n, k), rad/s
    limits: tuple[str, ...]  # (l,), names of the limits that a flight is to keep
    path: Array  # (n, l, k): their use, over the limit
    peak: Array  # (n, l): its greatest values, read at every guidance cycle
    position_tolerance: float  # m, of the mission; infinite where its position is free
    altitude_tolerance: float  # m
    speed_tolerance: float  # m/s
    radii: Array  # (r,), m: within which the verdict counts flights

    def __post_init__(self) -> None:
        n, d, k = len(self.miss), self.parameters.shape[-1], len(self.times)
        limits = len(self.limits)
        shapes: dict[str, tuple[int, ...]] = {
            "parameters": (n, d),
            **dict.fromkeys(("half_widths", "centre"), (d,)),
            **dict.fromkeys(
                ("clipped", "hole", "status", "final_time", "miss", "along", "across"), (n,)
            ),
            **dict.fromkeys(("altitude_error", "speed_error"), (n,)),
            "final_states": (n, N_STATES),
            "times": (k,),
            **dict.fromkeys(("states", "reference_states"), (n, N_STATES, k)),
            "bank_rate": (n, k),
            "path": (n, limits, k),
            "peak": (n, limits),
            "radii": (len(self.radii),),
        }
        kinds = {"clipped": "b", "hole": "b", "status": "i"}
        for name, shape in shapes.items():
            array, kind = getattr(self, name), kinds.get(name, "f")
            if array.shape != shape or array.dtype.kind != kind:
                raise ValueError(
                    f"flights.{name}: expected an array of shape {shape} and kind {kind!r}, got "
                    f"{array.shape} and {array.dtype.kind!r}"
                )
        if not np.all(np.isin(self.status, list(FlightStatus))):
            raise ValueError("flights.status: expected members of FlightStatus")
        ended = ("final_states", "final_time", "miss", "along", "across", "altitude_error")
        for name in (*ended, "speed_error", "peak"):
            if not np.all(np.isfinite(getattr(self, name)[self.reached])):
                raise ValueError(
                    f"flights.{name}: expected finite numbers of every flight that reached its speed"
                )
        if not np.all(np.diff(self.times) > 0.0) or not np.all(np.diff(self.radii, prepend=0) > 0):
            raise ValueError("flights: expected times, and radii above 0, that increase strictly")
        tolerances = (self.position_tolerance, self.altitude_tolerance, self.speed_tolerance)
        if not all(tolerance > 0.0 for tolerance in tolerances):
            raise ValueError("flights: expected positive tolerances")

    @property
    def n(self) -> int:
        """Number of flights."""
        return len(self.miss)

    @property
    def dispersions(self) -> Dispersions:
        """What the parameters were drawn from."""
        return Dispersions(
            tuple(self.half_widths), Distribution(self.distribution), tuple(self.centre)
        )

    @property
    def reached(self) -> NDArray[np.bool_]:
        """Flights that ended at the target speed; the others count as outside every circle."""
        return self.status == int(FlightStatus.REACHED_SPEED)

    @property
    def faults(self) -> dict[str, NDArray[np.bool_]]:
        """What flights have not passed by: reason → (n,). One may have several; NaN is no pass."""
        return {
            "target_speed_not_reached": ~self.reached,
            "position": ~(self.miss <= self.position_tolerance),
            "altitude": ~(np.abs(self.altitude_error) <= self.altitude_tolerance),
            "speed": ~(np.abs(self.speed_error) <= self.speed_tolerance),
            **{name: ~(self.peak[:, i] <= 1.0 + KEPT) for i, name in enumerate(self.limits)},
        }

    @property
    def passed(self) -> NDArray[np.bool_]:
        """(n,): reached the target speed within every tolerance of the mission, and kept every limit."""
        return ~np.any(list(self.faults.values()), axis=0)


def save_campaigns(path: str | Path, campaigns: Mapping[str, Flights]) -> None:
    """Write campaigns of one mission (name → flights) as one compressed .npz, at once."""
    _require_one_mission(campaigns)
    packed: dict[str, Any] = {
        f"{name}/{key}": np.asarray(value.value if isinstance(value, Mode) else value)
        for name, flights in campaigns.items()
        for key, value in vars(flights).items()
    }
    packed[DIGEST] = np.asarray(_digest(packed))
    with written(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **packed)


def load_campaigns(path: str | Path) -> dict[str, Flights]:
    """Read what `save_campaigns` wrote.

    Raises
    ------
    ValueError
        If the file is not whole, or its content is not what was written.
    """
    content = BytesIO(Path(path).read_bytes())
    try:
        with np.lib.npyio.NpzFile(content) as packed:
            arrays = {key: packed[key] for key in packed.files}
        if DIGEST not in arrays or str(arrays.pop(DIGEST)) != _digest(arrays):
            raise ValueError("its content is not what was written")
        found: dict[str, dict[str, Any]] = {}
        for key, array in arrays.items():
            name, _, part = key.partition("/")
            found.setdefault(name, {})[part] = array if array.ndim else array.item()
        campaigns = {
            name: Flights(
                **{**parts, "mode": Mode(parts["mode"]), "limits": tuple(parts["limits"])}
            )
            for name, parts in found.items()
        }
        _require_one_mission(campaigns)
    except (*DAMAGED, KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"{path}: not a whole file of flights ({error}); make one with: ampi fly --output"
        ) from None
    return campaigns


def _digest(arrays: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 of names, types, shapes and values."""
    digest = hashlib.sha256()
    for key, array in sorted(arrays.items()):
        digest.update(f"{key} {array.dtype.str} {array.shape}\0".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _require_one_mission(campaigns: Mapping[str, Flights]) -> None:
    if len({flights.mission_sha256 for flights in campaigns.values()}) != 1:
        missions = ", ".join(f"{name} of {f.mission}" for name, f in campaigns.items())
        raise ValueError(
            f"campaigns: expected flights of one mission, got {missions or 'none'}; keep those of "
            "another mission in another file"
        )


def fly(
    mission: Mission,
    guidance: Guidance,
    dispersions: Dispersions | None = None,
    n: int = 1000,
    *,
    seed: int = 2016,
    n_jobs: int = 2,
    cycle: float | None = None,
    record_every: float = 5.0,
    advance: Callable[[int], None] | None = None,
) -> Flights:
    """Fly `n` dispersed entries in closed loop.

    A worker process that dies costs nothing: its flights are flown again.

    Parameters
    ----------
    mission
        From `load_mission`.
    guidance
        From `load_guidance`; `guidance.in_mode(...)` flies the same table in another mode.
    dispersions
        None: those of the mission's grid, normal about the nominal with 3σ at its edge (Eq. (34)).
    n, seed
        Flights, and the seed of the campaign's SeedSequence.
    n_jobs
        Worker processes; the result does not depend on it.
    cycle
        Of guidance (s); None: that of `guidance`.
    record_every
        Seconds between the recorded points of the histories, rounded to guidance cycles.
    advance
        Called with the number of flights just flown.

    Returns
    -------
    Flights
        Every flight, those that failed included with their status.

    Raises
    ------
    ValueError
        If an argument cannot be what it says.
    JobError
        If the worker processes die time and again.
    """
    flown = fly_modes(
        mission,
        guidance,
        None,
        dispersions,
        n,
        seed=seed,
        n_jobs=n_jobs,
        cycle=cycle,
        record_every=record_every,
        advance=advance,
    )
    return next(iter(flown.values()))


def fly_modes(
    mission: Mission,
    guidance: Guidance,
    modes: Mode | str | Iterable[Mode | str] | None = None,
    dispersions: Dispersions | None = None,
    n: int = 1000,
    *,
    seed: int = 2016,
    n_jobs: int = 2,
    cycle: float | None = None,
    record_every: float = 5.0,
    advance: Callable[[int], None] | None = None,
) -> dict[Mode, Flights]:
    """`fly` in each of `modes`, all on the same draws and by the same worker processes.

    `modes` are members of `Mode` or their names, one or several; None: that of `guidance`.
    """
    for name, value, kind in (
        ("mission", mission, Mission),
        ("guidance", guidance, Guidance),
        ("dispersions", dispersions, Dispersions | None),
    ):
        if not isinstance(value, kind):
            raise ValueError(f"{name}: expected {SOURCES[name]}, got {value!r:.60}")
    mission.checked()
    if guidance.mission_sha256 not in (None, mission.digest):
        raise ValueError(
            f"guidance: its database was built for another mission than {mission.name}; "
            "fly the mission of the database (read_dataset(path).mission), or build it anew"
        )
    require_workers(n_jobs)
    if not isinstance(record_every, int | float) or not 0.0 < record_every < np.inf:
        raise ValueError(
            f"record_every: expected a positive number of seconds, got {record_every!r}"
        )
    if dispersions is None:
        dispersions = Dispersions.from_mission(mission)
    draws = dispersions.draw(mission, n, seed)
    guidance = guidance.at_cycle(guidance.cycle if cycle is None else cycle)
    modes = guidance.mode if modes is None else modes
    chosen = [modes] if isinstance(modes, Mode | str) else modes
    flying = {guide.mode: guide for guide in map(guidance.in_mode, chosen)}
    firsts = range(0, n, BATCH)
    jobs = [
        Batch(mission, guide, draws[i : i + BATCH], record_every, i)
        for guide in flying.values()
        for i in firsts
    ]
    notify = advance or (lambda count: None)
    found: dict[Mode, Flights] = {}
    with closing(in_workers(__name__, jobs, n_jobs)) as results:
        for mode, guide in flying.items():
            batches = []
            for _ in firsts:
                batches.append(next(results))
                notify(len(batches[-1].status))
            found[mode] = _assemble(mission, guide, dispersions, seed, draws, batches)
    return found


@dataclass(frozen=True, eq=False)
class Batch:
    """Flights that are flown together, as a job; flown again it is the same flights."""

    mission: Mission
    guidance: Guidance
    draws: Array  # (b, d)
    record_every: float  # s
    first: int  # number of its first flight

    def compute(self, announce: Callable[[int], None]) -> Future[FlightBatch]:
        """Fly them."""
        announce(0)
        family = self.mission.family(self.draws)
        return finished(fly_batch(family, self.guidance, self.draws, self.record_every))

    def without(self, attempt: int) -> Batch:
        """There is one way to fly them."""
        return self

    def give_up(self, reason: str) -> FlightBatch:
        """There is no campaign without them."""
        raise JobError(
            f"flights {self.first} to {self.first + len(self.draws) - 1} in mode "
            f"{self.guidance.mode.value}: {reason} If the memory was short, try fewer worker processes"
        )


def _assemble(
    mission: Mission,
    guidance: Guidance,
    dispersions: Dispersions,
    seed: int,
    draws: Array,
    batches: list[FlightBatch],
) -> Flights:
    times = max((b.times for b in batches), key=len)

    def joined(arrays: list[Array]) -> Array:
        k = len(times)
        pads = [[(0, 0)] * (a.ndim - 1) + [(0, k - a.shape[-1])] for a in arrays]
        return np.concatenate(
            [np.pad(a, p, constant_values=np.nan) for a, p in zip(arrays, pads, strict=True)]
        )

    final = np.concatenate([b.final_states for b in batches])
    states = joined([b.states for b in batches])
    family, target = mission.family(draws), mission.target
    radius = family.flight_model().planet.equatorial_radius
    along, across = _track_frame(mission, family, guidance, final, radius)
    bank_rate = joined([b.bank_rate for b in batches])
    limits = family.path_limits(trailing=1)
    over_time = family.flight_model(trailing=1)
    use = limits.use(over_time, states.transpose(1, 0, 2), bank_rate, times)
    return Flights(
        mission=mission.name,
        mission_sha256=mission.digest,
        mode=guidance.mode,
        seed=seed,
        cycle=guidance.cycle,
        distribution=dispersions.distribution.value,
        half_widths=np.array(dispersions.half_widths),
        centre=np.array(dispersions.centre or np.zeros(draws.shape[1])),
        parameters=draws,
        clipped=np.concatenate([b.clipped for b in batches]),
        hole=np.concatenate([b.hole for b in batches]),
        status=np.concatenate([b.status for b in batches]),
        final_states=final,
        final_time=np.concatenate([b.final_time for b in batches]),
        miss=great_circle_distance(
            final[:, 1],
            final[:, 2],
            family.target("longitude"),
            family.target("latitude"),
            radius,
        ),
        along=along,
        across=across,
        altitude_error=final[:, 0] - family.target("altitude"),
        speed_error=final[:, 3] - family.target("speed"),
        times=times,
        states=states,
        reference_states=joined([b.reference_states for b in batches]),
        bank_rate=bank_rate,
        limits=limits.names,
        path=np.stack(use, axis=1),
        peak=np.concatenate([b.peak for b in batches]),
        position_tolerance=target.position_tolerance if target.position == "fixed" else np.inf,
        altitude_tolerance=target.altitude_tolerance,
        speed_tolerance=target.speed_tolerance,
        radii=np.array(target.judged_radii),
    )


def _track_frame(
    mission: Mission, family: MissionFamily, guidance: Guidance, final: Array, radius: Any
) -> tuple[Array, Array]:
    """Miss (m) along and across the nominal final azimuth, by its distance and bearing."""
    nominal = guidance.in_mode(Mode.NOMINAL).reference(mission.nominal_parameters)
    target = family.target("longitude"), family.target("latitude")
    miss = great_circle_distance(*target, final[:, 1], final[:, 2], radius)
    off = bearing(*target, final[:, 1], final[:, 2]) - nominal.states[5, -1]
    return miss * np.cos(off), miss * np.sin(off)
