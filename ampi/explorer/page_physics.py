"""The plant of the page: the equations of motion, traced and written as JavaScript.

One source: what the solver linearises and campaigns fly runs on symbols here, too. Inputs of the two
functions, in one row:

    h, θ, φ, V, γ, ψ, σ;  σ̇, δα, t;  factors of density, lift and drag, wind to east and north;  numbers

The numbers of the mission, its entry state and its target follow the parameters of the table,

    n(p) = n_0 + G (p − p_0),                                                                      (1)

which holds for every number of a mission file; a model in which it does not is refused.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.export.javascript import javascript
from ampi.missions.mission import Mission
from ampi.physics.equations_of_motion import (
    FlightModel,
    aerodynamic_acceleration,
    equations_of_motion,
)
from ampi.physics.state import N_STATES
from ampi.simulation.true_model import TrueAtmosphere
from ampi.tracing.numbers import put_together, taken_apart
from ampi.tracing.value_graph import Recorder

Array = NDArray[np.float64]

MOMENTS, WORLD = 3, 5  # bank rate, change of the angle of attack, time; what a wrong model has
TARGET = ("altitude", "longitude", "latitude", "speed")
AFFINE = 1e-9  # of a number's size: Eq. (1) holds


@dataclass(frozen=True)
class UniformWind:
    """The same at every altitude, m/s."""

    east: Any
    north: Any

    def components(self, altitude: Any) -> tuple[Any, Any]:
        """To east and north."""
        return self.east, self.north


@dataclass(frozen=True, eq=False)
class PagePhysics:
    """What the page needs to fly."""

    source: (
        str  # functions `rates(i, o)` and `loads(i, o)`: specific force, then uses of the limits
    )
    base: Array  # n_0 of Eq. (1): entry state (6), target (4), numbers
    slope: Array  # (numbers, d): G

    @classmethod
    def of(cls, mission: Mission) -> PagePhysics:
        """Of a mission.

        Raises
        ------
        ValueError
            If a number does not follow Eq. (1).
        """
        nominal = mission.nominal_parameters
        reach = np.array([np.ptp(axis) for axis in mission.grid_axes])
        moved = nominal + np.concatenate([np.zeros((1, len(reach))), np.diag(reach), [reach]])
        structure, found = _numbers(mission, moved)
        slope = (found[1:-1] - found[0]).T / reach
        if np.any(np.abs(found[0] + slope @ reach - found[-1]) > AFFINE * (1.0 + np.abs(found[0]))):
            raise ValueError(
                f"{mission.name}: expected numbers that move with one parameter each, got a product"
            )
        return cls(_source(structure, found.shape[1] - BEFORE), found[0], slope)


BEFORE = 6 + len(TARGET)


def _numbers(mission: Mission, parameters: Array) -> tuple[Any, Array]:
    """Structure of the model, and entry state, target and numbers of every member, (n, k)."""
    family = mission.family(parameters)
    structure, numbers = taken_apart((family.flight_model(), family.path_limits()))
    columns = [*family.entry_states.T, *map(family.target, TARGET), *numbers]
    return structure, np.stack([np.broadcast_to(c, len(parameters)) for c in columns], axis=1)


def _source(structure: Any, count: int) -> str:
    recorder = Recorder()
    x, moment, world, numbers = (recorder.inputs(k) for k in (N_STATES, MOMENTS, WORLD, count))
    model, limits = put_together(structure, iter(numbers))
    rate, _, time = moment
    model = _in_world(model, world, moment[1])
    rates = equations_of_motion(model, x, rate, time)
    felt = aerodynamic_acceleration(model, x, time)
    uses = limits.use(model, x, rate, time)
    graph = recorder.graph([rates, felt, uses])
    return javascript(graph, "rates", [0]) + javascript(graph, "loads", [1, 2])


def _in_world(model: FlightModel, world: list[Any], angle: Any) -> FlightModel:
    """The model as it is in a world that differs."""
    density, lift, drag, east, north = world
    vehicle = copy(model.vehicle)  # as `put_together`: symbols cannot be checked
    for name, factor in (("lift_factor", lift), ("drag_factor", drag)):
        object.__setattr__(vehicle, name, getattr(vehicle, name) * factor)
    return replace(
        model,
        atmosphere=TrueAtmosphere(model.atmosphere, density, None),
        vehicle=vehicle,
        wind=UniformWind(east, north),
        angle_of_attack_offset=angle,
    )
