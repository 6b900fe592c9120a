"""Price and penalty over a run: start, relief, restoration, growth."""

from __future__ import annotations

import numpy as np
import pytest

from ampi.scp.condensed.elastic_target import ElasticSettings
from ampi.scp.condensed.merit_weights import MeritWeights, ReliefSettings
from ampi.scp.problem.penalty import PenaltySettings
from ampi.scp.problem.scaled_problem import Target

LOW = np.array([0.1, -0.2])
LIMITS = np.array([[0.0, 0.1], [0.3, 0.0]])


@pytest.fixture
def weights() -> MeritWeights:
    """Two rows to be met exactly, started."""
    zero = np.zeros(2)
    target = Target(np.arange(2), zero, zero, zero, zero)
    made = MeritWeights(target, ElasticSettings(), PenaltySettings(), ReliefSettings())
    made.start(np.eye(2, 5), np.ones(5), 50.0, zero)
    return made


def settle(weights: MeritWeights, multiplier: np.ndarray) -> None:
    for _ in range(ReliefSettings().after + 1):
        weights.accept(multiplier, multiplier, LIMITS)


def test_the_start_is_the_reference_price(weights: MeritWeights) -> None:
    assert weights.price == pytest.approx(0.6 * np.sqrt(2.0 * 50.0) * np.ones(2), rel=1e-6)
    assert weights.penalty == 20.0 * 50.0


def test_weights_come_down_to_a_multiple_of_the_multipliers(weights: MeritWeights) -> None:
    first = weights.price
    weights.accept(LOW, LOW, LIMITS)
    assert np.array_equal(weights.price, first)  # not at once
    settle(weights, LOW)
    assert weights.price == pytest.approx(10.0 * np.abs(LOW))
    assert weights.penalty == pytest.approx(0.03 * 1000.0)
    settle(weights, 1e-6 * LOW)
    assert weights.price == pytest.approx(0.03 * first)


def test_a_row_that_is_bought_off_gets_its_first_price_back_for_good(weights: MeritWeights) -> None:
    first = weights.price
    settle(weights, LOW)
    cheap = weights.price
    elastic = np.array([cheap[0], 0.0])
    weights.accept(LOW, elastic, LIMITS)
    assert weights.price == pytest.approx([first[0], cheap[1]])
    settle(weights, 1e-6 * LOW)
    assert weights.price[0] == first[0]


def test_growth_is_not_taken_back(weights: MeritWeights) -> None:
    grown = weights.price * np.array([100.0, 1.0])
    assert weights.grow(np.array([weights.price[0], 0.0]), np.zeros(2))
    assert weights.price == pytest.approx(grown)
    settle(weights, LOW)
    assert weights.price[0] == grown[0]
    assert not weights.grow(np.zeros(2), np.zeros(2))
    before = weights.penalty
    assert weights.grow(np.zeros(2), np.array([0.0, 1e-3]))
    assert weights.penalty == 10.0 * before


def test_a_limit_that_reaches_a_relieved_penalty_gets_the_first_one_back(
    weights: MeritWeights,
) -> None:
    settle(weights, LOW)
    assert weights.penalty < 1000.0
    weights.accept(LOW, LOW, np.array([[0.5 * weights.penalty], [0.5 * weights.penalty]]))
    assert weights.penalty == 1000.0
    settle(weights, LOW)
    assert weights.penalty == 1000.0
