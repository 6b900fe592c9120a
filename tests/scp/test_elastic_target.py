"""The elastic target: Huber's function by its definition, and the reference price."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ampi.scp.elastic_target import huber, is_elastic, reference_price

laws = settings(deadline=None, max_examples=200)
errors = st.floats(-10.0, 10.0)
weights = st.floats(0.1, 100.0)
prices = st.floats(0.1, 100.0)


def phi(error: float, weight: float, price: float) -> float:
    """One term of Eq. (2)."""
    return huber(np.array([error]), np.array([weight]), np.array([price]))


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
    assert huber(error, weight, price) == pytest.approx(sum(terms))
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
    # The greatest multiplier of target i over all shifts of cost ½ eᵀG⁻¹e = E is √(2 E (G⁻¹)_ii).
    shifts = rng.normal(size=(4, 400))
    cost = 0.5 * np.einsum("ik,ij,jk->k", shifts, inverse, shifts)
    largest = np.abs(inverse @ (shifts * np.sqrt(effort / cost))).max(axis=1)
    assert np.all(largest <= np.sqrt(2.0) * price * (1.0 + 1e-6))
    assert np.all(largest > 0.8 * np.sqrt(2.0) * price)


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
