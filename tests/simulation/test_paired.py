"""Two schemes on the same draws: tests and intervals against scipy, enumeration and their symmetries."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from ampi.simulation.estimates.paired import Flown, paired, share_difference
from ampi.simulation.estimates.proportions import Fraction

laws = settings(deadline=None, max_examples=40)


def flown(miss: np.ndarray) -> Flown:
    return Flown(np.arange(2.0 * len(miss)).reshape(-1, 2), miss)


def table(a: int, b: int, c: int, d: int) -> tuple[np.ndarray, np.ndarray]:
    """Truth values of flights that both, only the first, only the second, and neither bring there."""
    first = np.repeat([True, True, False, False], (a, b, c, d))
    return first, np.repeat([True, False, True, False], (a, b, c, d))


counts = st.integers(0, 40)


@laws
@given(counts, counts, counts, st.integers(1, 40))
def test_the_shares_of_two_schemes_mirror_each_other(a: int, b: int, c: int, d: int) -> None:
    one, other = share_difference(*table(a, b, c, d)), share_difference(*table(a, c, b, d))
    assert one.difference.value == pytest.approx((b - c) / (a + b + c + d), abs=1e-12)
    assert (one.first_alone, one.second_alone) == (b, c)
    assert one.p_value == other.p_value
    assert (one.difference.low, one.difference.high) == pytest.approx(
        (-other.difference.high, -other.difference.low), abs=1e-12
    )
    assert -1.0 - 1e-12 <= one.difference.low <= one.difference.value <= one.difference.high
    assert one.difference.high <= 1.0 + 1e-12


@pytest.mark.parametrize(("b", "c"), [(5, 1), (12, 12), (0, 9), (30, 17)])
def test_mcnemar_is_the_two_tails_of_a_fair_coin(b: int, c: int) -> None:
    fewer, n = min(b, c), b + c
    tail = sum(float(stats.binom.pmf(k, n, 0.5)) for k in range(fewer + 1))
    assert share_difference(*table(20, b, c, 3)).p_value == pytest.approx(min(1.0, 2.0 * tail))


@pytest.mark.parametrize(
    "shares", [(0.5, 0.2, 0.1, 0.2), (0.8, 0.1, 0.02, 0.08), (0.3, 0.3, 0.3, 0.1)]
)
def test_the_interval_of_a_difference_covers_as_often_as_it_claims(
    shares: tuple[float, ...],
) -> None:
    """Exact: the multinomial probability of every table whose interval holds the difference."""
    n, covered = 20, 0.0
    for a, b, c in itertools.product(range(n + 1), repeat=3):
        if (d := n - a - b - c) >= 0:
            interval = share_difference(*table(a, b, c, d)).difference
            if interval.low <= shares[1] - shares[2] <= interval.high:
                covered += float(stats.multinomial.pmf([a, b, c, d], n, shares))
    assert 0.93 < covered < 0.995


def test_pairs_that_agree_narrow_the_interval() -> None:
    together = share_difference(*table(50, 6, 2, 42)).difference
    apart = share_difference(*table(28, 28, 24, 20)).difference  # the same shares
    assert together.value == pytest.approx(apart.value)
    assert together.high - together.low < 0.5 * (apart.high - apart.low)


def test_a_scheme_against_itself() -> None:
    miss = np.random.default_rng(0).exponential(size=200)
    got = paired(flown(miss), flown(miss.copy()), [0.1, 1.0])
    assert (got.n, got.p_value) == (200, 1.0)
    assert (got.median.value, got.median.low, got.median.high) == (0.0, 0.0, 0.0)
    for share in got.within.values():
        assert (share.difference.value, share.p_value) == (0.0, 1.0)


def test_a_shift_is_found_exactly_and_by_every_sign() -> None:
    miss = np.random.default_rng(1).exponential(1024.0, size=300).round()
    got = paired(flown(miss), flown(miss + 64.0), [500.0])
    assert (got.median.value, got.median.low, got.median.high) == (-64.0, -64.0, -64.0)
    assert got.p_value < 1e-40
    assert got.within[500.0].second_alone == 0
    expected = Fraction.of(miss < 500.0).count - Fraction.of(miss + 64.0 < 500.0).count
    assert got.within[500.0].first_alone == expected


def test_wilcoxon_is_that_of_scipy() -> None:
    rng = np.random.default_rng(2)
    first, second = rng.exponential(size=(2, 120))
    got = paired(flown(first), flown(1.2 * second))
    assert got.p_value == pytest.approx(stats.wilcoxon(first, 1.2 * second).pvalue, rel=1e-12)


def test_a_lost_flight_is_farther_than_all_and_two_lost_decide_nothing() -> None:
    rng = np.random.default_rng(3)
    first, second = rng.exponential(size=(2, 60))
    lost, far = first.copy(), first.copy()
    lost[5], far[5] = np.nan, 1e9
    assert paired(flown(lost), flown(second)).p_value == pytest.approx(
        paired(flown(far), flown(second)).p_value, rel=1e-12
    )
    both = paired(flown(np.r_[first, np.nan]), flown(np.r_[second, np.inf]), [1e9])
    assert both.p_value == pytest.approx(paired(flown(first), flown(second)).p_value, rel=1e-12)
    assert both.n == 61
    assert both.within[1e9].difference.value == 0.0


def test_medians_that_are_infinite() -> None:
    arrived, lost = np.arange(20.0), np.full(20, np.nan)
    got = paired(flown(arrived), flown(lost), [10.0])
    assert (got.median.value, got.median.low, got.median.high) == (-np.inf, -np.inf, -np.inf)
    assert got.within[10.0].difference.value == 0.5
    assert np.isnan(paired(flown(lost), flown(lost)).median.value)


def test_what_the_draws_have_in_common_is_removed() -> None:
    """Halves of one and the same scatter: the pairs see a tenth of what they scatter."""
    rng = np.random.default_rng(4)
    common = rng.exponential(1000.0, size=500)
    got = paired(flown(common + rng.normal(0.0, 10.0, 500)), flown(common)).median
    assert got.high - got.low < 0.5 * 2 * 1.96 * 1000.0 * np.sqrt(2.0 / 500)


def test_different_draws_are_refused() -> None:
    miss = np.arange(5.0)
    other = Flown(np.arange(10.0).reshape(-1, 2) + 1e-12, miss)
    with pytest.raises(
        ValueError, match="expected two schemes on the same draws, got 5 and 5 draws"
    ):
        paired(flown(miss), other)
    with pytest.raises(ValueError, match="got 5 and 4 draws"):
        paired(flown(miss), flown(miss[:4]))


@pytest.mark.parametrize("shape", [(0,), (3,), (2, 2)])
def test_draws_and_misses_that_do_not_belong_together(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"flown: expected draws \(n, d\) and misses \(n,\)"):
        Flown(np.zeros((2, 1)), np.zeros(shape))
