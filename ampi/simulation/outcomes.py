"""One batch of a campaign: flown, judged against its targets, and laid out as it is kept."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.physics.planet import bearing, great_circle_distance
from ampi.physics.state import ALTITUDE, AZIMUTH, LATITUDE, LONGITUDE, SPEED
from ampi.simulation.closed_loop import FlightBatch, Observer, plant_of
from ampi.simulation.engines import fly_batch
from ampi.simulation.plant import Plant
from ampi.simulation.profiles import ALTITUDES
from ampi.simulation.reach import ranges
from ampi.simulation.tolerances import Tolerances
from ampi.simulation.truth import Truth

Array = NDArray[np.float64]


def flown(
    mission: Mission,
    guidance: Guidance,
    truth: Truth,
    record_every: float,
    *,
    observer: Observer | None = None,
) -> dict[str, NDArray[Any]]:
    """Every array of the flights of `truth`, by its name in the file of flights."""
    family = mission.family(truth.parameters)
    batch = fly_batch(family, guidance, truth, record_every, observer=observer)
    plant = plant_of(family, guidance, truth)
    arrays = {**_truth(truth), **vars(batch), **_errors(mission, family, guidance, batch)}
    arrays["time"] = arrays.pop("times")
    arrays["path"] = _path(plant, batch)
    faults = Tolerances.of(mission.target).faults(arrays, plant.limits.names)
    missed = np.any(list(faults.values()), axis=0)
    return {**arrays, **_reach(plant, missed, guidance.engine)}


def _truth(truth: Truth) -> dict[str, NDArray[Any]]:
    n, k = len(truth), len(ALTITUDES)
    wind = np.zeros((2, n, k)) if truth.wind is None else truth.wind
    return {
        "numbers": np.stack(list(truth.numbers.values()), axis=1),
        "density": np.ones((n, k)) if truth.density is None else truth.density,
        "wind": np.ascontiguousarray(wind.swapaxes(0, 1)),
        "seeds": truth.seeds,
        "parameters": truth.parameters,
    }


def _errors(
    mission: Mission, family: MissionFamily[Mission], guidance: Guidance, batch: FlightBatch
) -> dict[str, Array]:
    """Against the target, at the end; miss (m) along and across the nominal final azimuth."""
    final, radius = batch.final_states, family.flight_model().planet.equatorial_radius
    target = family.target("longitude"), family.target("latitude")
    end = final[:, LONGITUDE], final[:, LATITUDE]
    miss = great_circle_distance(*target, *end, radius)
    nominal = guidance.in_mode(Mode.NOMINAL).reference(mission.nominal_parameters)
    off = bearing(*target, *end) - nominal.states[AZIMUTH, -1]
    return {
        "miss": miss,
        "along": miss * np.cos(off),
        "across": miss * np.sin(off),
        "altitude_error": final[:, ALTITUDE] - family.target("altitude"),
        "speed_error": final[:, SPEED] - family.target("speed"),
    }


def _path(plant: Plant, batch: FlightBatch) -> Array:
    """Use of each limit (n, l, k) at the recorded points, in the air as it is."""
    steering = np.stack([batch.bank_rate, batch.angle_of_attack])
    with np.errstate(all="ignore"):  # a flight that has ended is not-a-number
        use = [
            plant.use(batch.states[:, :, k].T, steering[:, :, k], time)
            for k, time in enumerate(batch.times)
        ]
    return np.ascontiguousarray(np.stack(use, axis=-1).swapaxes(0, 1))


def _reach(plant: Plant, missed: NDArray[np.bool_], engine: str) -> dict[str, Array]:
    """Distance of the target at entry; least and greatest range, of those that have not passed."""
    family, which = plant.family, np.flatnonzero(missed)
    entry, radius = family.entry_states.T, family.flight_model().planet.equatorial_radius
    target = family.target("longitude"), family.target("latitude")
    distance = great_circle_distance(entry[LONGITUDE], entry[LATITUDE], *target, radius)
    least, greatest = np.full((2, len(family)), np.nan)
    if len(which):
        with np.errstate(all="ignore"):  # an absurd entry has no range
            least[which], greatest[which] = ranges(plant.take(which), engine)
    return {"distance": distance, "least_range": least, "greatest_range": greatest}
