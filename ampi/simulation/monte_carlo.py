"""Monte-Carlo campaigns: many closed-loop entries, the same draws for every guidance mode.

Flights are flown in batches of a fixed size, whatever the number of workers: every flight sees the
same arithmetic, so a campaign's numbers are identical on one core and on many.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import Future
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.physics.planet import bearing, great_circle_distance
from ampi.physics.state import ALTITUDE, AZIMUTH, LATITUDE, LONGITUDE, SPEED
from ampi.simulation.closed_loop import FlightBatch, fly_batch
from ampi.simulation.dispersions import Dispersions
from ampi.simulation.flights import Flights
from ampi.workers.in_order import in_workers
from ampi.workers.job import JobError, finished
from ampi.workers.supervisor import require_workers

Array = NDArray[np.float64]

SOURCES = {  # of what `fly` takes
    "mission": "a mission, from ampi.load_mission(name)",
    "guidance": "guidance, from ampi.load_guidance(path)",
    "dispersions": "ampi.Dispersions, or None for those of the mission's grid",
}
BATCH = 100  # flights; fixed, or the last bits would depend on the number of workers


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
    whole = FlightBatch.joined(batches)
    final, family, target = whole.final_states, mission.family(draws), mission.target
    radius = family.flight_model().planet.equatorial_radius
    along, across = _track_frame(mission, family, guidance, final, radius)
    there = (family.target("longitude"), family.target("latitude"))
    limits, over_time = family.path_limits(trailing=1), family.flight_model(trailing=1)
    states = whole.states.transpose(1, 0, 2)
    return Flights(
        mission=mission.name,
        mission_sha256=mission.digest,
        mode=guidance.mode,
        seed=seed,
        cycle=guidance.cycle,
        distribution=dispersions.distribution,
        half_widths=np.array(dispersions.half_widths),
        centre=np.array(dispersions.centre or np.zeros(draws.shape[1])),
        parameters=draws,
        **vars(whole),
        miss=great_circle_distance(final[:, LONGITUDE], final[:, LATITUDE], *there, radius),
        along=along,
        across=across,
        altitude_error=final[:, ALTITUDE] - family.target("altitude"),
        speed_error=final[:, SPEED] - family.target("speed"),
        limits=limits.names,
        path=np.stack(limits.use(over_time, states, whole.bank_rate, whole.times), axis=1),
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
    end = final[:, LONGITUDE], final[:, LATITUDE]
    miss = great_circle_distance(*target, *end, radius)
    off = bearing(*target, *end) - nominal.states[AZIMUTH, -1]
    return miss * np.cos(off), miss * np.sin(off)
