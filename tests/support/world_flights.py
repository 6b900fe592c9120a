"""Flights that differ from the nominal one in one number of the world each, flown in one batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.onboard.command import Command
from ampi.physics.equations_of_motion import FlightModel
from ampi.physics.planet import great_circle_distance
from ampi.simulation.closed_loop import FlightBatch, fly_batch
from ampi.simulation.plant import FlightStatus
from ampi.simulation.profiles import ALTITUDES
from ampi.simulation.truth import Truth
from ampi.simulation.uncertainties import BY_NAME
from ampi.simulation.world_loading import parse_world

Array = NDArray[np.float64]

MANY = 12  # flights of a case where chance decides


@dataclass(frozen=True)
class Flown:
    """Flights of several worlds, by the name of their case."""

    batch: FlightBatch
    place: dict[str, slice]
    steering: Array  # (cycles, n)
    model: FlightModel

    def of(self, case: str) -> FlightBatch:
        """Its flights alone."""
        one = self.place[case]
        parts = {
            name: value if name == "times" else value[one]
            for name, value in vars(self.batch).items()
        }
        return FlightBatch(**parts)

    def energy(self, case: str) -> Array:
        """Specific energy (n, k)."""
        states, planet = self.of(case).states, self.model.planet
        radius = planet.equatorial_radius + states[:, 0]
        return np.asarray(0.5 * states[:, 3] ** 2 - planet.gravitational_parameter / radius)

    def range(self, case: str) -> Array:
        """Metres over the ground from the entry to the end (n,)."""
        batch, radius = self.of(case), self.model.planet.equatorial_radius
        entry, final = batch.states[:, :, 0], batch.final_states
        return np.asarray(great_circle_distance(*entry[:, 1:3].T, *final[:, 1:3].T, radius))

    def moved(self, case: str) -> tuple[Array, Array]:
        """(east, north) in m of the end against the nominal one."""
        end, nominal = self.of(case).final_states, self.of("nominal").final_states
        radius, difference = self.model.planet.equatorial_radius, end - nominal
        return radius * np.cos(nominal[0, 2]) * difference[:, 1], radius * difference[:, 2]


def world(numbers: dict[str, float]) -> str:
    """The text of a world that differs in these numbers (SI) alone."""
    lines = ['name = "one"', 'title = ""', 'entry.distribution = "none"']
    for name, value in numbers.items():
        uncertainty = BY_NAME[name]
        key = uncertainty.keys[0]
        lines.append(f"{uncertainty.section}.{key} = {value / uncertainty.per_unit(key)!r}")
    return "\n".join(lines)


def truth_of(mission: Mission, numbers: dict[str, float], n: int) -> Truth:
    """Drawn, and with neutral profiles where the world has none: all fly in one batch."""
    truth = parse_world(world(numbers)).draw(mission, n, 2016)
    shape = (n, len(ALTITUDES))
    return replace(
        truth,
        density=np.ones(shape) if truth.density is None else truth.density,
        wind=np.zeros((2, *shape)) if truth.wind is None else truth.wind,
    )


def joined(truths: Sequence[Truth]) -> Truth:
    """Of all, which have the same profiles."""
    first = truths[0]
    return Truth(
        np.concatenate([one.parameters for one in truths]),
        {name: np.concatenate([one.numbers[name] for one in truths]) for name in first.numbers},
        first.altitudes,
        np.concatenate([one.density for one in truths if one.density is not None]),
        np.concatenate([one.wind for one in truths if one.wind is not None], axis=1),
        np.concatenate([one.seeds for one in truths]),
    )


def flown(mission: Mission, guidance: Guidance, cases: dict[str, dict[str, float]]) -> Flown:
    """The nominal flight and all cases; where chance decides, many flights of a case."""
    truths, place, begin = [], {}, 0
    for name, numbers in {"nominal": {}, **cases}.items():
        n = MANY if any(key.endswith(("noise", "dropout")) for key in numbers) else 1
        truths.append(truth_of(mission, numbers, n))
        place[name] = slice(begin, begin + n)
        begin += n
    truth, steering = joined(truths), []
    original = Guidance.step

    def step(self: Guidance, *told: Any) -> Command:
        command = original(self, *told)
        steering.append(command.steering)
        return command

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Guidance, "step", step)
        family = mission.family(truth.parameters)
        batch = fly_batch(family, guidance, truth, record_every=guidance.cycle)
    assert set(batch.status.tolist()) == {int(FlightStatus.REACHED_SPEED)}
    return Flown(batch, place, np.array(steering), mission.flight_model)
