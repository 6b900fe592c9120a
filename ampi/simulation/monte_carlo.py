"""Monte-Carlo campaigns: many closed-loop entries, the same draws for every guidance mode.

Flights are flown in batches of a fixed size, whatever the number of workers: every flight sees the
same arithmetic, so a campaign's numbers are identical on one core and on many.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ampi.guidance import Guidance
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission, mission_digest
from ampi.onboard.reference import Mode
from ampi.physics.path_constraints import path_constraints
from ampi.physics.planet import great_circle_distance
from ampi.simulation.closed_loop import FlightBatch, FlightStatus, fly_batch
from ampi.simulation.dispersions import Dispersions

Array = NDArray[np.float64]

BATCH = 100  # flights; fixed, or the last bits would depend on the number of workers


@dataclass(frozen=True, eq=False)
class Flights:
    """A campaign in one guidance mode: n flights, k recorded points (NaN after a flight's end)."""

    mission: str
    mission_sha256: str
    mode: Mode
    seed: int
    distribution: str
    parameters: Array  # (n, d), as drawn; SI, rad
    clipped: NDArray[np.bool_]  # (n,), outside the hypercube
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
    path: Array  # (n, 3, k): q, Q̇, n_z over their limits
    peak: Array  # (n, 3): their greatest values, read at every guidance cycle

    @property
    def n(self) -> int:
        """Number of flights."""
        return len(self.miss)

    @property
    def reached(self) -> NDArray[np.bool_]:
        """Flights that ended at the target speed; the others count as outside every circle."""
        return self.status == int(FlightStatus.REACHED_SPEED)


def save_campaigns(path: str | Path, campaigns: Mapping[str, Flights]) -> None:
    """Write campaigns (mode → flights) as one compressed .npz."""
    packed: dict[str, Any] = {}
    for name, flights in campaigns.items():
        for key, value in vars(flights).items():
            packed[f"{name}/{key}"] = value.value if isinstance(value, Mode) else value
    path = Path(path).resolve()  # a link stays one
    temporary = path.with_name(path.name + ".tmp")
    with temporary.open("wb") as file:
        np.savez_compressed(file, **packed)
    temporary.replace(path)


def load_campaigns(path: str | Path) -> dict[str, Flights]:
    """Read what `save_campaigns` wrote."""
    found: dict[str, dict[str, Any]] = {}
    try:
        with Path(path).open("rb") as file, np.load(file) as packed:
            for key in packed.files:
                name, _, part = key.partition("/")
                value = packed[key]
                found.setdefault(name, {})[part] = value if value.ndim else value.item()
        return {
            name: Flights(**{**parts, "mode": Mode(parts["mode"])}) for name, parts in found.items()
        }
    except (BadZipFile, EOFError, KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"{path}: not a whole file of flights ({error}); make one with: ampi fly --output"
        ) from None


def fly(
    mission: Mission,
    guidance: Guidance,
    dispersions: Dispersions | None = None,
    n: int = 1000,
    *,
    seed: int = 2016,
    n_jobs: int = 2,
    record_every: float = 5.0,
    advance: Callable[[int], None] | None = None,
) -> Flights:
    """Fly `n` dispersed entries in closed loop.

    Parameters
    ----------
    mission
        From `load_mission`.
    guidance
        From `load_guidance`; `guidance.in_mode(...)` flies the same table in another mode.
    dispersions
        None: those of the mission's grid, normal with 3σ at its edge (Eq. (34)).
    n, seed
        Flights, and the seed of the campaign's SeedSequence.
    n_jobs
        Worker processes; the result does not depend on it.
    record_every
        Seconds between the recorded points of the histories.
    advance
        Called with the number of flights just flown.

    Returns
    -------
    Flights
        Every flight, those that failed included with their status.
    """
    if guidance.mission_sha256 not in (None, mission_digest(mission)):
        raise ValueError(
            f"guidance: its database was built for another mission than {mission.name}; "
            "fly the mission of the database (read_dataset(path).mission), or build it anew"
        )
    dispersions = dispersions or Dispersions.from_mission(mission)
    draws = dispersions.draw(mission, n, seed)
    chunks = [draws[i : i + BATCH] for i in range(0, n, BATCH)]
    batches: list[FlightBatch] = []
    with Parallel(n_jobs=min(n_jobs, len(chunks)), return_as="generator") as pool:
        tasks = (delayed(_fly_chunk)(mission, guidance, c, record_every) for c in chunks)
        for chunk, batch in zip(chunks, pool(tasks), strict=True):
            batches.append(batch)
            if advance is not None:
                advance(len(chunk))
    return _assemble(mission, guidance, dispersions, seed, draws, batches)


def _fly_chunk(
    mission: Mission, guidance: Guidance, draws: Array, record_every: float
) -> FlightBatch:
    with threadpool_limits(limits=1):
        return fly_batch(mission.family(draws), guidance, draws, record_every)


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
    family = mission.family(draws)
    radius = family.flight_model().planet.equatorial_radius
    along, across = _track_frame(mission, family, guidance, final, radius)
    values = path_constraints(family.flight_model(trailing=1), states.transpose(1, 0, 2), times)
    return Flights(
        mission=mission.name,
        mission_sha256=mission_digest(mission),
        mode=guidance.mode,
        seed=seed,
        distribution=dispersions.distribution.value,
        parameters=draws,
        clipped=np.concatenate([b.clipped for b in batches]),
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
        bank_rate=joined([b.bank_rate for b in batches]),
        path=np.stack(values, axis=1) / family.limits[:, :, None],
        peak=np.concatenate([b.peak for b in batches]) / family.limits,
    )


def _track_frame(
    mission: Mission, family: MissionFamily, guidance: Guidance, final: Array, radius: Any
) -> tuple[Array, Array]:
    """Miss (m) along and across the nominal final azimuth, on the tangent plane at the target."""
    nominal = guidance.in_mode(Mode.NOMINAL).reference(mission.nominal_parameters)
    azimuth = float(nominal.states[5, -1])
    longitude, latitude = family.target("longitude"), family.target("latitude")
    north = radius * (final[:, 2] - latitude)
    east = radius * np.cos(latitude) * (final[:, 1] - longitude)
    along = north * np.cos(azimuth) + east * np.sin(azimuth)
    return along, east * np.cos(azimuth) - north * np.sin(azimuth)
