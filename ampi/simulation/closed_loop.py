"""Closed-loop entries, vectorised over flights.

Plant: the equations of motion of ampi/physics, RK4, one step per guidance cycle with the bank rate
linear in it. Flight software: the functions of ampi/onboard and ampi/tracking that `Guidance` calls,
here on a batch. A flight ends where its speed reaches the target speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.missions.family import MissionFamily
from ampi.onboard.reference import Reference
from ampi.physics.equations_of_motion import FlightModel, equations_of_motion
from ampi.tracking.bank_limiter import bank_on_turn, limited_rate
from ampi.tracking.linear_quadratic import bank_rate_command

Array = NDArray[np.float64]

SPEED_TOLERANCE = 1e-5  # m/s, of the instant at which a flight ends
SEARCH = 150  # steps to find it at the most: secants within a bracket, and bisections
LONGEST = (
    2.0  # times the reference's final time: a flight that takes longer is a record, not a hang
)


class FlightStatus(IntEnum):
    """How a flight ended."""

    REACHED_SPEED = 0
    GROUND = 1
    TIME_LIMIT = 2
    NOT_FINITE = 3
    STARTED_SLOW = 4  # the entry speed is not above the target speed


@dataclass(frozen=True, eq=False)
class FlightBatch:
    """Flights of one batch; n flights, k recorded points (NaN after a flight's end)."""

    final_states: Array  # (n, 7)
    final_time: Array  # (n,), s
    status: NDArray[np.int64]  # (n,), FlightStatus
    clipped: NDArray[np.bool_]  # (n,)
    times: Array  # (k,), s
    states: Array  # (n, 7, k)
    reference_states: Array  # (n, 7, k)
    bank_rate: Array  # (n, k), flown, rad/s
    peak: Array  # (n, l): greatest use of each limit of the mission, read at every guidance cycle


@dataclass(frozen=True, eq=False)
class _StackedReferences:
    """References of n flights: times (n, m), rows (n, 15, m)."""

    times: Array
    rows: Array
    final_time: Array
    clipped: NDArray[np.bool_]

    @classmethod
    def of(cls, guidance: Guidance, parameters: Array) -> _StackedReferences:
        m = guidance.table.conversion.shape[1]
        n = len(parameters)
        times, rows, final = np.empty((n, m)), np.empty((n, 15, m)), np.empty(n)
        clipped = np.zeros(n, dtype=bool)
        for i, measured in enumerate(parameters):
            r: Reference = guidance.reference(measured)
            times[i], final[i], clipped[i] = r.times, r.final_time, not r.inside
            rows[i, :7], rows[i, 7], rows[i, 8:] = r.states, r.bank_rate, r.gains
        return cls(times, rows, final, clipped)


def fly_batch(
    family: MissionFamily, guidance: Guidance, parameters: Array, record_every: float = 5.0
) -> FlightBatch:
    """Fly each mission of `family` in closed loop; guidance is told p = `parameters` (n, d)."""
    with np.errstate(all="ignore"):  # an absurd entry is a record with a status, not a warning
        return _fly(family, guidance, parameters, record_every)


def _fly(
    family: MissionFamily, guidance: Guidance, parameters: Array, record_every: float
) -> FlightBatch:
    n, cycle, model = len(parameters), guidance.cycle, family.flight_model()
    path_limits = family.path_limits()
    entry_states, target_speed = family.entry_states, family.target("speed")
    references, limits = _StackedReferences.of(guidance, parameters), guidance.limits_at(parameters)
    flight = np.arange(n)
    x = np.concatenate([entry_states.T, references.rows[:, 6, 0][None, :]])
    rate, pointer = references.rows[:, 7, 0].copy(), np.zeros(n, dtype=np.intp)
    final, final_time = np.full((n, 7), np.nan), np.full(n, np.nan)
    status = np.full(n, int(FlightStatus.TIME_LIMIT))
    peak = np.zeros((len(path_limits.names), n))
    finite = np.all(np.isfinite(parameters), axis=1) & np.all(np.isfinite(entry_states), axis=1)
    flying = finite & (entry_states[:, 3] > target_speed)
    slow = finite & ~flying
    final[slow], final_time[slow] = x[:, slow].T, 0.0
    status[slow] = int(FlightStatus.STARTED_SLOW)
    status[~finite], peak[:, ~finite] = int(FlightStatus.NOT_FINITE), np.nan
    steps = int(np.ceil(LONGEST * references.final_time.max() / cycle))
    stride = max(1, round(record_every / cycle))
    record: list[tuple[float, Array, Array, Array]] = []
    for step in range(steps):
        time = step * cycle
        use = np.stack(path_limits.use(model, x, rate, time))
        peak = np.where(flying, np.maximum(peak, use), peak)
        at, own_rate, gain = _look_up(references, flight, pointer, time)
        told = x.copy()
        told[6] = bank_on_turn(limits, x[6], at[6])
        tracked = bank_rate_command(told, at, own_rate, gain)
        wanted = np.where(guidance.table.envelope.holds(x), tracked, own_rate)
        wanted = np.where(time >= references.final_time, 0.0, wanted)
        if step % stride == 0:
            record.append(_snapshot(time, x, at, rate, flying))
        shortest = guidance.first_cycle[0] if step == 0 else cycle
        new_rate = limited_rate(limits, told[6], rate, wanted, cycle, shortest)
        ahead = _rk4(model, x, rate, new_rate, time, cycle)
        ended = flying & ~(ahead[3] > target_speed)
        if ended.any():
            _finish(family, ended, x, ahead, rate, new_rate, time, cycle, final, final_time, status)
        grounded = flying & ~ended & (ahead[0] < 0.0)
        final[grounded], final_time[grounded] = ahead[:, grounded].T, time + cycle
        status[grounded] = int(FlightStatus.GROUND)
        flying &= ~(ended | grounded)
        x = np.where(flying, ahead, x)
        rate = np.where(flying, new_rate, rate)
        if not flying.any():
            break
    final[flying], final_time[flying] = x[:, flying].T, steps * cycle
    times, states, reference_states, rates = zip(*record, strict=True)
    return FlightBatch(
        final_states=final,
        final_time=final_time,
        status=status,
        clipped=references.clipped,
        times=np.array(times),
        states=np.stack(states, axis=2),
        reference_states=np.stack(reference_states, axis=2),
        bank_rate=np.stack(rates, axis=1),
        peak=peak.T,
    )


def _look_up(
    references: _StackedReferences, flight: NDArray[np.intp], pointer: NDArray[np.intp], time: float
) -> tuple[Array, Array, Array]:
    """Reference states (7, n), bank rate (n,), gains (7, n) at `time`; advances `pointer`."""
    last = references.times.shape[1] - 2
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
    rows = rows.T
    return rows[:7].copy(), rows[7], rows[8:]


def _rk4(
    model: FlightModel, x: Array, rate: Array, new_rate: Array, time: float, h: float
) -> Array:
    """One step with σ̇ linear from `rate` to `new_rate`."""
    middle = 0.5 * (rate + new_rate)

    def f(state: Array, bank_rate: Array, at: float) -> Array:
        return np.stack(equations_of_motion(model, state, bank_rate, at))

    k1 = f(x, rate, time)
    k2 = f(x + 0.5 * h * k1, middle, time + 0.5 * h)
    k3 = f(x + 0.5 * h * k2, middle, time + 0.5 * h)
    k4 = f(x + h * k3, new_rate, time + h)
    return x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def _finish(
    family: MissionFamily,
    ended: NDArray[np.bool_],
    x: Array,
    ahead: Array,
    rate: Array,
    new_rate: Array,
    time: float,
    cycle: float,
    final: Array,
    final_time: Array,
    status: NDArray[np.int64],
) -> None:
    """Locate the target speed inside the step, each guess with its own RK4 step."""
    for i in np.flatnonzero(ended):
        if not np.all(np.isfinite(ahead[:, i])):
            final_time[i], status[i] = time, int(FlightStatus.NOT_FINITE)
            continue
        model = family.missions[i].flight_model
        target = family.missions[i].target.speed
        begin, old, slope = x[:, i : i + 1], rate[i : i + 1], new_rate[i] - rate[i]
        low, high = 0.0, cycle
        h = cycle * float((x[3, i] - target) / (x[3, i] - ahead[3, i]))
        for step in range(SEARCH):
            end = _rk4(model, begin, old, old + slope * (h / cycle), time, h)
            excess = float(end[3, 0]) - target
            if abs(excess) < SPEED_TOLERANCE:
                break
            low, high = (h, high) if excess > 0.0 else (low, h)
            secant = h * float((x[3, i] - target) / (x[3, i] - end[3, 0]))
            # every third step halves the bracket: the secant alone may creep
            h = secant if low < secant < high and step % 3 < 2 else 0.5 * (low + high)
        final[i], final_time[i] = end[:, 0], time + h
        crashed = end[0, 0] < 0.0
        status[i] = int(FlightStatus.GROUND if crashed else FlightStatus.REACHED_SPEED)


def _snapshot(
    time: float, x: Array, at: Array, rate: Array, flying: NDArray[np.bool_]
) -> tuple[float, Array, Array, Array]:
    gone = ~flying
    state, reference, flown = x.T.copy(), at.T.copy(), rate.copy()
    state[gone], reference[gone], flown[gone] = np.nan, np.nan, np.nan
    return time, state, reference, flown
