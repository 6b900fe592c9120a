"""Monte-Carlo campaigns: many closed-loop entries of several schemes, each on the same draws.

A scheme is a guidance (table, reference, law) in a world. Flights are drawn and flown in batches of a
fixed size, and each flight sees the same arithmetic, alone and in company: a campaign's numbers are the
same on one core and on many, and flight i is flown again from the seed and i.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import UnionType
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.simulation.batches import MODULE, Batch, Watch
from ampi.simulation.campaign_records import CampaignRecords, Heading, is_flown
from ampi.simulation.closed_loop import Observer
from ampi.simulation.estimates.stopping import StopRule
from ampi.simulation.flights import Flights
from ampi.simulation.flights_file import load_campaigns
from ampi.simulation.flights_schema import ATTRIBUTES
from ampi.simulation.headings import attributes_of, digest_of, fixed_arrays, flights_of
from ampi.simulation.outcomes import flown
from ampi.simulation.uniform_numbers import require_count, require_whole
from ampi.simulation.world import World
from ampi.simulation.world_loading import load_world
from ampi.workers.in_order import in_workers
from ampi.workers.supervisor import require_workers

Arrays = dict[str, NDArray[Any]]

SOURCES = {  # of what `fly` takes
    "mission": "a mission, from ampi.load_mission(name)",
    "guidance": "guidance, from ampi.load_guidance(path)",
    "schemes": "an ampi.Scheme by each name",
    "world": "a world, its name or the path of its file",
    "stop": "an ampi.StopRule, or None to fly all",
}
BATCH = 128  # flights, two blocks of the native engine; fixed, whatever the number of workers


class CampaignOptions(TypedDict, total=False):
    """Of `fly` and `fly_schemes`, all with a default (`DEFAULTS`)."""

    seed: int  # of the campaign's draws
    pool: str  # "reported", or "tuning", whose draws are others
    cycle: float  # s, of guidance
    engine: str  # "native", "numpy", or "auto": native where it is built; they agree to 1e-6 m
    record_every: float  # s between the recorded points, rounded to guidance cycles
    stop: StopRule | None  # None: all flights; else as soon as a share is known well enough
    output: str | Path | None  # HDF5 file that the flights stream to; None: they stay in memory
    resume: bool  # go on from what an earlier run for `output` has kept, or find the file whole
    n_jobs: int  # worker processes; the result does not depend on it
    client: Any  # a distributed.Client: its workers instead
    advance: Callable[[int], None] | None  # called with the number of flights just flown


DEFAULTS = CampaignOptions(
    seed=2016,
    pool="reported",
    cycle=0.1,
    engine="auto",
    record_every=5.0,
    stop=None,
    output=None,
    resume=True,
    n_jobs=2,
    client=None,
    advance=None,
)


@dataclass(frozen=True, eq=False)
class Scheme:
    """What is judged: a guidance, and the world that it flies in (a World, its name or its file)."""

    guidance: Guidance
    world: World | str | Path = "entry"

    @cached_property
    def loaded_world(self) -> World:
        """The world itself."""
        return self.world if isinstance(self.world, World) else load_world(self.world)


def fly(
    mission: Mission,
    guidance: Guidance,
    world: World | str | Path = "entry",
    n: int = 1000,
    **options: Unpack[CampaignOptions],
) -> Flights:
    """Fly `n` entries of one scheme in closed loop.

    Parameters
    ----------
    mission
        From `load_mission`: what the flight software believes.
    guidance
        From `load_guidance`; `guidance.in_mode(...)` flies the same table in another mode.
    world
        What is true: of `load_world`, or the name or path of one. "entry" disperses the parameters of
        the mission's grid alone, normally about the nominal with 3σ at its edge (Eq. (34)).
    n
        Flights.
    options
        See `CampaignOptions`.

    Returns
    -------
    Flights
        Every flight, those that failed included with their status.

    Raises
    ------
    ValueError
        If an argument cannot be what it says, or a world cannot be flown by this mission.
    CampaignError
        If a campaign for a file cannot start or go on; what is flown stays.
    JobError
        If the worker processes die time and again.
    """
    scheme = Scheme(guidance, world)
    return next(iter(fly_schemes(mission, {"flights": scheme}, n, **options).values()))


def fly_schemes(
    mission: Mission,
    schemes: Mapping[str, Scheme],
    n: int = 1000,
    **options: Unpack[CampaignOptions],
) -> dict[str, Flights]:
    """`fly` for several schemes by name, on the same draws and by the same worker processes."""
    plan = _Plan.of(mission, schemes, n, options)
    output, resume = plan.options["output"], plan.options["resume"]
    if output is None:
        return plan.in_memory()
    if not (resume and is_flown(output, plan.identity)):
        plan.to_file(Path(output), resume=resume)
    return load_campaigns(output)


def fly_again(
    mission: Mission,
    guidance: Guidance,
    case: int,
    flights: Flights,
    *,
    observer: Observer | None = None,
) -> Flights:
    """Flight `case` of a campaign from its own record, with every guidance cycle recorded.

    It is the same flight to the bit: what was true of it stands in its record, as do mode, cycle and
    engine, so nothing is drawn and no world is read.

    Raises
    ------
    ValueError
        If there is no such flight, it was flown with another table, other limits or another law, or by
        an engine that is not here.
    """
    is_number = isinstance(case, int | np.integer) and not isinstance(case, bool)
    if not (is_number and 0 <= case < flights.n):
        raise ValueError(f"case: expected a flight from 0 to {flights.n - 1}, got {case!r}")
    if (mission.digest, digest_of(guidance)) != (flights.mission_sha256, flights.guidance_sha256):
        raise ValueError(
            f"flights: expected those of {mission.name} with this guidance, {guidance.law.name}, got "
            f"{flights.law} on {flights.mission}, or another version of it; load the database that "
            "they were flown with"
        )
    own = guidance.in_mode(flights.mode).at_cycle(flights.cycle).on_engine(flights.engine)
    arrays = flown(mission, own, flights.truth_of([case]), flights.cycle, observer=observer)
    attributes = {name: getattr(flights, name) for name in ATTRIBUTES}
    return flights_of(attributes, fixed_arrays(mission), [arrays])


def fly_one(
    mission: Mission,
    scheme: Scheme,
    case: int,
    *,
    observer: Observer | None = None,
    **options: Unpack[CampaignOptions],
) -> Flights:
    """Flight `case` of a campaign as its seed draws it, with every guidance cycle recorded."""
    plan = _Plan.of(mission, {"flight": scheme}, 1, options)
    ready, seed, pool = plan.schemes["flight"], plan.options["seed"], plan.options["pool"]
    require_whole("case", case)
    truth = ready.loaded_world.draw(mission, 1, seed, pool, case)
    own = ready.guidance
    arrays = flown(mission, own, truth, own.cycle, observer=observer)
    told = attributes_of(mission, own, ready.loaded_world, seed, pool)
    return flights_of(told, fixed_arrays(mission), [arrays])


@dataclass(frozen=True, eq=False)
class _Plan:
    """A campaign, checked: what is to be flown, and how."""

    mission: Mission
    schemes: Mapping[str, Scheme]  # at the cycle of the campaign
    n: int
    options: CampaignOptions  # all of them

    @classmethod
    def of(
        cls, mission: Mission, schemes: Mapping[str, Scheme], n: int, options: CampaignOptions
    ) -> _Plan:
        """Refuse what cannot be flown, before any work."""
        unknown = options.keys() - DEFAULTS.keys()
        if unknown:
            raise TypeError(
                f"fly: expected the options {', '.join(DEFAULTS)}, got {', '.join(sorted(unknown))}"
            )
        whole: CampaignOptions = {**DEFAULTS, **options}
        _require("mission", mission, Mission)
        mission.checked()
        require_count(n)
        require_workers(whole["n_jobs"])
        _require("stop", whole["stop"], StopRule | None)
        every = whole["record_every"]
        if not isinstance(every, int | float) or not 0.0 < every < np.inf:
            raise ValueError(f"record_every: expected a positive number of seconds, got {every!r}")
        if not schemes:
            raise ValueError("schemes: expected at least one, got none")
        ready = {name: _ready(mission, scheme, whole) for name, scheme in schemes.items()}
        return cls(mission, ready, n, whole)

    @property
    def identity(self) -> dict[str, str]:
        """All that the numbers depend on, by name."""
        found = {"mission_sha256": self.mission.digest, "flights": str(self.n)}
        found |= {name: str(self.options[name]) for name in ("seed", "pool")}
        found |= {"record_every": str(float(self.options["record_every"]))}
        found |= {"stop": str(self.options["stop"])}
        for name in self.schemes:
            own = self._attributes(name)
            of = ("mode", "cycle", "engine", "guidance_sha256", "world_sha256")
            found[f"scheme {name}"] = " ".join(str(own[key]) for key in of)
        return found

    def in_memory(self) -> dict[str, Flights]:
        """All flights as arrays."""
        found: dict[str, list[Arrays]] = {name: [] for name in self.schemes}
        for name, batch in self._flown(None):
            found[name].append(batch)
        fixed = fixed_arrays(self.mission)
        return {
            name: flights_of(self._attributes(name), fixed, batches)
            for name, batches in found.items()
        }

    def to_file(self, path: Path, *, resume: bool) -> None:
        """All flights in `path`, by way of a record for each batch."""
        with CampaignRecords.open(path, self.identity, resume=resume) as records:
            counts = dict.fromkeys(self.schemes, 0)
            for name, _ in self._flown(records):
                counts[name] += 1
            fixed = fixed_arrays(self.mission)
            records.merge(
                {
                    name: Heading(count, self._attributes(name), fixed)
                    for name, count in counts.items()
                }
            )

    def _flown(self, records: CampaignRecords | None) -> Iterator[tuple[str, Arrays]]:
        """Name and arrays of each batch; the same draws by all schemes before the next ones."""
        watches = {name: Watch(self.options["stop"]) for name in self.schemes}
        notify = self.options["advance"] or (lambda count: None)
        kept = set[tuple[str, int]]() if records is None else self._kept(records)
        run = in_workers if records is None else records.fly
        jobs = self._jobs(records, kept)
        with closing(run(MODULE, jobs, self.options["n_jobs"], self.options["client"])) as results:
            for number in range(self._count):
                for name, watch in watches.items():
                    batch: Any = None if (name, number) in kept else next(results)
                    if records is not None:
                        batch = records.of(name).read(number)
                    watch.see(batch)
                    notify(len(batch["status"]))
                    yield name, batch
                if all(watch.is_enough for watch in watches.values()):
                    return

    def _kept(self, records: CampaignRecords) -> set[tuple[str, int]]:
        """The batches that are flown already."""
        numbers = set(range(self._count))
        return {
            (name, number)
            for name in self.schemes
            for number in numbers - set(records.of(name).missing(self._count))
        }

    def _jobs(self, records: CampaignRecords | None, kept: set[tuple[str, int]]) -> Iterator[Batch]:
        seed, pool = self.options["seed"], self.options["pool"]
        for number in range(self._count):
            first = number * BATCH
            n = min(BATCH, self.n - first)
            for name, scheme in self.schemes.items():
                if (name, number) not in kept:
                    yield Batch(
                        self.mission,
                        scheme.guidance,
                        scheme.loaded_world.draw(self.mission, n, seed, pool, first),
                        self.options["record_every"],
                        f"flights {first} to {first + n - 1} of {name}",
                        number,
                        None if records is None else records.of(name),
                    )

    @property
    def _count(self) -> int:
        """Of batches, at the most."""
        return -(-self.n // BATCH)

    def _attributes(self, name: str) -> dict[str, Any]:
        scheme, options = self.schemes[name], self.options
        return attributes_of(
            self.mission, scheme.guidance, scheme.loaded_world, options["seed"], options["pool"]
        )


def _ready(mission: Mission, scheme: Scheme, options: CampaignOptions) -> Scheme:
    """A scheme of this mission, at the cycle of the campaign and with its world loaded."""
    _require("schemes", scheme, Scheme)
    _require("guidance", scheme.guidance, Guidance)
    _require("world", scheme.world, World | str | Path)
    if scheme.guidance.mission_sha256 not in (None, mission.digest):
        raise ValueError(
            f"guidance: its database was built for another mission than {mission.name}; fly the "
            "mission of the database (read_dataset(path).mission), or build it anew"
        )
    world = scheme.loaded_world.checked(mission)
    world.uniforms(mission, 1, options["seed"], options["pool"])  # refuses seeds and pools
    guidance = scheme.guidance.at_cycle(options["cycle"]).on_engine(options["engine"])
    return Scheme(guidance, world)


def _require(name: str, value: object, kind: type | UnionType) -> None:
    if not isinstance(value, kind):
        raise ValueError(f"{name}: expected {SOURCES[name]}, got {value!r:.60}")
