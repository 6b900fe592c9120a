"""Condensing against the nonlinear flight: Z, multipliers and Hessian by differences."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.scp.condensed.condensing import Iterate
from ampi.scp.condensed.cost import add_rate_curvature
from ampi.scp.condensed.iterate import Flight, Linearised, Point
from ampi.scp.condensed.quadratic_model import Multipliers, _lagrangian_hessian

Array = NDArray[np.float64]
STEP = 1e-4
CASES = ["constant_bank_point", "optimum", "drifting"]


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest, flight: Flight) -> tuple[Flight, Point]:
    """Far from the optimum, at it, and with physics that depend on time to the end."""
    found = request.getfixturevalue(request.param)
    return found if request.param == "drifting" else (flight, found)


@pytest.fixture
def flying(case: tuple[Flight, Point]) -> Flight:
    """The flight of the case."""
    return case[0]


@pytest.fixture
def point(case: tuple[Flight, Point]) -> Point:
    """The point of the case."""
    return case[1]


@pytest.fixture
def linearised(flying: Flight, point: Point) -> Linearised:
    """Derivatives there."""
    return flying.linearise(point.iterate)


def flown(flight: Flight, point: Point, linearised: Linearised, z: Array) -> Point:
    """The flight restored at the controls that z = (δu, δt_f, δσ₀) leads to."""
    here = point.iterate
    states = here.states + linearised.condensed.state_map @ z
    states[0, 6] = here.states[0, 6] + z[-1]
    moved = Iterate(states, here.bank_rate + z[:-2], here.final_time + 100.0 * z[-2])
    restored = flight.restore(moved, None)
    assert restored is not None
    return restored


def directions(n_z: int) -> list[Array]:
    """Final time, entry bank angle, single rates of every segment, and mixtures."""
    unit = np.eye(n_z)
    rng = np.random.default_rng(7)
    single = [unit[k] for k in (0, n_z // 4, n_z // 2, n_z - 3)]
    return [unit[-2], unit[-1], *single, *(0.1 * rng.normal(size=n_z) for _ in range(3))]


def random_multipliers(n_nodes: int) -> Multipliers:
    """Multipliers of every kind."""
    rng = np.random.default_rng(11)
    return Multipliers(
        rng.normal(size=4),
        rng.uniform(size=(n_nodes, 3)),
        0.1 * rng.normal(size=n_nodes),
        np.zeros(0),
    )


def node_gradient(linearised: Linearised, multipliers: Multipliers) -> Array:
    """∂(λᵀe + Σ νᵀg + Σ β σ)/∂x at the nodes."""
    gradient = np.einsum(
        "ik,ikj->ij", multipliers.limits, linearised.derivatives.path_jacobian[:, :, :7]
    )
    gradient[:, 6] += multipliers.bank
    gradient[-1, :4] += multipliers.target
    return gradient


def reduced_gradient(flight: Flight, point: Point, multipliers: Multipliers) -> Array:
    """d(λᵀe + Σ νᵀg + Σ β σ)/dz along restored flights."""
    linearised = flight.linearise(point.iterate)
    nodes = node_gradient(linearised, multipliers)
    gradient = np.einsum("ij,ijz->z", nodes, linearised.condensed.state_map)
    by_time = linearised.derivatives.path_jacobian[:, :, 7]
    free = flight.transcription.node_free[:, None]
    gradient[-2] += 100.0 * np.sum(multipliers.limits * by_time * free)
    return gradient


def test_state_map_is_the_derivative_of_the_restored_flight(
    flying: Flight, point: Point, linearised: Linearised
) -> None:
    condensed = linearised.condensed
    for d in directions(condensed.n_variables):
        ahead = flown(flying, point, linearised, STEP * d).iterate.states
        behind = flown(flying, point, linearised, -STEP * d).iterate.states
        differenced = (ahead - behind) / (2.0 * STEP)
        linear = condensed.state_map @ d
        assert np.abs(differenced - linear).max() < 1e-6 * np.abs(linear).max()


def test_state_map_leaves_the_entry_state_alone(linearised: Linearised) -> None:
    first = linearised.condensed.state_map[0]
    assert np.all(first[:6] == 0.0)
    assert np.array_equal(first[6], np.eye(len(first[6]))[-1])


def test_bank_angle_is_the_integral_of_its_rate(
    flying: Flight, point: Point, linearised: Linearised
) -> None:
    # A rate of one along the whole flight turns the bank by u_max t at every node.
    z = np.ones(linearised.condensed.n_variables)
    z[-2:] = 0.0
    times = flying.transcription.times(point.iterate.final_time)
    turned = linearised.condensed.state_map[:, 6] @ z
    assert turned == pytest.approx(flying.problem.bank_rate_limit * times, abs=1e-10)


def test_correction_cancels_a_residual(
    flying: Flight, point: Point, linearised: Linearised
) -> None:
    rng = np.random.default_rng(5)
    t, d = flying.transcription, linearised.derivatives
    residual = rng.normal(size=(len(point.iterate.states) - 1, 7))
    entry_error = rng.normal(size=7)
    change = linearised.condensed.correction(residual, entry_error)
    assert change[0] == pytest.approx(entry_error)
    along = np.einsum("ijk,ik->ij", d.state_jacobian, change)
    left = t.residual(change, along, point.iterate.final_time)
    assert left == pytest.approx(-residual, abs=1e-9)


def dense_system(flying: Flight, point: Point, linearised: Linearised) -> Array:
    """∂R/∂(x_1 … x_n−1) as one matrix, column by column from the residual itself."""
    t, jacobian = flying.transcription, linearised.derivatives.state_jacobian
    n = len(point.iterate.states)
    matrix = np.empty((7 * (n - 1), 7 * (n - 1)))
    for k in range(7 * (n - 1)):
        change = np.zeros((n, 7))
        change[1 + k // 7, k % 7] = 1.0
        along = np.zeros((n, 7))
        along[1 + k // 7] = jacobian[1 + k // 7, :, k % 7]
        matrix[:, k] = t.residual(change, along, point.iterate.final_time).ravel()
    return matrix


def test_multipliers_solve_the_transposed_system(
    flying: Flight, point: Point, linearised: Linearised
) -> None:
    nodes = node_gradient(linearised, random_multipliers(len(point.iterate.states)))
    matrix = dense_system(flying, point, linearised)
    exact = np.linalg.solve(matrix.T, -nodes[1:].ravel()).reshape(-1, 7)
    swept = linearised.condensed.multipliers(nodes)
    assert np.abs(swept - exact).max() < 1e-10 * np.abs(exact).max()


def test_multipliers_give_the_reduced_gradient(
    flying: Flight, point: Point, linearised: Linearised
) -> None:
    # The adjoint law: for a rate at one node, dF/du = −μᵀ h B there, B in the bank row alone.
    target = np.array([0.3, -1.0, 2.0, 0.7])
    nodes = np.zeros_like(point.iterate.states)
    nodes[-1, :4] = target
    mu = linearised.condensed.multipliers(nodes)
    half = flying.transcription.half_lengths(point.iterate.final_time)
    by_adjoint = -half * flying.problem.bank_rate_limit * mu[:, 6]
    direct = target @ linearised.condensed.state_map[-1, :4]
    assert by_adjoint == pytest.approx(direct[:-2], rel=1e-8, abs=1e-12)


def test_reduced_hessian_is_the_derivative_of_the_reduced_gradient(
    flying: Flight, point: Point, linearised: Linearised
) -> None:
    multipliers = random_multipliers(len(point.iterate.states))
    hessian = _lagrangian_hessian(flying, point, linearised, multipliers)
    t, here, effort = flying.transcription, point.iterate, np.zeros_like(hessian)
    add_rate_curvature(effort, flying.problem.objective, t, here, multipliers.absolute, 100.0)
    hessian -= effort  # tested with the cost
    assert hessian == pytest.approx(hessian.T, abs=1e-10 * np.abs(hessian).max())
    for d in directions(len(hessian)):
        ahead = flown(flying, point, linearised, STEP * d)
        behind = flown(flying, point, linearised, -STEP * d)
        differenced = reduced_gradient(flying, ahead, multipliers)
        differenced -= reduced_gradient(flying, behind, multipliers)
        differenced /= 2.0 * STEP
        product = hessian @ d
        assert np.abs(differenced - product).max() < 1e-6 * np.abs(product).max()


def test_reduced_gradient_is_the_slope_of_the_weighted_sum(
    flying: Flight, point: Point, linearised: Linearised
) -> None:
    multipliers = random_multipliers(len(point.iterate.states))

    def weighted(at: Point) -> float:
        return float(
            multipliers.target @ at.target_error
            + np.sum(multipliers.limits * at.path)
            + multipliers.bank @ at.iterate.states[:, 6]
        )

    gradient = reduced_gradient(flying, point, multipliers)
    for d in directions(len(gradient)):
        ahead = weighted(flown(flying, point, linearised, STEP * d))
        behind = weighted(flown(flying, point, linearised, -STEP * d))
        assert (ahead - behind) / (2.0 * STEP) == pytest.approx(
            gradient @ d, abs=1e-6 * np.abs(gradient).max()
        )
