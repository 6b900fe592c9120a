"""The physics of a plant for the compiled engine: traced, and turned into lists of instructions.

One source: the equations of motion, the uses of the mission's limits and the specific force run on
symbols, in the true model of `true_model`. Profiles over altitude are looked up by the engine:
a factor on the density and the wind are inputs. The trace depends on the structure of the model and on
which of its numbers are the same for all flights, never on their values.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi._native.engine import core
from ampi.missions.path_limits import PathLimits
from ampi.physics.equations_of_motion import (
    FlightModel,
    aerodynamic_acceleration,
    equations_of_motion,
)
from ampi.physics.state import N_STATES
from ampi.simulation.plant import Plant
from ampi.simulation.true_model import Profiles, TrueAtmosphere, TrueWind
from ampi.tracing.instruction_list import (
    FLIGHT,
    MOMENT,
    SHARED,
    Assembler,
    InstructionList,
    Program,
)
from ampi.tracing.numbers import put_together, taken_apart
from ampi.tracing.value_graph import Recorder

Array = NDArray[np.float64]

# inputs beside the states: bank rate, (change of) α, its rate, time, density, wind to east and north
MOMENTS = 7
ENTRIES = ((0,), (0, 1), (2,))  # rates; rates and uses; specific force


@dataclass(frozen=True)
class LookedUp:
    """Stands in a traced model for profiles over altitude: what the engine has looked up."""

    values: Any = None

    def __call__(self, altitude: Any) -> Any:
        """It is of the altitude at which the model is evaluated."""
        return self.values


@dataclass(frozen=True, eq=False)
class NativePlant:
    """What the engine needs of a plant of n flights."""

    program: Any  # `_core.Program`
    numbers: Array  # (k, n), of the flights
    profiles: Array  # (n, points, functions): density, then wind to east and north, as there are
    step: float  # m between points
    has_density: bool
    has_wind: bool


def native_plant(plant: Plant) -> NativePlant:
    """The plant of n flights for the compiled engine."""
    model, density, wind = _without_profiles(plant.model)
    structure, numbers = taken_apart((model, plant.limits))
    is_shared = tuple(not isinstance(number, np.ndarray) for number in numbers)
    program = _program(structure, is_shared, plant.modulated)
    own = [number for number, alike in zip(numbers, is_shared, strict=True) if not alike]
    alike = [number for number, alike in zip(numbers, is_shared, strict=True) if alike]
    found = [profile for profile in (density, wind) if profile is not None]
    n = len(plant.truth)
    values = [profile.values for profile in found] or [np.zeros((n, 2, 0))]
    return NativePlant(
        program=_loaded(program, np.array(alike, dtype=float)),
        numbers=np.array(own, dtype=float).reshape(len(own), n),
        profiles=np.ascontiguousarray(np.concatenate(values, axis=-1)),
        step=found[0].step if found else 1.0,
        has_density=density is not None,
        has_wind=wind is not None,
    )


def _without_profiles(model: FlightModel) -> tuple[FlightModel, Profiles | None, Profiles | None]:
    """The model with stand-ins for its profiles; those of the density and of the wind."""
    density = wind = None
    atmosphere: Any = model.atmosphere
    looked_up: Any = LookedUp()
    if isinstance(atmosphere, TrueAtmosphere) and atmosphere.profile is not None:
        density = atmosphere.profile
        model = replace(model, atmosphere=replace(atmosphere, profile=looked_up))
    if isinstance(model.wind, TrueWind):
        wind = model.wind.profile
        model = replace(model, wind=replace(model.wind, profile=looked_up))
    return model, density, wind


@lru_cache(maxsize=32)
def _program(structure: Hashable, is_shared: tuple[bool, ...], modulated: bool) -> Program:
    """Traced once per process, structure and choice of shared numbers."""
    recorder = Recorder()
    x, moment, numbers = (recorder.inputs(k) for k in (N_STATES, MOMENTS, len(is_shared)))
    rate, angle, angle_rate, time, density, east, north = moment
    model: FlightModel
    limits: PathLimits
    model, limits = put_together(structure, iter(numbers))
    model = _with_profiles(model, density, (east, north))
    is_steered = model.vehicle.angle_of_attack is None
    if modulated and not is_steered:
        error = model.angle_of_attack_offset
        model = replace(model, angle_of_attack_offset=angle if error is None else error + angle)
    state = [*x, angle] if is_steered else x
    rates = equations_of_motion(model, state, rate, time)[:N_STATES]
    uses = limits.use(model, state, rate, time, angle_of_attack_rate=angle_rate)
    felt = aerodynamic_acceleration(model, state, time)
    levels = [MOMENT] * (N_STATES + MOMENTS) + [SHARED if one else FLIGHT for one in is_shared]
    graph = recorder.graph([rates, uses, felt])
    return Assembler(graph, levels, core().OPCODES).program(ENTRIES)


def _with_profiles(model: FlightModel, density: Any, wind: tuple[Any, Any]) -> FlightModel:
    """The model with symbols where there were stand-ins."""
    atmosphere: Any = model.atmosphere
    if isinstance(atmosphere, TrueAtmosphere) and isinstance(atmosphere.profile, LookedUp):
        looked_up: Any = LookedUp([density])
        model = replace(model, atmosphere=replace(atmosphere, profile=looked_up))
    if isinstance(model.wind, TrueWind):
        blowing: Any = LookedUp(wind)
        model = replace(model, wind=replace(model.wind, profile=blowing))
    return model


def _loaded(program: Program, shared: Array) -> Any:
    """The program in the engine, with these numbers that are the same for all flights."""
    places = np.array(program.inputs[N_STATES + MOMENTS :], dtype=np.uint16)
    lists = (program.begin, *program.entries)
    return core().Program(
        program.places, scalars_of(program, shared), places, *(_pair(one) for one in lists)
    )


def scalars_of(program: Program, shared: Array) -> Array:
    """The scalars of a program: computed by the engine, as they would be for one flight."""
    own = program.shared
    inputs = np.concatenate([shared, np.array(program.constants, dtype=float)])
    places = int(max(own.code[:, 1:3].max(initial=0), len(inputs))) + 1
    found = np.empty((len(own.outputs), 1))
    core().evaluate(*_pair(own), places, np.zeros(0), inputs, 1, found, "")
    return found[:, 0].copy()


def _pair(one: InstructionList) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    return one.code, np.array(one.outputs, dtype=np.uint16)
