"""Condensing against the nonlinear flight: Z, multipliers and Hessian by differences."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.physics.state import N_STATES
from ampi.scp.condensed.condensing import CondensedDynamics, _inverse
from ampi.scp.condensed.cost import add_rate_curvature
from ampi.scp.condensed.iterate import ONE, Flight, Iterate, Point
from ampi.scp.condensed.quadratic_model import Multipliers, lagrangian_hessian

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
def condensed(flying: Flight, point: Point) -> CondensedDynamics:
    """The batch of one, condensed there."""
    return flying.linearise(point.iterate)


def change(condensed: CondensedDynamics, z: Array) -> Array:
    """Z z of the batch of one, (n, 7)."""
    return condensed.change(z[None], ONE)[:, 0].T


def state_map(condensed: CondensedDynamics) -> Array:
    """Z, (n, 7, n_z), column by column."""
    return np.stack([change(condensed, e) for e in np.eye(condensed.n_variables)], axis=-1)


def path_jacobian(condensed: CondensedDynamics) -> Array:
    """∂g/∂(x, t), (n, 3, 8)."""
    return np.stack([condensed.derivatives.gradient_of(k)[0] for k in range(3)], axis=1)


def flown(flight: Flight, point: Point, condensed: CondensedDynamics, z: Array) -> Point:
    """The flight restored at the controls that z = (δu, δt_f, δσ₀) leads to."""
    here = point.iterate
    states = here.states + change(condensed, z)
    states[0, 6] = here.states[0, 6] + z[-1]
    moved = Iterate(states, here.controls + z[:-2], here.final_time + 100.0 * z[-2])
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
        0.1 * rng.normal(size=(1, n_nodes)),
        np.zeros(0),
    )


def node_gradient(condensed: CondensedDynamics, multipliers: Multipliers) -> Array:
    """∂(λᵀe + Σ νᵀg + Σ β σ)/∂x at the nodes."""
    gradient = np.einsum("ik,ikj->ij", multipliers.limits, path_jacobian(condensed)[:, :, :7])
    gradient[:, 6] += multipliers.angles[0]
    gradient[-1, :4] += multipliers.target
    return gradient


def reduced_gradient(flight: Flight, point: Point, multipliers: Multipliers) -> Array:
    """d(λᵀe + Σ νᵀg + Σ β σ)/dz along restored flights."""
    condensed = flight.linearise(point.iterate)
    nodes = node_gradient(condensed, multipliers)
    gradient = np.einsum("ij,ijz->z", nodes, state_map(condensed))
    by_time = path_jacobian(condensed)[:, :, 7]
    free = flight.transcription.node_free[:, None]
    gradient[-2] += 100.0 * np.sum(multipliers.limits * by_time * free)
    return gradient


def test_state_map_is_the_derivative_of_the_restored_flight(
    flying: Flight, point: Point, condensed: CondensedDynamics
) -> None:
    for d in directions(condensed.n_variables):
        ahead = flown(flying, point, condensed, STEP * d).iterate.states
        behind = flown(flying, point, condensed, -STEP * d).iterate.states
        differenced = (ahead - behind) / (2.0 * STEP)
        linear = change(condensed, d)
        assert np.abs(differenced - linear).max() < 1e-6 * np.abs(linear).max()


def test_state_map_leaves_the_entry_state_alone(condensed: CondensedDynamics) -> None:
    first = state_map(condensed)[0]
    assert np.all(first[:6] == 0.0)
    assert np.array_equal(first[6], np.eye(len(first[6]))[-1])


def test_bank_angle_is_the_integral_of_its_rate(
    flying: Flight, point: Point, condensed: CondensedDynamics
) -> None:
    # A rate of one along the whole flight turns the bank by u_max t at every node.
    z = np.ones(condensed.n_variables)
    z[-2:] = 0.0
    times = flying.transcription.times(point.iterate.final_time)
    turned = change(condensed, z)[:, 6]
    assert turned == pytest.approx(flying.problem.angles[0].rate_limit * times, abs=1e-10)


def dense_jacobian(condensed: CondensedDynamics) -> Array:
    """∂f/∂x at the nodes, (n, 7, 7)."""
    found = np.zeros((condensed.moving.shape[1], N_STATES, N_STATES))
    derivatives = condensed.derivatives
    for (row, column), values in zip(derivatives.places, derivatives.jacobian, strict=True):
        found[:, row, column] = values[0]
    return found


def residual_of(flight: Flight, point: Point, states: Array, rates: Array) -> Array:
    """R (n − 1, 7) of states and rates (n, 7)."""
    final_time = np.array([point.iterate.final_time])
    return flight.transcription.residual(states.T[:, None], rates.T[:, None], final_time)[0]


def test_correction_cancels_a_residual(
    flying: Flight, point: Point, condensed: CondensedDynamics
) -> None:
    rng = np.random.default_rng(5)
    residual = rng.normal(size=(len(point.iterate.states) - 1, 7))
    found = np.zeros_like(point.iterate.states)  # the entry state is given
    found[1:] = condensed.correction(residual[None], ONE)[0]
    along = np.einsum("ijk,ik->ij", dense_jacobian(condensed), found)
    left = residual_of(flying, point, found, along)
    assert left == pytest.approx(-residual, abs=1e-9)


def dense_system(flying: Flight, point: Point, condensed: CondensedDynamics) -> Array:
    """∂R/∂(x_1 … x_n−1) as one matrix, column by column from the residual itself."""
    jacobian = dense_jacobian(condensed)
    n = len(point.iterate.states)
    matrix = np.empty((7 * (n - 1), 7 * (n - 1)))
    for k in range(7 * (n - 1)):
        moved = np.zeros((n, 7))
        moved[1 + k // 7, k % 7] = 1.0
        along = np.zeros((n, 7))
        along[1 + k // 7] = jacobian[1 + k // 7, :, k % 7]
        matrix[:, k] = residual_of(flying, point, moved, along).ravel()
    return matrix


def test_multipliers_solve_the_transposed_system(
    flying: Flight, point: Point, condensed: CondensedDynamics
) -> None:
    nodes = node_gradient(condensed, random_multipliers(len(point.iterate.states)))
    matrix = dense_system(flying, point, condensed)
    exact = np.linalg.solve(matrix.T, -nodes[1:].ravel()).reshape(-1, 7)
    swept = condensed.multipliers(nodes[None, 1:], ONE)[:, 0].T
    assert np.abs(swept - exact).max() < 1e-10 * np.abs(exact).max()


def test_what_the_system_has_changed_is_the_difference_of_its_matrices(
    flying: Flight, point: Point, condensed: CondensedDynamics
) -> None:
    z = 0.005 * np.random.default_rng(8).normal(size=condensed.n_variables)
    there = flown(flying, point, condensed, z)
    now = flying.linearise(there.iterate)
    mu = np.random.default_rng(9).normal(size=(7, 1, len(z) - 2))
    exact = dense_system(flying, there, now) - dense_system(flying, point, condensed)
    found = condensed.change_of_transpose(now.derivatives, now.half, mu, ONE)
    expected = (exact.T @ mu[:, 0].T.ravel()).reshape(-1, 7)
    assert np.abs(found[0] - expected).max() < 1e-10 * np.abs(expected).max()


def test_multipliers_give_the_reduced_gradient(
    flying: Flight, point: Point, condensed: CondensedDynamics
) -> None:
    # The adjoint law: for a rate at one node, dF/du = −μᵀ h B there, B in the bank row alone.
    target = np.array([0.3, -1.0, 2.0, 0.7])
    nodes = np.zeros_like(point.iterate.states)
    nodes[-1, :4] = target
    mu = condensed.multipliers(nodes[None, 1:], ONE)[:, 0].T
    half = flying.transcription.half_lengths(point.iterate.final_time)
    by_adjoint = -half * flying.problem.angles[0].rate_limit * mu[:, 6]
    direct = target @ state_map(condensed)[-1, :4]
    assert by_adjoint == pytest.approx(direct[:-2], rel=1e-8, abs=1e-12)


def test_reduced_hessian_is_the_derivative_of_the_reduced_gradient(
    flying: Flight, point: Point, condensed: CondensedDynamics
) -> None:
    multipliers = random_multipliers(len(point.iterate.states))
    hessian = lagrangian_hessian(flying, point, condensed, multipliers)
    _, u, final_time = point.iterate.batch
    effort = np.zeros((1, *hessian.shape))
    add_rate_curvature(effort, flying.problem, flying.transcription, u, final_time)
    hessian -= effort[0]  # tested with the cost
    assert hessian == pytest.approx(hessian.T, abs=1e-10 * np.abs(hessian).max())
    for d in directions(len(hessian)):
        ahead = flown(flying, point, condensed, STEP * d)
        behind = flown(flying, point, condensed, -STEP * d)
        differenced = reduced_gradient(flying, ahead, multipliers)
        differenced -= reduced_gradient(flying, behind, multipliers)
        differenced /= 2.0 * STEP
        product = hessian @ d
        assert np.abs(differenced - product).max() < 1e-6 * np.abs(product).max()


def test_reduced_gradient_is_the_slope_of_the_weighted_sum(
    flying: Flight, point: Point, condensed: CondensedDynamics
) -> None:
    multipliers = random_multipliers(len(point.iterate.states))

    def weighted(at: Point) -> float:
        return float(
            multipliers.target @ at.target_error
            + np.sum(multipliers.limits * at.path)
            + multipliers.angles[0] @ at.iterate.states[:, 6]
        )

    gradient = reduced_gradient(flying, point, multipliers)
    for d in directions(len(gradient)):
        ahead = weighted(flown(flying, point, condensed, STEP * d))
        behind = weighted(flown(flying, point, condensed, -STEP * d))
        assert (ahead - behind) / (2.0 * STEP) == pytest.approx(
            gradient @ d, abs=1e-6 * np.abs(gradient).max()
        )


def test_what_is_read_of_the_state_map_is_the_state_map(condensed: CondensedDynamics) -> None:
    """Its end, rows of gradients over it and products with its transpose, each made another way."""
    whole, n = state_map(condensed), condensed.moving.shape[1]
    size = np.abs(whole).max()
    assert condensed.final_map[0] == pytest.approx(whole[-1], abs=1e-12 * size)
    longitude = condensed.longitude_map()[0]
    assert longitude == pytest.approx(whole[1:, 1], abs=1e-12 * size)
    rng = np.random.default_rng(13)
    gradient = rng.normal(size=(n - 1, 7))
    projected = condensed.projected(gradient[None], ONE)[0]
    exact = np.einsum("ij,ijz->z", gradient, whole[1:])
    assert np.abs(projected - exact).max() < 1e-11 * np.abs(exact).max()
    node, over_xt = np.array([0, 5, n - 1]), rng.normal(size=(3, 8))
    exact = np.einsum("ij,ijz->iz", over_xt[:, :7], whole[node])
    exact[:, -2] += 100.0 * over_xt[:, 7] * condensed.transcription.node_free[node]
    rows = condensed.rows(0, node, over_xt)
    assert np.abs(rows - exact).max() < 1e-11 * np.abs(exact).max()


def test_a_singular_segment_is_not_a_number_and_its_company_is() -> None:
    # one point of five states; the first state's row vanishes for the first of two cases
    jacobian = {(0, 0): np.array([[1.0], [0.5]])}
    inverses = _inverse(np.eye(5), jacobian, slice(0, 1), 2)
    assert np.isnan(inverses[0]).all()
    assert inverses[1] == pytest.approx(np.diag([2.0, 1.0, 1.0, 1.0, 1.0]), rel=1e-15)
