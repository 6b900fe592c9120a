"""What a campaign says besides its flights, and the flights of all its batches as one."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.export.model_blob import model_blob
from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.onboard.reference import Mode
from ampi.simulation.flights import DENSITY, WIND, Flights
from ampi.simulation.flights_schema import FIELDS, FLIGHT, SCALES, TIME
from ampi.simulation.tolerances import Tolerances
from ampi.simulation.world import World
from ampi.tracking.angle_limiter import ANY_ANGLE

Arrays = Mapping[str, NDArray[Any]]


def attributes_of(
    mission: Mission, guidance: Guidance, world: World, seed: int, pool: str
) -> dict[str, Any]:
    """Numbers and words of a campaign (`flights_schema.ATTRIBUTES`)."""
    tolerances, profiles = Tolerances.of(mission.target), world.profiles
    return {
        "mission": mission.name,
        "mission_sha256": mission.digest,
        "guidance_sha256": digest_of(guidance),
        "correction": correction_name(guidance),
        "law": law_name(guidance),
        "mode": guidance.mode.value,
        "world": world.name,
        "world_sha256": world.digest,
        "world_toml": world.toml,
        "drawn": "\n".join(world.in_words(mission)),
        "profiles": " ".join(name for name in (DENSITY, WIND) if name in profiles),
        "seed": int(seed),
        "pool": pool,
        "cycle": guidance.cycle,
        "engine": guidance.engine,
        "position_tolerance": tolerances.position,
        "altitude_tolerance": tolerances.altitude,
        "speed_tolerance": tolerances.speed,
        "entry_altitude": mission.entry.altitude,
    }


def correction_name(guidance: Guidance) -> str:
    """By what its plan is corrected in flight, "none" if it is not."""
    return "none" if guidance.correction is None else guidance.correction.name


def law_name(guidance: Guidance) -> str:
    """The law that tracks; told apart if it changes the angle of attack, too."""
    law = guidance.law
    return f"{law.name}_modulated" if law.modulates else law.name


def digest_of(guidance: Guidance) -> str:
    """SHA-256 of what flies in any mode and at any cycle: table, limits, law, correction."""
    table = guidance.table
    shape = (table.centre, table.circular, guidance.orders)
    words: tuple[Any, ...] = (guidance.law, guidance.limits, guidance.limit_axes, shape)
    if guidance.modulates:
        words = (*words, guidance.modulation, guidance.law.modulates)
    if guidance.angles != ANY_ANGLE:
        words = (*words, guidance.angles)
    arrays = (*table.axes, table.values, table.final_time, table.conversion)
    found = hashlib.sha256(repr(words).encode())
    if guidance.correction is not None:
        found.update(model_blob(guidance.correction))
    for array in (*arrays, *table.high_density_time, table.solved, table.sensitivities):
        if array is not None:
            found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()


def fixed_arrays(mission: Mission) -> dict[str, NDArray[Any]]:
    """Arrays that belong to no flight."""
    return {
        "limit": np.array(PathLimits.of(mission).names, "S20"),
        "radius": np.array(mission.target.judged_radii),
    }


def flights_of(attributes: Mapping[str, Any], fixed: Arrays, batches: Sequence[Arrays]) -> Flights:
    """The batches of a campaign in their order, over the times of the longest."""
    times = max((batch[TIME] for batch in batches), key=len)
    arrays = {
        name: np.concatenate([_padded(name, batch[name], len(times)) for batch in batches])
        for name in batches[0]
        if name != TIME
    }
    arrays = {**arrays, **fixed, TIME: times}
    back = {scale: name for name, scale in SCALES.items()}
    values: dict[str, Any] = {back.get(name, name): array for name, array in arrays.items()}
    values["limits"] = tuple(label.decode() for label in values["limits"])
    return Flights(**{**attributes, "mode": Mode(attributes["mode"]), **values})


def _padded(name: str, values: NDArray[Any], length: int) -> NDArray[Any]:
    """With not-a-number after the end of its batch, if it is a history."""
    dimensions = FIELDS[name].dimensions
    if TIME not in dimensions or FLIGHT not in dimensions:
        return values
    width = [(0, 0)] * (values.ndim - 1) + [(0, length - values.shape[-1])]
    return np.pad(values, width, constant_values=np.nan)
