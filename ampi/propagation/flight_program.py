"""DOP853 (Hairer, Nørsett, Wanner 1993) on steps chosen beforehand, in CasADi's virtual machine.

The bank angle of an optimum, and its angle of attack where that is a state, is a polynomial on every
segment of its mesh, so steps that end at the nodes meet no kink, and its values at all stages are one
matrix product. What is left to compute one
after the other are the stages: a flight of ten minutes takes a millisecond, a hundredth of the time of
an integrator that is called from Python. The scheme's own estimate of the error decides whether the
steps were short enough; else all are halved. Nothing of a flight depends on others.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from ampi.physics.state import ALTITUDE, BANK, FLIGHT_PATH_ANGLE
from ampi.propagation.adaptive_step import Accuracy, IntegrationError
from ampi.pseudospectral.lagrange import interpolation_matrix
from ampi.pseudospectral.mesh import Mesh
from ampi.tracing.dynamics import trace
from ampi.tracing.numbers import Numbers, at_cases
from ampi.tracing.vectorised import VectorisedFunction

Array = NDArray[np.float64]

LONGEST_STEP = 10.0  # s, before any is halved: ten minutes of SHEFEX-3 are micrometres off
HORIZON = (
    100.0  # s: flights whose final times round up to the same multiple of it have the same steps
)
MOST_HALVINGS = 6
GROUND = -1e3  # m: a target may lie a little under the sea
STEEPEST = float(np.radians(89.5))
STAGES = 12


@dataclass(frozen=True, eq=False)
class Steps:
    """k steps on a mesh; times are a + b t_f."""

    start: tuple[Array, Array]  # (a, b), (k,) each
    length: tuple[Array, Array]
    stages: Array  # from nodal values of an angle to those at the stages, (k · 12, n)
    ends: Array  # from nodal values to those at the ends, (k + 1, n)
    at_nodes: NDArray[np.intp]  # which of the ends are nodes


@lru_cache(maxsize=64)
def steps_on(mesh: Mesh, horizon: float, halvings: int) -> Steps:
    """Steps of at most `LONGEST_STEP` in a flight of `horizon` (s), each halved so many times."""
    start, length, rows, at_nodes = [], [], [], [0]
    at_ends = [np.eye(1, mesh.n_nodes)[0]]
    for s in mesh.segments:
        half = np.array(s.half_length)
        for left, right in zip(s.rule.nodes[:-1], s.rule.nodes[1:], strict=True):
            duration = (half[0] + half[1] * horizon) * (right - left)
            count = int(np.ceil(duration / LONGEST_STEP)) * 2**halvings
            ends = np.linspace(left, right, count + 1)
            for first, last in pairwise(ends):
                start.append(np.array(s.start) + half * (1.0 + first))
                length.append(half * (last - first))
                tau = np.append(first + DOP853.C[:STAGES] * (last - first), last)
                row = np.zeros((STAGES + 1, mesh.n_nodes))
                row[:, s.nodes] = interpolation_matrix(s.rule.nodes, s.rule.barycentric, tau)
                rows.append(row[:STAGES])
                at_ends.append(row[STAGES])
            at_nodes.append(len(start))
    begins, lengths = np.array(start).T, np.array(length).T
    return Steps(
        start=(begins[0], begins[1]),
        length=(lengths[0], lengths[1]),
        stages=np.concatenate(rows),
        ends=np.array(at_ends),
        at_nodes=np.array(at_nodes),
    )


@dataclass(frozen=True, eq=False)
class Flown:
    """A flight at the k + 1 ends of its steps."""

    times: Array  # (k + 1,), s
    states: Array  # (6, k + 1)
    deviation: Array  # (6, k + 1), from the polynomials of the trajectory
    at_nodes: NDArray[np.intp]  # which of them are nodes


def fly(
    structure: Hashable,
    numbers: Numbers,
    mesh: Mesh,
    states: Array,
    final_time: float,
    accuracy: Accuracy,
) -> Flown:
    """Fly `states` (7 or 8, n), a trajectory's at the nodes, from its first one on under its angles.

    `structure` and `numbers` are those of the model (tracing).

    Raises
    ------
    IntegrationError
        If the flight reaches the ground or a vertical path, or no step is short enough.
    """
    horizon = HORIZON * float(np.ceil(final_time / HORIZON))
    for halvings in range(MOST_HALVINGS):
        steps = steps_on(mesh, horizon, halvings)
        begin = steps.start[0] + steps.start[1] * final_time
        length = steps.length[0] + steps.length[1] * final_time
        angles = [(steps.stages @ angle).reshape(-1, 1, STAGES) for angle in states[BANK:]]
        program = _program(structure, len(begin), len(states))
        steered = np.concatenate(angles, axis=1)
        ends, fifth, third = program(states[:BANK, 0], steered, begin, length, numbers)
        found = np.concatenate([states[:BANK, :1], ends.T], axis=1)
        # what is not a number has been under the ground, or vertical, before
        grounded = ~(found[ALTITUDE] >= GROUND)
        vertical = ~(np.abs(found[FLIGHT_PATH_ANGLE]) <= STEEPEST)
        last = int(np.argmax(np.append(grounded | vertical, True)))  # where the flight ends
        is_whole = last == found.shape[1]
        exact = np.all(_errors(found, fifth, third, length, accuracy)[:last] <= 1.0)
        if not exact and (is_whole or halvings + 1 < MOST_HALVINGS):
            continue
        if not is_whole:
            where = "under the ground" if grounded[last] else "on a vertical path"
            raise IntegrationError(f"the flight ends {where}")
        times = np.append(begin, begin[-1] + length[-1])
        return Flown(times, found, found - states[:BANK] @ steps.ends.T, steps.at_nodes)
    raise IntegrationError("no step is short enough")


def fly_together(
    structure: Hashable,
    numbers: Numbers,
    mesh: Mesh,
    states: Array,
    final_time: Array,
    accuracy: Accuracy,
) -> list[Flown]:
    """`fly` for trajectories `states` (c, 7 or 8, n) with `final_time` (c,), step by step for all.

    Who needs shorter steps, or ends before, is flown alone.
    """
    found: dict[int, Flown] = {}
    horizons = HORIZON * np.ceil(final_time / HORIZON)
    for horizon in np.unique(horizons):
        cases = np.flatnonzero(horizons == horizon)
        steps, durations = steps_on(mesh, float(horizon), 0), final_time[cases]
        begin = steps.start[0] + steps.start[1] * durations[:, None]
        length = steps.length[0] + steps.length[1] * durations[:, None]
        n_states = states.shape[1]
        angles = [(steps.stages @ states[cases, k, :, None])[..., 0] for k in range(BANK, n_states)]
        shaped = [angle.reshape(len(cases), -1, STAGES).transpose(1, 2, 0) for angle in angles]
        steered = np.ascontiguousarray(np.concatenate(shaped, axis=1))
        step, own = _vectorised_step(structure, n_states), at_cases(numbers, cases)
        path = np.empty((3, length.shape[1], BANK, len(cases)))  # ends, errors of both orders
        x = np.ascontiguousarray(states[cases, :BANK, 0].T)
        for k in range(length.shape[1]):
            moment = begin[None, :, k].copy(), length[None, :, k].copy()
            path[:, k] = step(x, steered[k], *moment, own)
            x = path[0, k]
        flown = np.concatenate([states[cases, :BANK, :1], path[0].transpose(2, 1, 0)], axis=2)
        deviation = flown - states[cases, :BANK] @ steps.ends.T
        for j, case in enumerate(cases.tolist()):
            inside = np.all(flown[j, ALTITUDE] >= GROUND)
            inside &= np.all(np.abs(flown[j, FLIGHT_PATH_ANGLE]) <= STEEPEST)
            errors = _errors(flown[j], path[1, :, :, j], path[2, :, :, j], length[j], accuracy)
            if inside and np.all(errors <= 1.0):
                times = np.append(begin[j], begin[j, -1] + length[j, -1])
                found[case] = Flown(times, flown[j], deviation[j], steps.at_nodes)
            else:
                alone = at_cases(numbers, case)
                found[case] = fly(structure, alone, mesh, states[case], durations[j], accuracy)
    return [found[case] for case in range(len(states))]


def _errors(states: Array, fifth: Array, third: Array, length: Array, accuracy: Accuracy) -> Array:
    """Of all steps (k,), over what is allowed (Hairer, Nørsett & Wanner 1993, Section II.10)."""
    small = accuracy.absolute(BANK, 1)
    size = np.maximum(np.abs(states[:, :-1]), np.abs(states[:, 1:])).T
    scale = small + accuracy.relative * size
    five, three = (((error / scale) ** 2).sum(axis=1) for error in (fifth, third))
    denominator = np.sqrt((five + 0.01 * three) * BANK)
    error = np.zeros_like(five)
    np.divide(length * five, denominator, out=error, where=denominator > 0.0)
    return error


class _Program:
    """So many steps of one model: all stages unrolled, and the steps one after the other."""

    def __init__(self, step: ca.Function, count: int) -> None:
        buffer: tuple[Any, Any] = step.mapaccum("flight", count).buffer()
        self._buffer, self._evaluate = buffer
        angles, numbers = step.size2_in(1), step.size1_in(4)
        shapes = (BANK, (count, angles, STAGES), count, count, (count, numbers))
        self._inputs = [np.zeros(shape) for shape in shapes]
        self._outputs = [np.zeros((count, BANK)) for _ in range(3)]
        for i, array in enumerate(self._inputs):
            self._buffer.set_arg(i, array.data)
        for i, array in enumerate(self._outputs):
            self._buffer.set_res(i, array.data)

    def __call__(self, *inputs: Any) -> list[Array]:
        """States at the ends, errors of order five and three (k, 6); overwritten by the next call."""
        for stored, given in zip(self._inputs, inputs, strict=True):
            stored[...] = given
        self._evaluate()
        return self._outputs


@lru_cache(maxsize=64)
def _program(structure: Hashable, count: int, n_states: int) -> _Program:
    return _Program(_step(structure, n_states), count)


@lru_cache(maxsize=16)
def _vectorised_step(structure: Hashable, n_states: int) -> VectorisedFunction:
    return VectorisedFunction(_step(structure, n_states))


@lru_cache(maxsize=16)
def _step(structure: Hashable, n_states: int) -> ca.Function:
    """One step of DOP853 as one function of state, angles at the stages, time, length, numbers."""
    traced = trace(structure, (1.0,) * n_states)
    rates = ca.Function("rates", [traced.x, traced.t, traced.p], [traced.f[:BANK]], {"cse": True})
    shapes = (("x", BANK), ("b", STAGES, n_states - BANK), ("t",), ("h",))
    x, angles, time, length = (ca.SX.sym(*shape) for shape in shapes)
    p = ca.SX.sym("p", traced.p.numel())
    slopes: list[Any] = []
    for stage in range(STAGES):
        here = x + length * _weighted(DOP853.A[stage, :stage], slopes)
        at = time + DOP853.C[stage] * length
        slopes.append(rates(ca.vertcat(here, angles[stage, :].T), at, p))
    end = x + length * _weighted(DOP853.B, slopes)
    errors = [_weighted(weights[:STAGES], slopes) for weights in (DOP853.E5, DOP853.E3)]
    inputs = [x, angles, time, length, p]
    return ca.Function("step", inputs, [ca.densify(out) for out in (end, *errors)], {"cse": True})


def _weighted(weights: Array, slopes: list[Any]) -> Any:
    total: Any = ca.SX.zeros(BANK)
    for weight, slope in zip(weights, slopes, strict=False):
        if weight != 0.0:
            total = total + weight * slope
    return total
