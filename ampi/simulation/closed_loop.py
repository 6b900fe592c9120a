"""Closed-loop entries: the flight software in the truth, n flights at once.

Five things of their own: the plant (`plant`), navigation and accelerometer (`sensors`), the flight
software (`Guidance.step`, and nothing else), and the actuator (`actuator`). Sensors are sampled and the
flight software is called once per guidance cycle; plant and actuator advance in equal parts of it, of at
most `PlantSettings.step`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.correction.corrector import CorrectionOutcome
from ampi.guidance import Guidance
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.onboard.command import Command
from ampi.physics.state import ALTITUDE, BANK, ENTRY_STATES, N_STATES
from ampi.simulation.actuator import Actuator
from ampi.simulation.plant import ANGLE, PLANT, RATE, InFlight, Plant
from ampi.simulation.sensors import Sensors
from ampi.simulation.truth import Truth

Array = NDArray[np.float64]

# told of every cycle once its commands are made: its time (s), and the guidance, to be read alone
Observer = Callable[[float, Guidance], None]

AT_LIMIT = 1e-3  # of a limit: a control that is nearer counts as saturated


@dataclass(frozen=True, eq=False)
class FlightBatch:
    """Flights of one batch; n flights, k recorded points (NaN after a flight's end)."""

    final_states: Array  # (n, 7)
    final_time: Array  # (n,), s
    status: NDArray[np.int64]  # (n,), FlightStatus
    clipped: NDArray[np.bool_]  # (n,), outside the hypercube
    hole: NDArray[np.bool_]  # (n,), their reference is borrowed from beside an unsolved case
    saturation: Array  # (n,), share of the cycles with bank angle or bank rate at its limit
    activity: Array  # (n,), rad: ∫ |σ̇| dt
    rebound: Array  # (n,), m: highest altitude after the first minimum; NaN if there was none
    corrections: NDArray[np.int64]  # (n, outcomes): how often each CorrectionOutcome has come
    times: Array  # (k,), s
    states: Array  # (n, 7, k)
    reference_states: Array  # (n, 7, k)
    bank_rate: Array  # (n, k), flown, rad/s
    angle_of_attack: Array  # (n, k), as flown, rad: against the schedule, if there is one
    peak: (
        Array  # (n, l): greatest use of each limit of the mission, at every plant step and the end
    )


def fly_batch(
    family: MissionFamily[Mission],
    guidance: Guidance,
    truth: Truth,
    record_every: float = 5.0,
    *,
    observer: Observer | None = None,
) -> FlightBatch:
    """Fly each mission of `family` in closed loop, in the air and with the errors of `truth`.

    Guidance is told the entry states that navigation measures, of all other parameters the true ones.
    """
    with np.errstate(all="ignore"):  # an absurd entry is a record with a status, not a warning
        return _Loop(family, guidance, truth, record_every).flown(observer)


def plant_of(family: MissionFamily[Mission], guidance: Guidance, truth: Truth) -> Plant:
    """The vehicles that `guidance`, begun, steers: their time limit is that of its references."""
    longest = PLANT.longest * guidance.flown.final_time
    return Plant(family, truth, longest, modulated=guidance.modulates)


@dataclass(frozen=True, eq=False)
class Entries:
    """n flights at the entry interface: guidance has begun on what it was told of them."""

    sensors: Sensors
    parameters: Array  # (n, d), as told
    plant: Plant
    flights: InFlight
    steering: Array  # (2, n), which the actuator has been at for long

    @classmethod
    def of(cls, family: MissionFamily[Mission], guidance: Guidance, truth: Truth) -> Entries:
        """Those of a family in the truth; begins `guidance`."""
        radius = family.mission.flight_model.planet.equatorial_radius
        sensors = Sensors(truth, radius, guidance.cycle)
        entry = np.concatenate([family.entry_states.T, np.zeros((2, len(family)))])
        told = sensors.at_entry(entry[:N_STATES], entry[N_STATES])
        parameters = _told(family, truth.parameters, told - entry)
        guidance.begin(parameters)
        plant = plant_of(family, guidance, truth)
        first, layout = guidance.flown.first, guidance.table.layout
        finite = np.all(np.isfinite(truth.parameters), axis=1)
        flights = InFlight.at_entry(plant, first[BANK].copy(), finite)
        row = layout.angle_of_attack
        angle = np.zeros(len(family)) if row is None else first[row]
        steering = np.stack([first[layout.bank_rate], angle])
        return cls(sensors, parameters, plant, flights, steering)


@dataclass(frozen=True)
class Rhythm:
    """How cycles are divided, and which are recorded."""

    cycle: float  # s
    parts: int  # steps of the plant in a cycle
    stride: int  # cycles from record to record

    @classmethod
    def of(cls, cycle: float, record_every: float) -> Rhythm:
        """Records are `record_every` seconds apart, to whole cycles."""
        parts = max(1, int(np.ceil(cycle / PLANT.step - 1e-9)))
        return cls(cycle, parts, max(1, round(record_every / cycle)))


class _Loop:
    """One batch on its way."""

    def __init__(
        self, family: MissionFamily[Mission], guidance: Guidance, truth: Truth, every: float
    ) -> None:
        rhythm = Rhythm.of(guidance.cycle, every)
        self.guidance, self.cycle = guidance, rhythm.cycle
        self.parts, self.stride = rhythm.parts, rhythm.stride
        entries = Entries.of(family, guidance, truth)
        self.sensors, self.plant, self.flights = entries.sensors, entries.plant, entries.flights
        self.actuator = Actuator(truth, self.cycle, entries.steering)
        self.tally = _Tally(len(family), guidance, entries.parameters)
        self.record: list[tuple[float, Array, Array, Array]] = []

    def flown(self, observer: Observer | None = None) -> FlightBatch:
        """All of them, to their ends."""
        step = 0
        while step == 0 or self.flights.flying.any():
            self._cycle(step)
            if observer is not None:
                observer(step * self.cycle, self.guidance)
            step += 1
        times, states, references, steerings = zip(*self.record, strict=True)
        flights, tally, steering = self.flights, self.tally, np.stack(steerings, axis=-1)
        return FlightBatch(
            final_states=flights.final,
            final_time=flights.final_time,
            status=flights.status,
            clipped=self.guidance.flown.clipped.copy(),
            hole=self.guidance.flown.hole.copy(),
            saturation=tally.saturated / np.maximum(tally.cycles, 1),
            activity=tally.activity,
            rebound=tally.rebound,
            corrections=corrections_of(self.guidance, len(tally.cycles)),
            times=np.array(times),
            states=np.stack(states, axis=2),
            reference_states=np.stack(references, axis=2),
            bank_rate=steering[RATE],
            angle_of_attack=steering[ANGLE],
            peak=flights.peak_at_the_end(self.plant),
        )

    def _cycle(self, step: int) -> None:
        flights, time = self.flights, step * self.cycle
        command = self._command(time)
        if step % self.stride == 0:
            self._note(time)
        self.tally.count(flights, self.actuator.flown[RATE], self.cycle)
        self.actuator.command(np.array([command.bank_rate, command.angle_of_attack]))
        h = self.cycle / self.parts
        for part in range(self.parts):
            old, new = self.actuator.advance(part / self.parts, (part + 1) / self.parts)
            flights.advance(self.plant, old, new, time + part * h, h)

    def _command(self, time: float) -> Command:
        x, steering = self.flights.x, self.actuator.flown
        told, sensed = self.sensors.navigation(x, steering[RATE]), None
        if self.guidance.senses:
            sensed = self.sensors.acceleration(self.plant.acceleration(x, steering, time))
        return self.guidance.step(time, told, sensed)

    def _note(self, time: float) -> None:
        """One record of histories; NaN of what has ended."""
        gone = ~self.flights.flying
        state, reference = self.flights.x.T.copy(), self.guidance.tracked_states.T.copy()
        steering = self.actuator.flown.copy()
        state[gone], reference[gone], steering[:, gone] = np.nan, np.nan, np.nan
        self.record.append((time, state, reference, steering))


def corrections_of(guidance: Guidance, n: int) -> NDArray[np.int64]:
    """How often each outcome of a correction has come (n, outcomes)."""
    if guidance.correction is None:
        return np.zeros((n, len(CorrectionOutcome)), dtype=np.int64)
    return guidance.correction_state.counts.T.copy()


def saturated_from(guidance: Guidance, parameters: Array) -> tuple[Any, Any]:
    """Bank angle (rad) and bank rate (rad/s) from which a control counts as saturated."""
    limits = guidance.limits_at(parameters)
    return (1.0 - AT_LIMIT) * limits.angle, (1.0 - AT_LIMIT) * limits.rate


class _Tally:
    """What is counted along n flights."""

    def __init__(self, n: int, guidance: Guidance, parameters: Array) -> None:
        self._angle, self._rate = saturated_from(guidance, parameters)
        self.cycles, self.saturated = np.zeros(n), np.zeros(n)
        self.activity, self.rebound = np.zeros(n), np.full(n, np.nan)
        self._before, self._descended = np.full(n, -np.inf), np.zeros(n, dtype=bool)

    def count(self, flights: InFlight, rate: Array, cycle: float) -> None:
        """One cycle of those that fly."""
        altitude, size, flying = flights.x[ALTITUDE], np.abs(rate), flights.flying
        at_limit = (np.abs(flights.x[BANK]) >= self._angle) | (size >= self._rate)
        self.cycles += flying
        self.saturated += flying & at_limit
        np.add(self.activity, size * cycle, out=self.activity, where=flying)
        rises = flying & self._descended & (altitude > self._before)
        np.fmax(self.rebound, altitude, out=self.rebound, where=rises)
        self._descended |= altitude < self._before
        self._before = altitude


def _told(family: MissionFamily[Mission], parameters: Array, error: Array) -> Array:
    """p (n, d) as it is told: entry states as navigation measures them, `error` (8, n) off."""
    told = parameters.copy()
    for i, parameter in enumerate(family.mission.parameters):
        room, *name = parameter.number.path
        if room == "entry" and name[0] in ENTRY_STATES:
            told[:, i] += error[ENTRY_STATES.index(name[0])]
    return told
