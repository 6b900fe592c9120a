"""The closed loop in the compiled engine: what `closed_loop.fly_batch` does, in C.

The engine flies `LANES` flights abreast, each as if it were alone. Python prepares the entries, draws
the noise of the sensors, a block of samples at a time, and reads the records. Between two blocks it can
be interrupted.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi._native.engine import core
from ampi.guidance import Guidance
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.physics.state import N_STATES
from ampi.simulation.closed_loop import (
    Entries,
    FlightBatch,
    Observer,
    Rhythm,
    corrections_of,
    saturated_from,
)
from ampi.simulation.native_program import native_plant
from ampi.simulation.plant import ANGLE, PLANT, RATE, InFlight, Plant
from ampi.simulation.sensors import BLOCK, NAVIGATED, SENSED
from ampi.simulation.truth import Truth

Array = NDArray[np.float64]
Rows = dict[str, tuple[int, int]]  # first row and rows, by name, as the engine tells them

UNRECORDED = 10**9  # cycles to the next record: none is wanted
STATES, REFERENCE = slice(0, N_STATES), slice(N_STATES, 2 * N_STATES)  # of a record
BANK_RATE, ANGLE_OF_ATTACK = 2 * N_STATES, 2 * N_STATES + 1


def fly_batch(
    family: MissionFamily[Mission],
    guidance: Guidance,
    truth: Truth,
    record_every: float = 5.0,
    instruction_set: str = "",
    *,
    observer: Observer | None = None,
) -> FlightBatch:
    """Fly each mission of `family` in closed loop, as `closed_loop.fly_batch`, in the engine.

    `instruction_set` is the best of this processor, or one by its name; they give the same bits. For an
    observer the engine stops after every cycle.

    Raises
    ------
    ValueError
        If the engine of `guidance` is another one.
    """
    with np.errstate(all="ignore"):  # an absurd entry is a record with a status, not a warning
        return _Loops(family, guidance, truth, record_every, instruction_set).flown(observer)


class _Loops:
    """One batch on its way, in blocks of flights that the engine flies abreast."""

    def __init__(
        self,
        family: MissionFamily[Mission],
        guidance: Guidance,
        truth: Truth,
        every: float,
        instruction_set: str,
    ) -> None:
        self.guidance, self.truth = guidance, truth
        self.rhythm = Rhythm.of(guidance.cycle, every)
        self.entries = Entries.of(family, guidance, truth)
        self.blocks = _blocks(len(truth))
        self.loops = _loops(
            self.entries.plant,
            guidance.compiled,  # which has begun
            self._settings(),
            self._fixed(),
            instruction_set,
        )

    def flown(self, observer: Observer | None = None) -> FlightBatch:
        """All of them, to their ends."""
        stride = self.rhythm.stride
        records, cycles = [], 0
        for asked, normal, uniform in self._noise(BLOCK if observer is None else 1):
            before, after = _records(cycles, stride), _records(cycles + asked, stride)
            rows = np.full((after - before, core().RECORD_ROWS, len(self.truth)), np.nan)
            flown = self._fly(asked, normal, uniform, rows)
            if observer is not None and flown:
                observer(cycles * self.rhythm.cycle, self.guidance)
            cycles += flown
            records.append(rows[: _records(cycles, stride) - before])
            if flown < asked:
                break
        return self._batch(np.concatenate(records), cycles)

    def _noise(self, most: int) -> Iterator[tuple[int, Array | None, Array | None]]:
        """So many cycles at the most, and their noise: normal (n, k, 10), uniform (n, k)."""
        noise = self.entries.sensors.noise
        while noise is None:
            yield most, None, None
        while True:
            normal, uniform = noise.rest()
            for k in range(0, uniform.shape[1], most):
                own = normal[:, k : k + most], uniform[:, k : k + most]
                yield own[1].shape[1], *map(np.ascontiguousarray, own)

    def _fly(self, cycles: int, normal: Array | None, uniform: Array | None, rows: Array) -> int:
        """Every block by so many cycles, with its noise; how many the longest has flown."""
        flown = 0
        for own, loop in zip(self.blocks, self.loops, strict=True):
            noise = (
                None if normal is None else normal[own],
                None if uniform is None else uniform[own],
            )
            room = np.full((*rows.shape[:2], own.stop - own.start), np.nan)
            flown = max(flown, loop.fly(cycles, *noise, room))
            rows[:, :, own] = room
        return flown

    def _settings(self) -> Array:
        planet, rhythm = self.entries.plant.family.mission.flight_model.planet, self.rhythm
        return _settings(
            cycle=rhythm.cycle,
            parts=rhythm.parts,
            stride=rhythm.stride,
            radius=planet.equatorial_radius,
            senses=self.guidance.senses,
        )

    def _fixed(self) -> Array:
        entries, numbers, cycle = self.entries, self.truth.numbers, self.rhythm.cycle
        angle, rate = saturated_from(self.guidance, entries.parameters)
        return _filled(
            core().FIXED,
            (len(self.truth),),
            entry=entries.flights.x,
            bank_rate=entries.steering[RATE],
            angle_of_attack=entries.steering[ANGLE],
            flying=entries.flights.flying,
            target_speed=entries.plant.target_speed,
            longest=entries.plant.longest,
            navigation_bias=[numbers[f"navigation_{name}_bias"] for name in NAVIGATED],
            navigation_noise=[numbers[f"navigation_{name}_noise"] for name in NAVIGATED],
            navigation_latency=numbers["navigation_latency"] / cycle,
            navigation_dropout=numbers["navigation_dropout"],
            accelerometer_bias=[numbers[f"accelerometer_{name}_bias"] for name in SENSED],
            accelerometer_noise=numbers["accelerometer_noise"],
            accelerometer_scale=numbers["accelerometer_scale"],
            actuator_delay=numbers["actuator_delay"] / cycle,
            actuator_lag=numbers["actuator_lag"],
            saturated_angle=angle,
            saturated_rate=rate,
        )

    def _batch(self, records: Array, cycles: int) -> FlightBatch:
        flights, plant = self.entries.flights, self.entries.plant
        result, peak = _results(self.loops, len(self.truth), len(plant.limits.names))
        _end(flights, result, peak)
        return FlightBatch(
            final_states=flights.final,
            final_time=flights.final_time,
            status=flights.status,
            clipped=self.guidance.flown.clipped.copy(),
            hole=self.guidance.flown.hole.copy(),
            saturation=result["saturated"][0] / np.maximum(result["cycles"][0], 1),
            activity=result["activity"][0],
            rebound=result["rebound"][0],
            corrections=corrections_of(self.guidance, len(self.truth)),
            times=np.arange(0, cycles, self.rhythm.stride, dtype=float) * self.rhythm.cycle,
            states=np.ascontiguousarray(records[:, STATES].T),
            reference_states=np.ascontiguousarray(records[:, REFERENCE].T),
            bank_rate=np.ascontiguousarray(records[:, BANK_RATE].T),
            angle_of_attack=np.ascontiguousarray(records[:, ANGLE_OF_ATTACK].T),
            peak=flights.peak_at_the_end(plant),
        )


def fly_held(plant: Plant, flights: InFlight, step: float) -> None:
    """Fly a plant to the ends of its flights with the bank angle held, in steps of `step` (s)."""
    own = {
        "entry": flights.x,
        "flying": flights.flying,
        "target_speed": plant.target_speed,
        "longest": plant.longest,
    }
    n = len(flights.flying)
    fixed = _filled(core().FIXED, (n,), **dict.fromkeys(core().FIXED, 0.0) | own)
    settings = _settings(cycle=step, parts=1, stride=UNRECORDED, radius=1.0, senses=False)
    loops = _loops(plant, None, settings, fixed)
    for block, loop in zip(_blocks(n), loops, strict=True):
        loop.fly(
            UNRECORDED, None, None, np.empty((1, core().RECORD_ROWS, block.stop - block.start))
        )
    _end(flights, *_results(loops, n, len(plant.limits.names)))


def _blocks(n: int) -> list[slice]:
    """Of n flights those that are flown abreast."""
    lanes = core().LANES
    return [slice(k, min(k + lanes, n)) for k in range(0, n, lanes)]


def _settings(*, cycle: float, parts: int, stride: int, radius: float, senses: bool) -> Array:
    return _filled(
        core().SETTINGS,
        (),
        cycle=cycle,
        parts=parts,
        stride=stride,
        radius=radius,
        speed_tolerance=PLANT.speed_tolerance,
        altitude_tolerance=PLANT.altitude_tolerance,
        search=PLANT.search,
        senses=senses,
    )


def _loops(
    plant: Plant, code: Any, settings: Array, fixed: Array, instruction_set: str = ""
) -> list[Any]:
    """A loop of the engine for each block; `code` flies them, None: their steering is held."""
    own = native_plant(plant)
    return [
        core().Loop(
            own.program,
            code,
            block.start,
            block.stop - block.start,
            settings,
            np.ascontiguousarray(fixed[:, block]),
            np.ascontiguousarray(own.numbers[:, block]),
            own.profiles[block],
            own.step,
            own.profiles.shape[1],
            own.has_density,
            own.has_wind,
            instruction_set,
        )
        for block in _blocks(fixed.shape[1])
    ]


def _results(loops: list[Any], n: int, limits: int) -> tuple[dict[str, Array], Array]:
    """What came of n flights, by name (rows, n), and the peaks (l, n)."""
    table = core().RESULTS
    first = table["peak"][0]
    whole = np.empty((first + limits, n))
    for block, loop in zip(_blocks(n), loops, strict=True):
        own = np.empty((len(whole), block.stop - block.start))
        loop.results(own)
        whole[:, block] = own
    return {name: whole[k : k + rows] for name, (k, rows) in table.items()}, whole[first:]


def _records(cycles: int, stride: int) -> int:
    """How many of the first cycles are recorded."""
    return -(-cycles // stride)


def _end(flights: InFlight, result: dict[str, Array], peak: Array) -> None:
    """Flights at their ends, as far as they have begun."""
    flew = flights.flying.copy()
    flights.final[flew] = result["final_state"].T[flew]
    flights.final_time[flew] = result["final_time"][0, flew]
    flights.status[flew] = result["status"][0, flew].astype(np.int64)
    flights.last[:, flew] = result["last"][:, flew]
    flights.peak[:], flights.flying[:] = peak, False


def _filled(table: Rows, shape: tuple[int, ...], **values: Any) -> Array:
    """Rows of the engine from values by name: all of them."""
    if set(values) != set(table):
        raise ValueError(f"rows: expected {', '.join(table)}, got {', '.join(values)}")
    found = np.empty((sum(rows for _, rows in table.values()), *shape))
    for name, (first, rows) in table.items():
        found[first : first + rows] = np.asarray(values[name], dtype=float)
    return found
