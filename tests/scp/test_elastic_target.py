"""The elastic target: Huber's function by its definition, and the reference price."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.scp.condensed.elastic_target import (
    elastic_cost,
    held_targets,
    is_elastic,
    reference_price,
)
from ampi.scp.problem.scaled_problem import Target

laws = settings(deadline=None, max_examples=200)
errors = st.floats(-10.0, 10.0)
weights = st.floats(0.1, 100.0)
prices = st.floats(0.1, 100.0)


def weighted(weights: NDArray[np.float64]) -> Target:
    """Rows with weights and no bounds."""
    m = len(weights)
    return Target(np.arange(m), np.zeros(m), weights, np.full(m, -np.inf), np.full(m, np.inf))


def phi(error: float, weight: float, price: float) -> float:
    """One term of Eq. (2)."""
    return elastic_cost(np.array([error]), weighted(np.array([weight])), np.array([price]))


@laws
@given(error=errors, weight=weights, price=prices)
def test_huber_is_the_cheapest_split_into_met_and_bought_off(
    error: float, weight: float, price: float
) -> None:
    # Eq. (1): min over e of w e² + ν |error − e|.
    got = phi(error, weight, price)
    met = np.clip(error, -price / (2.0 * weight), price / (2.0 * weight))
    assert got == pytest.approx(weight * met**2 + price * abs(error - met), rel=1e-12, abs=1e-12)
    tried = np.linspace(-11.0, 11.0, 2001)
    split = weight * tried**2 + price * np.abs(error - tried)
    assert got <= split.min() + 1e-9 * (1.0 + got)


@laws
@given(weight=weights, price=prices, sign=st.sampled_from([-1.0, 1.0]))
def test_huber_and_its_slope_are_continuous_at_the_joint(
    weight: float, price: float, sign: float
) -> None:
    joint, step = sign * price / (2.0 * weight), 1e-6 * price / weight
    value = phi(joint, weight, price)
    assert value == pytest.approx(price**2 / (4.0 * weight), rel=1e-12)
    ahead, behind = phi(joint + step, weight, price), phi(joint - step, weight, price)
    assert (ahead - value) / step == pytest.approx(sign * price, rel=1e-5)
    assert (value - behind) / step == pytest.approx(sign * price, rel=1e-5)


@laws
@given(error=errors, weight=weights, price=prices)
def test_huber_never_exceeds_the_square_and_is_even(
    error: float, weight: float, price: float
) -> None:
    got = phi(error, weight, price)
    assert 0.0 <= got <= weight * error**2 * (1.0 + 1e-12)
    assert phi(-error, weight, price) == got
    assert phi(error, weight, 1e9) == pytest.approx(weight * error**2)


def test_huber_adds_up_over_the_targets() -> None:
    error = np.array([0.1, -3.0, 0.0, 2.0])
    weight, price = np.array([1.0, 2.0, 3.0, 4.0]), np.array([5.0, 1.0, 1.0, 20.0])
    terms = [phi(*row) for row in zip(error, weight, price, strict=True)]
    assert elastic_cost(error, weighted(weight), price) == pytest.approx(sum(terms))
    assert terms == pytest.approx([0.01, 3.0 - 0.125, 0.0, 16.0])


@laws
@given(seed=st.integers(0, 2**32 - 1), effort=st.floats(0.1, 100.0))
def test_reference_price_is_the_multiplier_of_the_reference_effort(
    seed: int, effort: float
) -> None:
    # min ½ uᵀQu with C u = e costs ½ eᵀG⁻¹e, its multiplier is −G⁻¹e.
    rng = np.random.default_rng(seed)
    c, q = rng.normal(size=(4, 12)), rng.uniform(0.5, 2.0, 12)
    inverse = np.linalg.inv(c @ np.diag(1.0 / q) @ c.T)
    price = reference_price(c, q, effort)
    assert price == pytest.approx(np.sqrt(effort * np.diag(inverse)), rel=1e-6)
    # The greatest multiplier of target i over all shifts of cost ½ eᵀG⁻¹e = E is √(2 E (G⁻¹)_ii), that
    # of a shift of target i alone.
    shifts = np.concatenate([rng.normal(size=(4, 400)), np.eye(4)], axis=1)
    cost = 0.5 * np.einsum("ik,ij,jk->k", shifts, inverse, shifts)
    largest = np.abs(inverse @ (shifts * np.sqrt(effort / cost))).max(axis=1)
    assert largest == pytest.approx(np.sqrt(2.0) * price, rel=1e-6)


def test_reference_price_does_not_depend_on_the_units_of_the_targets() -> None:
    rng = np.random.default_rng(6)
    c, q = rng.normal(size=(4, 9)), rng.uniform(0.5, 2.0, 9)
    units = np.array([1e4, 1.0, 1e-3, 1e6])
    scaled = reference_price(units[:, None] * c, q, 3.0)
    assert scaled * units == pytest.approx(reference_price(c, q, 3.0), rel=1e-6)


def test_a_multiplier_at_its_price_is_elastic() -> None:
    price = np.array([1.0, 2.0, 3.0, 4.0])
    got = is_elastic(np.array([0.5, -2.0, 2.96, 3.99]), price)
    assert got.tolist() == [False, True, False, True]


@laws
@given(error=errors, lower=st.floats(-3.0, 0.0), width=st.floats(0.0, 4.0), price=prices)
def test_a_bounded_row_costs_its_distance_from_the_range(
    error: float, lower: float, width: float, price: float
) -> None:
    row = Target(
        np.arange(1), np.zeros(1), np.zeros(1), np.array([lower]), np.array([lower + width])
    )
    got = elastic_cost(np.array([error]), row, np.array([price]))
    inside = np.clip(error, lower, lower + width)
    assert got == pytest.approx(price * abs(error - inside), rel=1e-12, abs=1e-12)


def test_what_holds_the_step() -> None:
    # Weighted, exact, at the edge of its range, inside it, and bought off.
    weight, edge = np.array([1.0, 0.0, 0.0, 0.0, 0.0]), np.array([np.inf, 0.0, 1.0, 1.0, 0.0])
    target = Target(np.arange(5), np.zeros(5), weight, -edge, edge)
    held = held_targets(target, np.array([0.0, 0.0, 0.3, 1e-9, 2.0]), np.full(5, 2.0))
    assert held.tolist() == [True, True, True, False, False]
