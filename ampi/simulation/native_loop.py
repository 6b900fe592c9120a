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
from ampi.simulation.closed_loop import Entries, FlightBatch, Rhythm, saturated_from
from ampi.simulation.native_program import native_plant
from ampi.simulation.plant import PLANT, RATE, InFlight, Plant
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
) -> FlightBatch:
    """Fly each mission of `family` in closed loop, as `closed_loop.fly_batch`, in the engine.

    `instruction_set` is the best of this processor, or one by its name; they give the same bits.

    Raises
    ------
    ValueError
        If the engine of `guidance` is another one.
    """
    with np.errstate(all="ignore"):  # an absurd entry is a record with a status, not a warning
        return _Loops(family, guidance, truth, record_every, instruction_set).flown()


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
        self.rhythm, self.entries = (
            Rhythm.of(guidance.cycle, every),
            Entries.of(family, guidance, truth),
        )
        self.code = guidance.compiled  # which has begun
        lanes = core().LANES
        self.blocks = [slice(k, min(k + lanes, len(truth))) for k in range(0, len(truth), lanes)]
        self.loops = self._loops(instruction_set)

    def _loops(self, instruction_set: str) -> list[Any]:
        plant, fixed, settings = native_plant(self.entries.plant), self._fixed(), self._settings()
        return [
            core().Loop(
                plant.program,
                self.code,
                own.start,
                own.stop - own.start,
                settings,
                np.ascontiguousarray(fixed[:, own]),
                np.ascontiguousarray(plant.numbers[:, own]),
                plant.profiles[own],
                plant.step,
                plant.profiles.shape[1],
                plant.has_density,
                plant.has_wind,
                instruction_set,
            )
            for own in self.blocks
        ]

    def flown(self) -> FlightBatch:
        """All of them, to their ends."""
        noise, stride = self.entries.sensors.noise, self.rhythm.stride
        records, cycles, flown, asked = [], 0, 0, 0
        while flown == asked:
            normal, uniform = (None, None) if noise is None else noise.rest()
            asked = BLOCK if uniform is None else uniform.shape[1]
            before, after = _records(cycles, stride), _records(cycles + asked, stride)
            rows = np.full((after - before, core().RECORD_ROWS, len(self.truth)), np.nan)
            flown = max(self._fly(asked, normal, uniform, rows))
            cycles += flown
            records.append(rows[: _records(cycles, stride) - before])
        return self._batch(np.concatenate(records), cycles)

    def _fly(
        self, cycles: int, normal: Array | None, uniform: Array | None, rows: Array
    ) -> Iterator[int]:
        """Every block by so many cycles, with its noise; how many it has flown before its end."""
        for own, loop in zip(self.blocks, self.loops, strict=True):
            noise = (
                None if normal is None else normal[own],
                None if uniform is None else uniform[own],
            )
            room = np.full((*rows.shape[:2], own.stop - own.start), np.nan)
            yield loop.fly(cycles, *noise, room)
            rows[:, :, own] = room

    def _settings(self) -> Array:
        planet = self.entries.plant.family.mission.flight_model.planet
        return _filled(
            core().SETTINGS,
            (),
            cycle=self.rhythm.cycle,
            parts=self.rhythm.parts,
            stride=self.rhythm.stride,
            radius=planet.equatorial_radius,
            speed_tolerance=PLANT.speed_tolerance,
            altitude_tolerance=PLANT.altitude_tolerance,
            search=PLANT.search,
            senses=self.guidance.law.senses,
        )

    def _fixed(self) -> Array:
        entries, numbers, cycle = self.entries, self.truth.numbers, self.rhythm.cycle
        angle, rate = saturated_from(self.guidance, entries.parameters)
        return _filled(
            core().FIXED,
            (len(self.truth),),
            entry=entries.flights.x,
            bank_rate=entries.steering[RATE],
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
        result, peak = self._results(len(plant.limits.names))
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
            times=np.arange(0, cycles, self.rhythm.stride, dtype=float) * self.rhythm.cycle,
            states=np.ascontiguousarray(records[:, STATES].T),
            reference_states=np.ascontiguousarray(records[:, REFERENCE].T),
            bank_rate=np.ascontiguousarray(records[:, BANK_RATE].T),
            angle_of_attack=np.ascontiguousarray(records[:, ANGLE_OF_ATTACK].T),
            peak=flights.peak_at_the_end(plant),
        )

    def _results(self, limits: int) -> tuple[dict[str, Array], Array]:
        """What came of the flights, by name (rows, n), and the peaks (l, n)."""
        table = core().RESULTS
        first = table["peak"][0]
        found = []
        for own, loop in zip(self.blocks, self.loops, strict=True):
            found.append(np.empty((first + limits, own.stop - own.start)))
            loop.results(found[-1])
        whole = np.concatenate(found, axis=1)
        return {name: whole[k : k + rows] for name, (k, rows) in table.items()}, whole[first:]


def fly_held(plant: Plant, flights: InFlight, step: float) -> None:
    """Fly a plant to the ends of its flights with the bank angle held, in steps of `step` (s)."""
    prepared, n, lanes = native_plant(plant), len(flights.flying), core().LANES
    nothing = dict.fromkeys(core().FIXED, 0.0)
    fixed = _filled(
        core().FIXED,
        (n,),
        **nothing
        | {
            "entry": flights.x,
            "flying": flights.flying,
            "target_speed": plant.target_speed,
            "longest": plant.longest,
        },
    )
    settings = _filled(
        core().SETTINGS,
        (),
        cycle=step,
        parts=1,
        stride=UNRECORDED,
        radius=1.0,
        speed_tolerance=PLANT.speed_tolerance,
        altitude_tolerance=PLANT.altitude_tolerance,
        search=PLANT.search,
        senses=0.0,
    )
    table, limits = core().RESULTS, len(plant.limits.names)
    results = np.empty((table["peak"][0] + limits, n))
    for own in (slice(k, min(k + lanes, n)) for k in range(0, n, lanes)):
        count = own.stop - own.start
        loop = core().Loop(
            prepared.program,
            None,
            0,
            count,
            settings,
            np.ascontiguousarray(fixed[:, own]),
            np.ascontiguousarray(prepared.numbers[:, own]),
            prepared.profiles[own],
            prepared.step,
            prepared.profiles.shape[1],
            prepared.has_density,
            prepared.has_wind,
            "",
        )
        room, out = np.empty((1, core().RECORD_ROWS, count)), np.empty((len(results), count))
        loop.fly(UNRECORDED, None, None, room)
        loop.results(out)
        results[:, own] = out
    named = {name: results[k : k + rows] for name, (k, rows) in table.items()}
    _end(flights, named, results[table["peak"][0] :])


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
