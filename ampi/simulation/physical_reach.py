"""How near a flight could have come to its target by one who knew everything: its physical reach.

Bank angle and, where it may be changed, angle of attack are plans (`ampi.correction.plan`) over the
equivalent speed, flown at the rates that the vehicle has through the true air, from the entry on. The
damped Gauss–Newton step of the corrector, with the true flight in place of the prediction and Jacobians
by differences, brings them to the target. A point is found, not the nearest of all: a flight that comes
near was in reach; of one that does not, nobody has found how.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.correction.bounded_step import bounded_step
from ampi.correction.plan import Plans, equivalent_speed
from ampi.correction.settings import N_ANGLES, N_BANKS, N_PLAN
from ampi.physics.state import ALTITUDE, BANK, LATITUDE, LONGITUDE, SPEED
from ampi.simulation.plant import Plant

Array = NDArray[np.float64]

STEP = 2.0  # s
LONGEST = 1500.0  # s
ITERATIONS = 20
NEAR = 50.0  # m: near enough
DIFFERENCES = np.repeat([0.01, 0.003], [N_BANKS, N_ANGLES])[:, None]  # rad
WEIGHTS = np.array([1.0, 1.0, 0.01])  # of squares: the altitude's miss is kilometres at the most
DAMPING = 1e-7  # least, of squares of kilometres a radian
BUMP = 30.0  # the damping rises by it where a step is rejected, and falls by a third of it


@dataclass(frozen=True, kw_only=True)
class Authority:
    """What plans may use."""

    bank_angle: float  # ±, rad
    bank_rate: float  # rad/s
    angle: float  # ±, rad; 0: the schedule is flown
    angle_rate: float  # rad/s


def nearest_misses(plant: Plant, authority: Authority, banks: Array) -> Array:
    """East, north and up (3, n) of the target (m) at its speed, of the nearest plans that are found.

    Parameters
    ----------
    plant
        The vehicles of n flights; `modulated` if the angle of attack may change.
    banks
        Bank angles (n,) that the search begins with, rad.

    Raises
    ------
    ValueError
        If the angle of attack has no schedule about which it could change.
    """
    if plant.is_steered:
        raise ValueError(
            "plant: expected vehicles with a schedule of the angle of attack "
            "(vehicle.angle_of_attack), got some that steer it"
        )
    own, n = _Search(plant, authority), len(banks)
    bound = np.repeat([authority.bank_angle, authority.angle], [N_BANKS, N_ANGLES])[:, None]
    varied = np.flatnonzero(bound[:, 0] > 0.0)
    values = np.zeros((N_PLAN, n))
    values[:N_BANKS] = banks
    values, everyone = np.clip(values, -bound, bound), np.arange(n)
    missed, damping = own.missed(values, everyone), np.ones(n)
    for _ in range(ITERATIONS):
        far = np.flatnonzero(~(_size(missed) <= NEAR))
        if not len(far):
            break
        jacobian = own.jacobian(values[:, far], missed[:, far], far, varied)
        matrix = np.einsum("c,cin,cjn->ijn", WEIGHTS, jacobian, jacobian)
        matrix[np.arange(N_PLAN), np.arange(N_PLAN)] += damping[far]
        right = -np.einsum("c,cin,cn->in", WEIGHTS, jacobian, missed[:, far] / 1e3)
        step = bounded_step(matrix, right, values[:, far], np.broadcast_to(bound, right.shape))
        tried = np.clip(values[:, far] + step, -bound, bound)
        found = own.missed(tried, far)
        better = ~(_size(found) >= _size(missed[:, far])) & np.isfinite(_size(found))
        values[:, far] = np.where(better, tried, values[:, far])
        missed[:, far] = np.where(better, found, missed[:, far])
        damping[far] = np.where(
            better, np.maximum(damping[far] * 3.0 / BUMP, DAMPING), damping[far] * BUMP
        )
    return missed


def _size(missed: Array) -> Array:
    return np.asarray(np.sqrt(WEIGHTS @ np.square(missed)))


class _Search:
    """Plans flown in the truth."""

    def __init__(self, plant: Plant, authority: Authority) -> None:
        self._plant, self._authority = plant, authority
        family = plant.family
        names = ("altitude", "longitude", "latitude", "speed")
        self._target = np.stack([family.target(name) for name in names])
        planet = family.mission.flight_model.planet
        self._radius, self._gravity = planet.equatorial_radius, planet.load_factor_gravity

    def jacobian(
        self, values: Array, missed: Array, flights: NDArray[np.intp], varied: NDArray[np.intp]
    ) -> Array:
        """∂miss/∂values (3, 18, n), km/rad."""
        n, found = len(flights), np.zeros((3, *values.shape))
        moved = np.repeat(values[:, None], len(varied), axis=1)
        steps = np.where(values > 0.0, -DIFFERENCES, DIFFERENCES)[varied]
        moved[varied, np.arange(len(varied))] += steps
        ends = self.missed(moved.reshape(N_PLAN, -1), np.tile(flights, len(varied)))
        change = (ends.reshape(3, len(varied), n) - missed[:, None]) / steps / 1e3
        found[:, varied] = np.where(np.isfinite(change), change, 0.0)
        return found

    def missed(self, values: Array, flights: NDArray[np.intp]) -> Array:
        """East, north, up (3, n) of the target (m) at its speed; not-a-number if it is not reached."""
        plant, target = self._plant.take(flights), self._target[:, flights]
        x = np.concatenate([plant.family.entry_states.T, values[:1]])
        fast = self._speed(x, target)
        plans = Plans(fast, target[3], values)
        angle, time, end = np.zeros(len(flights)), 0.0, np.full_like(x, np.nan)
        flying = np.ones(len(flights), dtype=bool)
        while flying.any() and time < LONGEST:
            before, rates = x, plant.rates(x, np.stack([np.zeros_like(angle), angle]), time)
            steering, angle_after = self._steering(plans, target, x, rates, angle)
            rates[BANK] = steering[0]
            x = plant.advanced(x, steering, np.stack([steering[0], angle_after]), time, STEP)
            angle, time = angle_after, time + STEP
            over = flying & ~((x[SPEED] > target[3]) & (x[ALTITUDE] > 0.0))
            if over.any():
                at = np.flatnonzero(over)
                after = plant.rates(x, np.stack([steering[0], angle]), time)
                end[:, at] = _at_speed(
                    before[:, at], rates[:, at], x[:, at], after[:, at], target[3, at]
                )
                flying[at] = False
        return np.stack(
            [
                self._radius * np.cos(target[2]) * (end[LONGITUDE] - target[1]),
                self._radius * (end[LATITUDE] - target[2]),
                end[ALTITUDE] - target[0],
            ]
        )

    def _speed(self, x: Array, target: Array) -> Array:
        return np.asarray(equivalent_speed(self._gravity, target[0], x[ALTITUDE], x[SPEED]))

    def _steering(
        self, plans: Plans, target: Array, x: Array, rates: Array, angle: Array
    ) -> tuple[Array, Array]:
        """Bank rate and angle of attack (2, n) over the next step, and the latter at its end."""
        ahead = self._speed(x + STEP * rates, target)
        bank, change = plans.at(ahead)
        most, own = STEP * self._authority.angle_rate, self._authority
        rate = np.clip((bank - x[BANK]) / STEP, -own.bank_rate, own.bank_rate)
        return np.stack([rate, angle]), angle + np.clip(change - angle, -most, most)


def _at_speed(x: Array, rates: Array, after: Array, rates_after: Array, speed: Array) -> Array:
    """The states (7, n) at `speed` within a step, on the cubic through both ends."""
    low, high = np.zeros_like(speed), np.ones_like(speed)
    for _ in range(40):
        middle = 0.5 * (low + high)
        fast = _cubic(x, rates, after, rates_after, middle)[SPEED] > speed
        low, high = np.where(fast, middle, low), np.where(fast, high, middle)
    reached = after[SPEED] <= speed
    return np.where(reached, _cubic(x, rates, after, rates_after, high), np.nan)


def _cubic(x: Array, rates: Array, after: Array, rates_after: Array, w: Array) -> Array:
    v = 1.0 - w
    return np.asarray(
        v * v * (1.0 + 2.0 * w) * x
        + w * w * (3.0 - 2.0 * w) * after
        + STEP * w * v * (v * rates - w * rates_after)
    )
