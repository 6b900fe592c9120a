"""The stop rule looks at whole batches only, and what looking costs is summed over every path."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.special import betaincinv

from ampi.simulation.estimates.proportions import Fraction
from ampi.simulation.estimates.stopping import StopRule, flights_needed, is_enough, stop_at

laws = settings(deadline=None, max_examples=60)


@laws
@given(
    share=st.floats(0.0, 1.0),
    width=st.floats(0.05, 0.5),
    batch=st.integers(1, 90),
    n=st.integers(0, 600),
    seed=st.integers(0, 99),
)
def test_it_stops_at_the_first_batch_that_is_narrow_enough(
    share: float, width: float, batch: int, n: int, seed: int
) -> None:
    rule = StopRule(5e3, width, batch)
    hits = np.random.default_rng(seed).random(n) < share
    widths = {k: Fraction.of(hits[:k]).width for k in range(batch, n + 1, batch)}
    stop = stop_at(hits, rule)
    assert stop == next((k for k, one in widths.items() if one <= width), None)
    assert is_enough(hits, rule) == (stop is not None)
    if stop is not None:  # as a campaign that flies on sees it, and one that has just landed
        assert stop_at(hits[:stop], rule) == stop
        assert not is_enough(hits[: stop - 1], rule)


def coverage(share: float, rule: StopRule) -> float:
    """How often the interval at the stop holds the share: exact, over all paths of counts."""
    paths, n, held = np.ones(1), 0, 0.0
    step = stats.binom.pmf(np.arange(rule.batch + 1), rule.batch, share)
    while paths.sum() > 1e-9:
        paths, n = np.convolve(paths, step), n + rule.batch
        k = np.arange(n + 1)
        low = np.where(k == 0, 0.0, betaincinv(np.maximum(k, 1), n - k + 1, 0.025))
        high = np.where(k == n, 1.0, betaincinv(k + 1, np.maximum(n - k, 1), 0.975))
        stop = high - low <= rule.width
        held += float(paths[stop & (low <= share) & (share <= high)].sum())
        paths = np.where(stop, 0.0, paths)
    return held


@pytest.mark.parametrize("share", [0.01, 0.036, 0.117, 0.3, 0.5, 0.964])
@pytest.mark.parametrize("width", [0.05, 0.1])
def test_looking_again_and_again_costs_a_percent_at_the_most(share: float, width: float) -> None:
    assert coverage(share, StopRule(5e3, width)) > 0.939


def test_looking_at_every_flight_costs_more() -> None:
    """The worst case of the rule, so that the docstring's warning is no formality."""
    assert coverage(0.117, StopRule(5e3, 0.1, batch=1)) < coverage(
        0.117, StopRule(5e3, 0.1, batch=100)
    )


@pytest.mark.parametrize(("share", "width"), [(0.0, 0.01), (0.5, 0.05), (0.9, 0.04), (1.0, 0.02)])
def test_the_flights_to_plan(share: float, width: float) -> None:
    rule = StopRule(5e3, width, batch=50)
    n = flights_needed(share, rule)
    assert n % 50 == 0
    assert Fraction.counted(round(share * n), n).width <= width
    before = n - 50
    assert before == 0 or Fraction.counted(round(share * before), before).width > width


def test_the_flights_to_plan_are_about_those_of_a_normal() -> None:
    """n = (2 · 1.96)² p (1 − p)/w²."""
    rule = StopRule(5e3, 0.02, batch=1)
    expected = (2.0 * 1.96 / 0.02) ** 2 * 0.3 * 0.7
    assert flights_needed(0.3, rule) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("width", [0.0, -0.1, 1.0, float("nan")])
def test_a_width_that_is_none(width: float) -> None:
    with pytest.raises(ValueError, match="width: expected a share between 0 and 1"):
        StopRule(5e3, width)


@pytest.mark.parametrize("batch", [0, -1, 2.5])
def test_a_batch_that_is_none(batch: int) -> None:
    with pytest.raises(ValueError, match="batch: expected a number of flights of at least 1"):
        StopRule(5e3, 0.1, batch)


def test_a_share_that_is_none() -> None:
    with pytest.raises(ValueError, match=r"share: expected a number from 0 to 1, got 1\.5"):
        flights_needed(1.5, StopRule(5e3, 0.1))
