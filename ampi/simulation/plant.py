"""The plant: n vehicles in the air as it is, and what ends their flights.

The equations of motion of ampi/physics, RK4, in equal steps. The bank rate and the angle of attack are
linear over a step: its change against the schedule or, of a vehicle without one, the angle itself. A
flight ends where its speed reaches the target speed, at the ground
or at its time limit, whichever comes first, and the instant is found in the step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.missions.family import MissionFamily
from ampi.missions.path_limits import PathLimits
from ampi.outcome import Outcome
from ampi.physics.equations_of_motion import (
    FlightModel,
    aerodynamic_acceleration,
    equations_of_motion,
)
from ampi.physics.state import ALTITUDE, N_STATES, SPEED
from ampi.physics.vehicle import AirLoads
from ampi.propagation.fixed_step import rk4_step
from ampi.simulation.true_model import true_model
from ampi.simulation.truth import Truth

Array = NDArray[np.float64]
RATE, ANGLE = 0, 1  # rows of what steers: bank rate, (change of the) angle of attack


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
class Plant:
    """The vehicles of n flights, and what ends them."""

    family: MissionFamily
    truth: Truth
    longest: Array  # (n,), s
    modulated: bool = False  # whether the angle of attack is steered beside its schedule

    @cached_property
    def is_steered(self) -> bool:
        """Whether there is no schedule: the angle of attack is what steers."""
        return self.model.vehicle.angle_of_attack is None

    @cached_property
    def limits(self) -> PathLimits:
        """Of all flights."""
        return self.family.path_limits()

    @cached_property
    def target_speed(self) -> Array:
        """(n,), m/s."""
        return self.family.target("speed")

    @cached_property
    def model(self) -> FlightModel:
        """Of all flights, steered by bank alone."""
        return true_model(self.family, self.truth)

    def steered(self, angle: Any) -> FlightModel:
        """The same with the angle of attack changed by `angle` (rad)."""
        if self.is_steered or not self.modulated:
            return self.model
        error = self.model.angle_of_attack_offset
        return replace(self.model, angle_of_attack_offset=angle if error is None else error + angle)

    def state(self, x: Array, angle: Any) -> Any:
        """The state of the equations of motion: `x` (7, n), and the angle of attack if it steers."""
        return (*x, angle) if self.is_steered else x

    def air_loads(self, x: Array, steering: Array, time: Any) -> AirLoads:
        """At states `x` (7, n)."""
        angle = steering[ANGLE]
        return self.steered(angle).air_loads(self.state(x, angle), time)

    def acceleration(self, x: Array, steering: Array, time: Any) -> Array:
        """What an ideal accelerometer senses (3, n), m/s²."""
        angle = steering[ANGLE]
        return np.stack(aerodynamic_acceleration(self.steered(angle), self.state(x, angle), time))

    def rates(self, x: Array, steering: Array, time: Any, air: AirLoads | None = None) -> Array:
        """Time derivatives (7, n); `air` are the air loads there, if they are known."""
        angle, out = steering[ANGLE], np.empty_like(x)
        state = self.state(x, angle)
        found = equations_of_motion(self.steered(angle), state, steering[RATE], time, air)
        # np.stack takes five times as long as the rows
        for row, rate in enumerate(found[:N_STATES]):
            out[row] = rate
        return out

    def advanced(
        self, x: Array, old: Array, new: Array, time: Any, h: Any, first: Array | None = None
    ) -> Array:
        """States (7, n) one step of `h` later; steering (2, n) is linear from `old` to `new`."""
        return rk4_step(self.rates, x, old, new, time, h, first)

    def use(
        self,
        x: Array,
        steering: Array,
        time: Any,
        air: AirLoads | None = None,
        *,
        angle_rate: Any = 0.0,
    ) -> Array:
        """Use of each limit (l, n); `angle_rate` (rad/s) is that of the angle of attack."""
        angle, out = steering[ANGLE], np.empty((len(self.limits.names), x.shape[1]))
        model, state = self.steered(angle), self.state(x, angle)
        uses = self.limits.use(
            model, state, steering[RATE], time, air, angle_of_attack_rate=angle_rate
        )
        for row, use in enumerate(uses):
            out[row] = use
        return out

    def take(self, flights: Any) -> Plant:
        """The plant of some of its flights, by their indices."""
        return replace(
            self,
            family=self.family.take(flights),
            truth=self.truth.take(flights),
            longest=self.longest[flights],
        )


@dataclass(eq=False)
class InFlight:
    """n flights on their way: where they are, and how those ended that have."""

    x: Array  # (7, n)
    flying: NDArray[np.bool_]  # (n,)
    final: Array  # (n, 7)
    final_time: Array  # (n,), s
    last: Array  # (2, n): bank rate and angle of attack, as they steer, at the end
    status: NDArray[np.int64]  # (n,)
    peak: Array  # (l, n)

    @classmethod
    def at_entry(cls, plant: Plant, bank_angle: Array, finite: NDArray[np.bool_]) -> InFlight:
        """With these bank angles (n,); those that are not `finite` do not fly."""
        entry = plant.family.entry_states
        x = np.concatenate([entry.T, bank_angle[None, :]])
        n, finite = len(bank_angle), finite & np.all(np.isfinite(entry), axis=1)
        flying = finite & (entry[:, SPEED] > plant.target_speed)
        slow = finite & ~flying
        final, final_time = np.full((n, N_STATES), np.nan), np.full(n, np.nan)
        final[slow], final_time[slow] = x[:, slow].T, 0.0
        status = np.full(n, int(FlightStatus.TIME_LIMIT))
        status[slow] = int(FlightStatus.STARTED_SLOW)
        status[~finite] = int(FlightStatus.NOT_FINITE)
        peak = np.zeros((len(plant.limits.names), n))
        return cls(x, flying, final, final_time, np.zeros((2, n)), status, peak)

    def advance(self, plant: Plant, old: Array, new: Array, now: float, h: float) -> None:
        """One plant step, steered linearly from `old` to `new` (2, n); some flights end in it."""
        x, flying = self.x, self.flying
        air, angle_rate = plant.air_loads(x, old, now), (new[ANGLE] - old[ANGLE]) / h
        use = plant.use(x, old, now, air, angle_rate=angle_rate)
        np.maximum(self.peak, use, out=self.peak, where=flying)
        ahead = plant.advanced(x, old, new, now, h, plant.rates(x, old, now, air))
        goes_on = (ahead[SPEED] > plant.target_speed) & (ahead[ALTITUDE] >= 0.0)
        for i in np.flatnonzero(flying & ~(goes_on & (now + h < plant.longest))):
            one = slice(i, i + 1)
            step = _Step(plant.take([i]), x[:, one], old[:, one], new[:, one], now, h)
            self.final[i], passed, self.status[i] = _end(step)
            self.final_time[i], flying[i] = now + passed, False
            self.last[:, i] = step.steering(passed)[:, 0]
        self.x = np.where(flying, ahead, x)

    def peak_at_the_end(self, plant: Plant) -> Array:
        """Greatest use of each limit (n, l), of the end too; NaN of what was no flight."""
        peak = np.maximum(self.peak, plant.use(self.final.T, self.last, self.final_time))
        peak[:, self.status == int(FlightStatus.NOT_FINITE)] = np.nan
        return peak.T


def between(begin: Array, end: Array, share: float) -> Array:
    """Linearly, `share` of the way."""
    return (1.0 - share) * begin + share * end


@dataclass(frozen=True, eq=False)
class _Step:
    """One plant step of one flight, to be taken in part."""

    plant: Plant
    begin: Array  # (7, 1)
    old: Array  # (2, 1), steering at its begin
    new: Array  # (2, 1), at its end
    time: float  # s
    length: float  # s

    def steering(self, passed: float) -> Array:
        """Steering (2, 1) `passed` seconds after the begin."""
        return self.old + (self.new - self.old) * (passed / self.length)

    def after(self, passed: float) -> Array:
        """State (7,) then."""
        return self.plant.advanced(self.begin, self.old, self.steering(passed), self.time, passed)[
            :, 0
        ]

    def falls_to(self, row: int, level: float, high: float) -> float:
        """Seconds after the begin at which a state has fallen to a level; it is below it at `high`."""
        low, above = 0.0, float(self.begin[row, 0]) - level
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


def _end(step: _Step) -> tuple[Array, float, FlightStatus]:
    """How a flight ends in a step: its state, the time passed in the step, its status."""
    left = float(step.plant.longest[0]) - step.time
    passed, status = min(step.length, left), FlightStatus.TIME_LIMIT
    end = step.after(passed)
    if not np.all(np.isfinite(end)):
        return np.full(N_STATES, np.nan), 0.0, FlightStatus.NOT_FINITE
    for row, level, reached in (
        (SPEED, float(step.plant.target_speed[0]), FlightStatus.REACHED_SPEED),
        (ALTITUDE, 0.0, FlightStatus.GROUND),  # before the speed was reached
    ):
        if end[row] <= level if row == SPEED else end[row] < level:
            passed, status = step.falls_to(row, level, passed), reached
            end = step.after(passed)
    return end, passed, status
