"""Where a reference's bank profile would end if it were flown: its collocation equations, solved again.

A reference is not quite a flight, and one of the boundary begins beside the entry. The flight under its
bank angles σ_i from the entry x_0 satisfies at the collocated nodes of each segment (`collocation`)

    r_i = (1/h) Σ_j D_ij x_j − f(x_i, σ_i, t_i) = 0,                              (1)

and Newton's method from the reference itself, with A_i = ∂f/∂x by differences,

    (1/h) Σ_j D_ij δ_j − A_i δ_i = −r_i,   segment after segment,                 (2)

squares its error at each step. Of 200 references of SHEFEX-3, half of them quadratic, up to 20 % outside
the hexeract, against DOP853, and the time of one of them in numpy on a busy core:

                                              error, median    worst
    RK4 in steps of 4 s                             17 m        28 m      90 ms
    RK4 in steps of 2 s                            1.3 m         2 m     170 ms
    the defect carried linearly, steps of 2 s       24 m       470 m       9 ms
    (2), one iteration                               5 m       175 m       3 ms
    (2), four                                      1.5 m         3 m       7 ms

What is left of (2) is what the mesh leaves along its optima. Explicit steps go one after the other, and
what a reference misses between its nodes, which is more than at them, cancels in the quadrature of the
nodes alone. The flight then ends on the target speed: with V in place of t,

    dx/dV = f / V̇,                                                                (3)

a few RK4 steps from t_f on, or back, arrive there without a search.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.collocation import Collocation, SegmentRule
from ampi.onboard.flight_model import (
    ALTITUDE,
    AZIMUTH,
    BANK,
    LATITUDE,
    LONGITUDE,
    NOMINAL,
    PATH_ANGLE,
    SPEED,
    Factors,
    FlightModelData,
)

Array = NDArray[np.float64]

ITERATIONS = 4  # settle every flight of SHEFEX-3 from up to half a range outside its hexeract
SETTLED = 1.0  # m: the last iteration moves no node farther, or the flight is unknown
STEPS = 2  # of Eq. (3)
LONGEST = 60.0  # s between the reference's end and the flight's
# no rate depends on the longitude; the bank angle is given
PERTURBED = {ALTITUDE: 1.0, LATITUDE: 1e-7, SPEED: 1e-2, PATH_ANGLE: 1e-7, AZIMUTH: 1e-7}


def flown_nodes(
    model: FlightModelData,
    collocation: Collocation,
    reference: Array,
    entry: Array,
    final_time: Array,
    factors: Factors = NOMINAL,
) -> tuple[Array, Array]:
    """States at the nodes (7, n, nodes) of n flights; how far the last iteration moved each (n,), m.

    Parameters
    ----------
    reference
        States (7, n, nodes); their bank angles are flown.
    entry
        (h, θ, φ, V, γ, ψ) at the begin (6, n), angles on the turn of the reference.
    factors
        Numbers, or arrays (n, 1).
    """
    times, x = collocation.times(final_time), reference.copy()
    moved = np.full(x.shape[1], np.inf)
    for _ in range(ITERATIONS):
        before = x.copy()
        rates, slopes = _linearised(model, x, times, factors)
        x[:BANK, :, 0] = entry
        for rule in collocation.rules:
            x[:BANK, :, rule.collocated] += _change(rule, x, rates, slopes, final_time)
        moved = _distance(model, before, x)
    return x, moved


def _linearised(
    model: FlightModelData, x: Array, times: Array, factors: Factors
) -> tuple[Array, Array]:
    """f (6, n, nodes) and A (6, 6, n, nodes), a row for each rate."""
    rates = model.rates(x, 0.0, times, factors)[:BANK]
    beside = np.repeat(x[:, None], len(PERTURBED), axis=1)
    for column, (state, step) in enumerate(PERTURBED.items()):
        beside[state, column] += step
    steps = np.array(list(PERTURBED.values()))[:, None, None]
    slopes = np.zeros((BANK, *rates.shape))
    found = (model.rates(beside, 0.0, times, factors)[:BANK] - rates[:, None]) / steps
    slopes[:, list(PERTURBED)] = found
    return rates, slopes


def _change(rule: SegmentRule, x: Array, rates: Array, slopes: Array, final_time: Array) -> Array:
    """δ (6, n, k) of Eq. (2) on one segment whose first node is as flown."""
    n, k = x.shape[1], len(rule.slopes)
    own = rule.slopes / rule.half(final_time)[:, None, None]  # (n, k, k + 1)
    residual = np.einsum("nij,snj->nis", own, x[:BANK, :, rule.nodes])
    residual -= rates[:, :, rule.collocated].transpose(1, 2, 0)
    matrix = np.zeros((n, k, BANK, k, BANK))
    for state in range(BANK):
        matrix[:, :, state, :, state] = own[:, :, 1:]
    nodes = np.arange(k)
    matrix[:, nodes, :, nodes, :] -= slopes[..., rule.collocated].transpose(3, 2, 0, 1)
    size = k * BANK
    found = _solved(matrix.reshape(n, size, size), -residual.reshape(n, size, 1))
    return np.asarray(found.reshape(n, k, BANK).transpose(2, 0, 1))


def _solved(matrices: Array, right: Array) -> Array:
    """Solutions of n systems; not-a-number of one that is singular."""
    try:
        return np.asarray(np.linalg.solve(matrices, right))
    except np.linalg.LinAlgError:
        if len(matrices) == 1:
            return np.full_like(right, np.nan)
        alone = [_solved(m[None], r[None]) for m, r in zip(matrices, right, strict=True)]
        return np.concatenate(alone)


def _distance(model: FlightModelData, before: Array, after: Array) -> Array:
    """The farthest (m, (n,)) that a node was moved."""
    radius, change = model.equatorial_radius, after - before
    east = radius * change[LONGITUDE] * np.cos(after[LATITUDE])
    squares = change[ALTITUDE] ** 2 + east**2 + (radius * change[LATITUDE]) ** 2
    return np.asarray(np.sqrt(squares.max(axis=1)))


def at_speed(
    model: FlightModelData,
    state: Array,
    final_time: Array,
    bank_rate: Array,
    speed: Array,
    factors: Factors = NOMINAL,
) -> tuple[Array, Array]:
    """States (7, n) and times (n,) at which n flights have `speed`, from `state` (7, n) at `final_time`.

    The bank angle has been changing by `bank_rate` before, and is held afterwards. No number where a
    flight does not brake, or is farther than `LONGEST` from there.
    """
    step = (speed - state[SPEED]) / STEPS
    rate = np.where(state[SPEED] > speed, 0.0, bank_rate)
    y = np.concatenate([state, final_time[None]])
    braking = np.ones(len(final_time), dtype=bool)

    def over_speed(y: Array) -> Array:
        rates = model.rates(y[:-1], rate, y[-1], factors)
        np.logical_and(braking, rates[SPEED] < 0.0, out=braking)
        return np.concatenate([rates, np.ones_like(y[-1:])]) / rates[SPEED]

    for _ in range(STEPS):
        k1 = over_speed(y)
        k2 = over_speed(y + 0.5 * step * k1)
        k3 = over_speed(y + 0.5 * step * k2)
        k4 = over_speed(y + step * k3)
        y = y + step / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    known = braking & (np.abs(y[-1] - final_time) <= LONGEST)
    y = np.where(known, y, np.nan)
    return y[:-1], y[-1]
