"""A delayed signal is the signal some time ago: linear between samples, of each flight its own."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.simulation.delay import Delay

Array = NDArray[np.float64]

laws = settings(deadline=None, max_examples=100)
seeds = st.integers(0, 2**32 - 1)


@laws
@given(
    delays=st.lists(st.one_of(st.floats(0.0, 5.0), st.sampled_from([0.0, 1.0, 2.0])), min_size=1),
    fractions=st.lists(st.sampled_from([0.0, 0.25, 1.0 / 3.0, 0.5, 1.0]), min_size=12, max_size=12),
    seed=seeds,
)
def test_it_is_numpys_interpolation_of_what_has_been(
    delays: list[float], fractions: list[float], seed: int
) -> None:
    n = len(delays)
    first, *samples = np.random.default_rng(seed).standard_normal((13, 2, n))
    delay = Delay(np.array(delays), first)
    # sample k is reached when k periods have passed; before the first it has been `first`
    times, past = np.arange(-20.0, 13.0), np.array([first] * 21 + samples)
    for k, (sample, fraction) in enumerate(zip(samples, fractions, strict=True)):
        delay.push(sample)
        got = delay.value(fraction)
        assert got.shape == (2, n)
        for i in range(n):
            for row in (0, 1):
                then = k + fraction - delays[i]
                expected = np.interp(then, times[: k + 22], past[: k + 22, row, i])
                assert got[row, i] == pytest.approx(expected, abs=1e-12)


@laws
@given(delays=st.lists(st.floats(0.0, 4.0), min_size=4, max_size=4), seed=seeds)
def test_a_flight_has_the_same_bits_alone_and_in_company(delays: list[float], seed: int) -> None:
    first, *samples = np.random.default_rng(seed).standard_normal((9, 3, 4))
    together = Delay(np.array(delays), first)
    alone = [Delay(np.array(delays[i : i + 1]), first[:, i : i + 1]) for i in range(4)]
    for k, sample in enumerate(samples):
        fraction = 1.0 - k / 8.0
        together.push(sample)
        expected = together.value(fraction)
        for i, one in enumerate(alone):
            one.push(sample[:, i : i + 1])
            assert np.array_equal(one.value(fraction)[:, 0], expected[:, i])


def test_whole_periods_give_back_the_samples_to_the_bit() -> None:
    samples = np.random.default_rng(0).standard_normal((10, 7, 3))
    delay = Delay(np.array([0.0, 1.0, 3.0]), samples[0])
    for k, sample in enumerate(samples):
        delay.push(sample)
        expected = [samples[max(k - back, 0)][:, i] for i, back in enumerate((0, 1, 3))]
        assert np.array_equal(delay.value(), np.stack(expected, axis=1))
