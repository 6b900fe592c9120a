"""Flipped-Radau transcription: exact on polynomials, and true to an independent integrator."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ampi.missions import Mission
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.state import CORE
from ampi.pseudospectral.mesh import Mesh, Phase
from ampi.scp.condensed.cost import smooth_cost
from ampi.scp.condensed.iterate import Flight, Iterate, Point
from ampi.scp.condensed.transcription import RadauTranscription, radau_transcription
from ampi.scp.guess import NodalGuess
from ampi.scp.problem.objective import Objective
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from tests.support.missions import SCALE

Array = NDArray[np.float64]
laws = settings(deadline=None, max_examples=60)
final_times = st.floats(120.0, 2000.0)
seeds = st.integers(0, 2**32 - 1)
MESH = Mesh((Phase((4, 6), 58.0), Phase((5,), 88.0), Phase((7, 5), None, (0.0, 0.3, 1.0))))
LOWEST = 4  # degree of the poorest segment


def polynomials(seed: int, degree: int, final_time: float, count: int) -> list[Polynomial]:
    """Random polynomials of time of one degree on [0, t_f]."""
    rng = np.random.default_rng(seed)
    domain = [0.0, final_time]
    return [Polynomial(rng.uniform(-1.0, 1.0, degree + 1), domain=domain) for _ in range(count)]


def residual(t: RadauTranscription, x: Array, rates: Array, final_time: float) -> Array:
    """R (n − 1, 7) of one case, from states and rates (n, 7)."""
    return t.residual(x.T[:, None], rates.T[:, None], np.array([final_time]))[0]


@laws
@given(seed=seeds, final_time=final_times)
def test_a_polynomial_motion_leaves_no_residual(seed: int, final_time: float) -> None:
    t = radau_transcription(MESH)
    times = t.times(final_time)
    motion = polynomials(seed, LOWEST, final_time, 7)
    x = np.stack([p(times) for p in motion], axis=1)
    rates = np.stack([p.deriv()(times) for p in motion], axis=1)
    assert np.abs(residual(t, x, rates, final_time)).max() < 1e-11
    x[-1, 3] += 1e-3
    assert np.abs(residual(t, x, rates, final_time)).max() > 1e-4


@laws
@given(final_time=final_times)
def test_a_motion_above_the_degree_leaves_a_residual_in_the_poorest_segments(
    final_time: float,
) -> None:
    t = radau_transcription(MESH)
    times = t.times(final_time)
    motion = Polynomial.fromroots([0.3 * final_time] * 6)
    scale = 1.0 / motion(final_time)
    x, rates = scale * motion(times), scale * motion.deriv()(times)
    left = residual(t, np.tile(x[:, None], 7), np.tile(rates[:, None], 7), final_time)
    size = [np.abs(left[s.collocation]).max() for s in MESH.segments]
    rich = [s.rule.degree >= 6 for s in MESH.segments]
    for k, exact in enumerate(rich):
        assert (size[k] < 1e-12) == exact


@laws
@given(seed=seeds, final_time=final_times, degree=st.integers(0, LOWEST - 1))
def test_effort_of_a_polynomial_rate_is_exact(
    problem: OptimalControlProblem, seed: int, final_time: float, degree: int
) -> None:
    t = radau_transcription(MESH)
    (rate,) = polynomials(seed, degree, final_time, 1)
    square = (rate * rate).integ()
    exact = square(final_time) - square(0.0)
    unit = Objective(1.0, (1.0,), effort=(1.0,), final_time=0.0, variation=0.0, descent=0.0)
    alone, none = replace(problem, objective=unit), np.zeros((0, 1, len(t.weights) + 1))

    def effort(u: Array) -> float:
        return float(smooth_cost(alone, t, u[None], np.array([final_time]), none)[0])

    got = effort(rate(t.times(final_time)[1:]))
    assert got == pytest.approx(exact, rel=1e-11)
    assert effort(-2.0 * rate(t.times(final_time)[1:])) == pytest.approx(4.0 * got)


@laws
@given(seed=seeds, final_time=final_times)
def test_rate_at_entry_continues_the_first_segment(seed: int, final_time: float) -> None:
    t = radau_transcription(MESH)
    (rate,) = polynomials(seed, MESH.segments[0].rule.degree - 1, final_time, 1)
    times = t.times(final_time)
    nodal = t.nodal_rate(rate(times[1:])[None])[0]
    assert nodal == pytest.approx(rate(times), abs=1e-10)
    assert len(nodal) == MESH.n_nodes


@laws
@given(final_time=final_times)
def test_half_lengths_add_up_to_the_flight(final_time: float) -> None:
    t = radau_transcription(MESH)
    assert np.sum(t.half_lengths(final_time) * t.weights) == pytest.approx(final_time, rel=1e-13)
    assert t.times(final_time) == pytest.approx(MESH.times(final_time), rel=1e-15)


def test_the_derivative_blocks_are_those_of_the_residual() -> None:
    t = radau_transcription(MESH)
    x = np.random.default_rng(1).normal(size=(MESH.n_nodes, 7))
    left = residual(t, x, np.zeros_like(x), 700.0)
    core = x[:, CORE]
    for s, derivative in zip(MESH.segments, t.core_derivative, strict=True):
        inside = core[s.nodes]
        found = (derivative @ inside[1:].ravel()).reshape(-1, len(CORE))
        found += s.rule.derivative[:, :1] * inside[0]
        assert found == pytest.approx(left[s.collocation][:, CORE], abs=1e-12)


def test_integration_inverts_the_derivative_across_segments() -> None:
    t = radau_transcription(MESH)
    x = np.random.default_rng(2).normal(size=(MESH.n_nodes, 7))
    rates = residual(t, x, np.zeros_like(x), 700.0)  # D x alone
    assert x[0] + t.integration @ rates == pytest.approx(x[1:], abs=1e-12)
    assert t.integration[-1] == pytest.approx(t.weights, abs=1e-13)


def test_the_restored_flight_satisfies_collocation_and_entry(
    flight: Flight, constant_bank_point: Point
) -> None:
    here, t, problem = constant_bank_point.iterate, flight.transcription, flight.problem
    x, u, final_time = here.batch
    evaluate = problem.dynamics.values.one_by_one
    rates, _ = evaluate(x, t.nodal_rate(u), t.times(final_time), problem.numbers)
    assert np.abs(t.residual(x, rates, final_time)).max() < 1e-10
    assert here.states[0, :6] == pytest.approx(flight.problem.entry, rel=1e-15)
    assert np.all(here.controls == 0.0)
    assert here.states[:, 6] == pytest.approx(np.full(len(here.states), np.radians(-30.0)))


def test_the_restored_flight_is_the_integrated_one(
    mission: Mission, constant_bank_point: Point
) -> None:
    # DOP853, stopped at the kinks of the angle of attack.
    here = constant_bank_point.iterate
    times = mission.pseudospectral_mesh.times(here.final_time)
    kinks = [0.0, 58.0, 88.0, here.final_time]
    states = here.states * SCALE
    x, flown = states[0], [states[0]]
    for start, end in pairwise(kinks):
        inside = times[(times > start + 1e-9) & (times < end - 1e-9)]
        piece = solve_ivp(
            lambda t, y: equations_of_motion(mission.flight_model, y, 0.0, t),
            (start, end),
            x,
            method="DOP853",
            t_eval=[*inside, end],
            rtol=1e-11,
            atol=1e-11,
        )
        assert piece.success
        flown.extend(piece.y.T)
        x = piece.y[:, -1]
    error = np.abs(np.array(flown) - states).max(axis=0)
    assert error[0] < 10.0  # m
    assert np.all(6.4e6 * error[1:3] < 10.0)  # m
    assert error[3] < 0.5  # m/s


def test_restoration_is_a_projection(flight: Flight, constant_bank_point: Point) -> None:
    here = constant_bank_point.iterate
    again = flight.restore(here, None)
    assert again is not None
    assert again.iterate.states == pytest.approx(here.states, abs=1e-11)
    shake = 1e-3 * np.random.default_rng(3).normal(size=here.states.shape)
    shaken = Iterate(here.states + shake, here.controls, here.final_time)
    back = flight.restore(shaken, flight.linearise(here))
    assert back is not None
    entry_bank = shake[0, 6]  # free: the flight keeps the bank angle it was given
    assert back.iterate.states[:, 6] == pytest.approx(here.states[:, 6] + entry_bank, abs=1e-11)
    # at another entry state, which is put right first
    rate = flight.transcription.nodal_rate(here.controls[None])[0]
    states = (here.states + shake * (np.arange(7) < 6)) * SCALE
    back = flight.first_point(
        NodalGuess(states, rate * flight.problem.angles[0].rate_limit, here.final_time)
    )
    assert back is not None
    assert back.iterate.states == pytest.approx(here.states, abs=1e-10)


def test_evaluation_of_a_point(flight: Flight, optimum: Point, mission: Mission) -> None:
    here = optimum.iterate
    rate = here.controls * mission.limits.bank_rate / np.radians(1.0)  # deg/s
    t = flight.transcription
    effort = np.sum(t.half_lengths(here.final_time) * t.weights * rate**2)
    assert optimum.cost == pytest.approx(effort, rel=1e-12)
    target = mission.target
    reference = [target.altitude, target.longitude, target.latitude, target.speed]
    assert optimum.target_error * SCALE[:4] == pytest.approx(
        here.states[-1, :4] * SCALE[:4] - reference, abs=1e-9
    )
    assert optimum.path.shape == (flight.problem.mesh.n_nodes, 3)
    assert optimum.excess == pytest.approx(np.maximum(optimum.path.max(axis=0) - 1.0, 0.0))


@pytest.mark.parametrize("fault", ["not a number", "straight down at the pole"])
def test_what_cannot_be_restored_is_none(
    flight: Flight, constant_bank_point: Point, fault: str
) -> None:
    states = constant_bank_point.iterate.states.copy()
    if fault == "not a number":
        states[10] = np.nan
    else:
        states[1:, 2], states[1:, 4] = 3.0, -40.0
    bad = Iterate(states, constant_bank_point.iterate.controls, 634.0)
    with np.errstate(all="ignore"):
        assert flight.restore(bad, None) is None
