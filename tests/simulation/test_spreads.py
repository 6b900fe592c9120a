"""Percentiles and the mean of the worst, lost flights among them, against scipy and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from ampi.simulation.estimates.bootstrap import RESAMPLES, Estimate, mean_of, resampled_flights
from ampi.simulation.estimates.spreads import Sizes, mean_of_worst, percentile

laws = settings(deadline=None, max_examples=40)
misses = st.lists(st.floats(0.0, 1e6), min_size=1, max_size=60)
ESTIMATES = ("median", "percentile_90", "percentile_95", "percentile_99", "worst_mean")


def values(sizes: Sizes) -> np.ndarray:
    return np.array([getattr(sizes, name).value for name in ESTIMATES])


def limits(sizes: Sizes) -> np.ndarray:
    return np.array([(e.low, e.high) for e in (getattr(sizes, name) for name in ESTIMATES)])


@laws
@given(misses, st.integers(0, 10))
def test_a_size_knows_no_order_and_no_sign_and_scales(error: list[float], seed: int) -> None:
    size = np.array(error)
    shuffled = np.random.default_rng(seed).permutation(size) * (-1.0) ** np.arange(len(size))
    assert Sizes.of(shuffled) == Sizes.of(size)
    assert np.array_equal(values(Sizes.of(4.0 * size)), 4.0 * values(Sizes.of(size)))


@laws
@given(misses, st.integers(0, 59))
def test_a_flight_that_is_lost_makes_nothing_smaller(error: list[float], which: int) -> None:
    before, after = np.array(error), np.array(error)
    after[which % len(after)] = np.nan
    assert np.all(values(Sizes.of(after)) >= values(Sizes.of(before)) * (1.0 - 1e-12))
    assert Sizes.of(after).lost == 1
    assert Sizes.of(after).worst_mean.value == np.inf


@pytest.mark.parametrize("n", [1, 7, 19, 20, 21, 50, 99, 1000])
def test_percentiles_are_those_of_numpy_and_the_worst_lie_beyond(n: int) -> None:
    size = np.random.default_rng(n).exponential(size=n)
    witness = np.percentile(size, [50, 90, 95, 99])
    got = Sizes.of(size)
    assert values(got)[:4] == pytest.approx(witness, rel=1e-12)
    assert got.percentile_95.value <= got.worst_mean.value <= size.max()


def test_the_mean_of_the_worst_counts_a_part_of_a_flight() -> None:
    """Of 30 flights the worst 5 % are one and a half; of ten they are the worst."""
    assert mean_of_worst(np.arange(30.0))[0] == pytest.approx((29.0 + 0.5 * 28.0) / 1.5)
    assert mean_of_worst(np.arange(10.0))[0] == 9.0


def test_the_mean_of_the_worst_of_a_normal() -> None:
    """φ(z)/β with z the 95 % quantile."""
    normal = np.sort(np.random.default_rng(1).standard_normal(200_000))
    expected = stats.norm.pdf(stats.norm.ppf(0.95)) / 0.05
    assert mean_of_worst(normal)[0] == pytest.approx(expected, abs=0.02)


def test_lost_flights_are_infinite_where_they_fall() -> None:
    """Four of a hundred: the 95th percentile lies before them, the 99th among them."""
    size = np.arange(100.0)
    size[[3, 30, 60, 90]] = np.nan, np.inf, -np.inf, np.nan
    got = Sizes.of(size)
    assert (got.n, got.lost) == (100, 4)
    assert np.isfinite(values(got)).tolist() == [True, True, True, False, False]
    assert np.isfinite(got.percentile_90.low)
    assert got.percentile_95.high == np.inf  # more of them may have been lost
    assert str(got.percentile_99).startswith("inf [")


def test_when_every_flight_is_lost_everything_is_infinite() -> None:
    got = Sizes.of(np.full(40, np.nan))
    assert got.lost == 40
    assert np.all(values(got) == np.inf)
    assert np.all(limits(got) == np.inf)


def test_flights_that_are_alike_leave_no_doubt() -> None:
    got = Sizes.of(np.full(400, 7.0))
    assert np.all(values(got) == 7.0)
    assert np.all(limits(got) == 7.0)


def test_no_flights_are_refused() -> None:
    with pytest.raises(ValueError, match="expected one number per flight, got none"):
        Sizes.of(np.empty(0))


def test_the_percentile_intervals_are_those_of_scipy() -> None:
    size = np.random.default_rng(8).exponential(size=400)
    got = Sizes.of(size)
    for name, share in zip(ESTIMATES[:3], (50, 90, 95), strict=False):
        witness = stats.bootstrap(
            (size,),
            lambda x, axis, share=share: np.percentile(x, share, axis=axis),
            n_resamples=2000,
            method="percentile",
            rng=np.random.default_rng(3),
        ).confidence_interval
        one = getattr(got, name)
        assert (one.low, one.high) == pytest.approx((witness.low, witness.high), rel=0.05)


def test_the_interval_of_a_median_follows_the_binomial() -> None:
    """Efron: P(median* ≤ x₍ⱼ₎) is that of more than half of n draws among the j smallest of n."""
    n = 101
    rank = np.arange(1, n + 1)
    below = stats.binom.sf(n // 2, n, rank / n)
    low, high = np.searchsorted(below, [0.025, 0.975])
    got = Sizes.of(np.arange(float(n))).median
    assert abs(got.low - low) <= 1
    assert abs(got.high - high) <= 1


def test_the_error_of_the_mean_of_the_worst_is_what_it_scatters() -> None:
    """Eq. (2) against the spread over 4000 campaigns."""
    campaigns = np.sort(np.random.default_rng(5).exponential(size=(4000, 400)), axis=1)
    value, error = mean_of_worst(campaigns)
    assert np.sqrt(np.mean(error**2)) == pytest.approx(value.std(), rel=0.06)


def test_the_interval_of_the_worst_holds_as_often_as_it_claims() -> None:
    """Exponential misses, 200 flights: CVaR is 1 + ln 20; about 93 % (percentiles alone: 87 %)."""
    truth = 1.0 + np.log(20.0)
    rng = np.random.default_rng(11)
    campaigns = [Sizes.of(rng.exponential(size=200), seed).worst_mean for seed in range(200)]
    held = sum(e.low <= truth <= e.high for e in campaigns)
    assert stats.binomtest(held, 200, 0.93).pvalue > 0.001


def test_a_campaign_always_gets_the_same_interval_and_another_seed_another() -> None:
    size = np.random.default_rng(2).exponential(size=300)
    assert Sizes.of(size) == Sizes.of(size)
    assert Sizes.of(size, 1).worst_mean != Sizes.of(size, 2).worst_mean


@pytest.mark.parametrize("n", [1, 1000, 65536, 65537, 3_000_000])
def test_memory_does_not_grow_with_the_flights(n: int) -> None:
    block = next(resampled_flights(n, 0))
    assert block.shape[1] == n
    assert block.size <= max(2_000_000, n)
    assert int(block.max()) < n


def test_all_resamples_are_drawn() -> None:
    assert sum(len(block) for block in resampled_flights(3001, 4)) == RESAMPLES


def test_the_mean_has_the_interval_of_the_central_limit() -> None:
    saturation = np.random.default_rng(6).uniform(size=2000)
    got, error = mean_of(saturation), saturation.std() / np.sqrt(2000)
    assert got.value == saturation.mean()
    assert (got.low, got.high) == pytest.approx(
        (got.value - 1.96 * error, got.value + 1.96 * error), abs=0.2 * error
    )
    with pytest.raises(ValueError, match="expected finite numbers, one per flight"):
        mean_of(np.array([1.0, np.nan]))


def test_percentiles_beside_an_infinite_flight() -> None:
    rising = np.array([0.0, 1.0, np.inf])
    assert percentile(rising, 0.5) == 1.0
    assert percentile(rising, 0.51) == np.inf
    assert Estimate.between(1.0, rising) == Estimate(1.0, 0.0, np.inf)
