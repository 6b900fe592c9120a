"""Closed-loop entries, vectorised over flights.

Plant: the equations of motion of ampi/physics, RK4, in equal steps of at most `PlantSettings.step` per
guidance cycle, with the bank rate linear over the cycle. Flight software: the functions of ampi/onboard
and ampi/tracking that `Guidance` calls, here on a batch. A flight ends where its speed reaches the
target speed, at the ground or at its time limit, whichever comes first, and the instant is found in the
step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.missions.family import MissionFamily
from ampi.missions.path_limits import PathLimits
from ampi.onboard.row_layout import RowLayout
from ampi.outcome import Outcome
from ampi.physics.equations_of_motion import FlightModel, equations_of_motion
from ampi.physics.state import ALTITUDE, BANK, N_STATES, SPEED
from ampi.propagation.fixed_step import rk4_step
from ampi.tracking.bank_limiter import bank_on_turn, limited_rate
from ampi.tracking.linear_quadratic import bank_rate_command

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PlantSettings:
    """How finely the truth is integrated, and for how long."""

    step: float = 0.5  # s, at most; equal parts of the guidance cycle
    longest: float = 2.0  # final times of the reference: then a flight is a record, not a hang
    speed_tolerance: float = 1e-5  # m/s, of the instant at which a flight ends
    altitude_tolerance: float = 1e-4  # m
    search: int = 150  # steps to find it at the most: secants within a bracket, and bisections

    def tolerance(self, row: int) -> float:
        """Of the state that ends a flight."""
        return self.speed_tolerance if row == SPEED else self.altitude_tolerance


PLANT = PlantSettings()


class FlightStatus(Outcome):
    """How a flight ended."""

    REACHED_SPEED = 0, "The flight reached the target speed."
    GROUND = 1, "The flight met the ground before it reached the target speed."
    TIME_LIMIT = 2, "The flight took twice as long as its reference."
    NOT_FINITE = 3, "Its state or its parameters were no numbers."
    STARTED_SLOW = 4, "It entered no faster than the target speed."


@dataclass(frozen=True, eq=False)
class FlightBatch:
    """Flights of one batch; n flights, k recorded points (NaN after a flight's end)."""

    final_states: Array  # (n, 7)
    final_time: Array  # (n,), s
    status: NDArray[np.int64]  # (n,), FlightStatus
    clipped: NDArray[np.bool_]  # (n,), outside the hypercube
    hole: NDArray[np.bool_]  # (n,), their reference is borrowed from beside an unsolved case
    times: Array  # (k,), s
    states: Array  # (n, 7, k)
    reference_states: Array  # (n, 7, k)
    bank_rate: Array  # (n, k), flown, rad/s
    peak: (
        Array  # (n, l): greatest use of each limit of the mission, at every plant step and the end
    )

    @classmethod
    def joined(cls, batches: Sequence[FlightBatch]) -> FlightBatch:
        """Batches as one, over the times of the longest."""
        times = max((batch.times for batch in batches), key=len)

        def stacked(name: str) -> NDArray[Any]:
            arrays = [getattr(batch, name) for batch in batches]
            if name in ("states", "reference_states", "bank_rate"):
                missing = [
                    [(0, 0)] * (a.ndim - 1) + [(0, len(times) - a.shape[-1])] for a in arrays
                ]
                pairs = zip(arrays, missing, strict=True)
                arrays = [np.pad(a, width, constant_values=np.nan) for a, width in pairs]
            return np.concatenate(arrays)

        names = [field.name for field in fields(cls) if field.name != "times"]
        return cls(times=times, **{name: stacked(name) for name in names})


@dataclass(frozen=True, eq=False)
class _StackedReferences:
    """References of n flights: times (n, m), rows (n, r, m)."""

    times: Array
    rows: Array
    layout: RowLayout
    final_time: Array
    clipped: NDArray[np.bool_]
    hole: NDArray[np.bool_]

    @classmethod
    def of(cls, guidance: Guidance, parameters: Array) -> _StackedReferences:
        n, m, layout = len(parameters), guidance.table.conversion.shape[1], guidance.table.layout
        times, rows, final = np.empty((n, m)), np.empty((n, len(layout), m)), np.empty(n)
        clipped, hole = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
        for i, measured in enumerate(parameters):
            r = guidance.reference(measured)
            times[i], rows[i], final[i] = r.times, r.rows, r.final_time
            clipped[i], hole[i] = not r.inside, r.hole
        return cls(times, rows, layout, final, clipped, hole)


def fly_batch(
    family: MissionFamily, guidance: Guidance, parameters: Array, record_every: float = 5.0
) -> FlightBatch:
    """Fly each mission of `family` in closed loop; guidance is told p = `parameters` (n, d)."""
    with np.errstate(all="ignore"):  # an absurd entry is a record with a status, not a warning
        return _fly(family, guidance, parameters, record_every)


def _fly(
    family: MissionFamily, guidance: Guidance, parameters: Array, record_every: float
) -> FlightBatch:
    cycle, references = guidance.cycle, _StackedReferences.of(guidance, parameters)
    limits, path_limits = guidance.limits_at(parameters), family.path_limits()
    plant = _Plant(
        family, path_limits, family.target("speed"), PLANT.longest * references.final_time
    )
    flights = _InFlight.at_entry(family, parameters, references, plant)
    pointer = np.zeros(len(parameters), dtype=np.intp)
    parts = max(1, int(np.ceil(cycle / PLANT.step - 1e-9)))
    stride, h = max(1, round(record_every / cycle)), cycle / parts
    record: list[tuple[float, Array, Array, Array]] = []
    step = 0
    while step == 0 or flights.flying.any():
        time, x, rate = step * cycle, flights.x, flights.rate
        at, own_rate, gain = _look_up(references, pointer, time)
        told = x.copy()
        told[BANK] = bank_on_turn(limits, x[BANK], at[BANK])
        tracked = bank_rate_command(told, at, own_rate, gain)
        wanted = np.where(guidance.table.envelope.holds(x), tracked, own_rate)
        wanted = np.where(time >= references.final_time, 0.0, wanted)
        if step % stride == 0:
            record.append(_snapshot(time, x, at, rate, flights.flying))
        shortest = guidance.first_cycle[0] if step == 0 else cycle
        reached = limited_rate(limits, told[BANK], rate, wanted, cycle, shortest)
        for part in range(parts):
            old = _between(rate, reached, part / parts)
            new = _between(rate, reached, (part + 1) / parts)
            flights.advance(plant, old, new, time + part * h, h)
        flights.rate = np.where(flights.flying, reached, flights.rate)
        step += 1
    times, states, reference_states, rates = zip(*record, strict=True)
    return FlightBatch(
        final_states=flights.final,
        final_time=flights.final_time,
        status=flights.status,
        clipped=references.clipped,
        hole=references.hole,
        times=np.array(times),
        states=np.stack(states, axis=2),
        reference_states=np.stack(reference_states, axis=2),
        bank_rate=np.stack(rates, axis=1),
        peak=flights.peak_at_the_end(plant),
    )


@dataclass(frozen=True, eq=False)
class _Plant:
    """The vehicles of n flights, and what ends them."""

    family: MissionFamily
    limits: PathLimits
    target_speed: Array  # (n,), m/s
    longest: Array  # (n,), s

    @cached_property
    def model(self) -> FlightModel:
        """Of all flights."""
        return self.family.flight_model()

    def use(self, x: Array, rate: Array, time: Any) -> Array:
        """Use of each limit (l, n)."""
        return np.stack(self.limits.use(self.model, x, rate, time))


@dataclass(eq=False)
class _InFlight:
    """n flights on their way: where they are, and how those ended that have."""

    x: Array  # (7, n)
    rate: Array  # (n,), rad/s
    flying: NDArray[np.bool_]  # (n,)
    final: Array  # (n, 7)
    final_time: Array  # (n,), s
    status: NDArray[np.int64]  # (n,)
    peak: Array  # (l, n)

    @classmethod
    def at_entry(
        cls,
        family: MissionFamily,
        parameters: Array,
        references: _StackedReferences,
        plant: _Plant,
    ) -> _InFlight:
        """On the bank angles and rates of their references."""
        n, entry, first = len(parameters), family.entry_states, references.rows[..., 0]
        x = np.concatenate([entry.T, first[:, BANK][None, :]])
        finite = np.all(np.isfinite(parameters), axis=1) & np.all(np.isfinite(entry), axis=1)
        flying = finite & (entry[:, SPEED] > plant.target_speed)
        slow = finite & ~flying
        final, final_time = np.full((n, N_STATES), np.nan), np.full(n, np.nan)
        final[slow], final_time[slow] = x[:, slow].T, 0.0
        status = np.full(n, int(FlightStatus.TIME_LIMIT))
        status[slow] = int(FlightStatus.STARTED_SLOW)
        status[~finite] = int(FlightStatus.NOT_FINITE)
        rate, peak = first[:, references.layout.bank_rate], np.zeros((len(plant.limits.names), n))
        return cls(x, rate.copy(), flying, final, final_time, status, peak)

    def advance(self, plant: _Plant, old: Array, new: Array, now: float, h: float) -> None:
        """One plant step, with the bank rate linear from `old` to `new`; some flights end in it."""
        x, flying = self.x, self.flying
        self.peak = np.where(flying, np.maximum(self.peak, plant.use(x, old, now)), self.peak)
        ahead = _advanced(plant.model, x, old, new, now, h)
        goes_on = (ahead[SPEED] > plant.target_speed) & (ahead[ALTITUDE] >= 0.0)
        for i in np.flatnonzero(flying & ~(goes_on & (now + h < plant.longest))):
            model = plant.family.member(int(i)).flight_model
            own = _Step(model, x[:, i], old[i], new[i], now, h)
            left = plant.longest[i] - now
            self.final[i], passed, self.status[i] = _end(own, plant.target_speed[i], left)
            self.final_time[i], flying[i], self.rate[i] = now + passed, False, own.rate(passed)
        self.x = np.where(flying, ahead, x)

    def peak_at_the_end(self, plant: _Plant) -> Array:
        """Greatest use of each limit (n, l), of the end too; NaN of what was no flight."""
        peak = np.maximum(self.peak, plant.use(self.final.T, self.rate, self.final_time))
        peak[:, self.status == int(FlightStatus.NOT_FINITE)] = np.nan
        return peak.T


def _look_up(
    references: _StackedReferences, pointer: NDArray[np.intp], time: float
) -> tuple[Array, Array, Array]:
    """Reference states (7, n), bank rate (n,), gains (7, n) at `time`; advances `pointer`."""
    flight, last = np.arange(len(pointer)), references.times.shape[1] - 2
    while True:
        behind = (pointer < last) & (references.times[flight, pointer + 1] <= time)
        if not behind.any():
            break
        pointer += behind
    begin = references.times[flight, pointer]
    w = (time - begin) / (references.times[flight, pointer + 1] - begin)
    w = np.minimum(np.maximum(w, 0.0), 1.0)[:, None]
    rows = (1.0 - w) * references.rows[flight, :, pointer] + w * references.rows[
        flight, :, pointer + 1
    ]
    rows, layout = rows.T, references.layout
    return rows[layout.states].copy(), rows[layout.bank_rate], rows[layout.gains]


def _advanced(
    model: FlightModel, x: Array, rate: Any, new_rate: Any, time: float, h: float
) -> Array:
    """States (7, n) one step later, with σ̇ linear from `rate` to `new_rate`."""

    def rates(state: Array, bank_rate: Any, at: float) -> Array:
        return np.stack(equations_of_motion(model, state, bank_rate, at))

    return rk4_step(rates, x, rate, new_rate, time, h)


def _between(begin: Array, end: Array, share: float) -> Array:
    return (1.0 - share) * begin + share * end


@dataclass(frozen=True, eq=False)
class _Step:
    """One plant step of one flight, to be taken in part."""

    model: FlightModel
    begin: Array  # (7,)
    old: float  # rad/s, bank rate at its begin
    new: float  # rad/s, at its end
    time: float  # s
    length: float  # s

    def rate(self, passed: float) -> float:
        """Bank rate (rad/s) `passed` seconds after the begin."""
        return self.old + (self.new - self.old) * (passed / self.length)

    def after(self, passed: float) -> Array:
        """State (7,) then."""
        before, after = np.array([self.old]), np.array([self.rate(passed)])
        return _advanced(self.model, self.begin[:, None], before, after, self.time, passed)[:, 0]

    def falls_to(self, row: int, level: float, high: float) -> float:
        """Seconds after the begin at which a state has fallen to a level; it is below it at `high`."""
        low, above = 0.0, float(self.begin[row]) - level
        if above <= 0.0:
            return 0.0
        passed = high * above / (above + level - float(self.after(high)[row]))
        for step in range(PLANT.search):
            excess = float(self.after(passed)[row]) - level
            if abs(excess) < PLANT.tolerance(row):
                break
            low, high = (passed, high) if excess > 0.0 else (low, passed)
            secant = passed * above / (above - excess)
            # every third step halves the bracket: the secant alone may creep
            inside = low < secant < high and step % 3 < 2
            passed = secant if inside else 0.5 * (low + high)
        return passed


def _end(step: _Step, target_speed: float, left: float) -> tuple[Array, float, FlightStatus]:
    """How a flight ends in a step: its state, the time passed in the step, its status."""
    passed, status = min(step.length, left), FlightStatus.TIME_LIMIT
    end = step.after(passed)
    if not np.all(np.isfinite(end)):
        return np.full(N_STATES, np.nan), 0.0, FlightStatus.NOT_FINITE
    for row, level, reached in (
        (SPEED, target_speed, FlightStatus.REACHED_SPEED),
        (ALTITUDE, 0.0, FlightStatus.GROUND),  # before the speed was reached
    ):
        if end[row] <= level if row == SPEED else end[row] < level:
            passed, status = step.falls_to(row, level, passed), reached
            end = step.after(passed)
    return end, passed, status


def _snapshot(
    time: float, x: Array, at: Array, rate: Array, flying: NDArray[np.bool_]
) -> tuple[float, Array, Array, Array]:
    gone = ~flying
    state, reference, flown = x.T.copy(), at.T.copy(), rate.copy()
    state[gone], reference[gone], flown[gone] = np.nan, np.nan, np.nan
    return time, state, reference, flown
