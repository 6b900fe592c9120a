"""The tracking law u = u_ref − K (x − x_ref): linear, periodic, one flight or many."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.tracking.linear_quadratic import bank_rate_command, wrapped

Array = NDArray[np.float64]

laws = settings(deadline=None, max_examples=200)
LONGITUDE, AZIMUTH = 1, 5  # of h, θ, φ, V, γ, ψ, σ
seeds = st.integers(0, 2**32 - 1)
SIZES = np.array([1e5, 3.0, 1.5, 5e3, 0.3, 3.0, 1.0])


def drawn(seed: int, n: int = 1) -> tuple[Array, Array, Array, Array]:
    """Random state, reference state, bank rate and gain of n flights; angles well inside ±π."""
    rng = np.random.default_rng(seed)
    state, reference = (SIZES[:, None] * rng.uniform(-0.5, 0.5, (7, n)) for _ in range(2))
    return state, reference, rng.uniform(-0.1, 0.1, n), rng.standard_normal((7, n)) / SIZES[:, None]


@laws
@given(seed=seeds)
def test_the_law_is_u_ref_minus_gain_times_error(seed: int) -> None:
    x, r, u, k = (a[..., 0] for a in drawn(seed))
    assert bank_rate_command(x, r, u, k) == pytest.approx(u - float(k @ (x - r)), abs=1e-12)
    assert bank_rate_command(r, r, u, k) == u


@laws
@given(seed=seeds, factor=st.floats(-0.9, 0.9))
def test_the_correction_is_linear_in_the_error(seed: int, factor: float) -> None:
    x, r, u, k = (a[..., 0] for a in drawn(seed))
    whole = bank_rate_command(x, r, 0.0, k)
    assert bank_rate_command(r + factor * (x - r), r, u, k) - u == pytest.approx(
        factor * whole, abs=1e-12
    )
    assert bank_rate_command(x, r, u, factor * k) - u == pytest.approx(factor * whole, abs=1e-12)


@laws
@given(seed=seeds, n=st.integers(1, 12))
def test_a_batch_is_its_flights(seed: int, n: int) -> None:
    x, r, u, k = drawn(seed, n)
    x[AZIMUTH] += 2.0 * np.pi
    batch = bank_rate_command(x, r, u, k)
    assert batch.shape == (n,)
    for i in range(n):
        single = bank_rate_command(x[:, i], r[:, i], u[i], k[:, i])
        assert batch[i] == pytest.approx(float(single), rel=1e-14, abs=1e-14)


@laws
@given(seed=seeds, row=st.sampled_from([LONGITUDE, AZIMUTH]), turns=st.integers(-3, 3))
def test_whole_turns_of_longitude_and_azimuth_do_not_matter(
    seed: int, row: int, turns: int
) -> None:
    x, r, u, k = (a[..., 0] for a in drawn(seed))
    turned = x.copy()
    turned[row] += 2.0 * np.pi * turns
    expected = bank_rate_command(x, r, u, k)
    assert bank_rate_command(turned, r, u, k) == pytest.approx(expected, abs=1e-12)
    turned[row], reference = x[row], r.copy()
    reference[row] += 2.0 * np.pi * turns
    assert bank_rate_command(x, reference, u, k) == pytest.approx(expected, abs=1e-12)


@laws
@given(angle=st.floats(-50.0, 50.0))
def test_wrapping_keeps_the_direction_and_is_the_shortest(angle: float) -> None:
    got = wrapped(angle)
    assert abs(got) <= np.pi
    assert (np.cos(got), np.sin(got)) == pytest.approx((np.cos(angle), np.sin(angle)), abs=1e-13)


def test_nothing_that_is_given_is_written_to() -> None:
    given_arrays = drawn(3, 5)
    before = [a.copy() for a in given_arrays]
    bank_rate_command(*given_arrays)
    for a, b in zip(given_arrays, before, strict=True):
        assert np.array_equal(a, b)


@pytest.mark.parametrize("row", range(7))
@pytest.mark.parametrize(
    ("state", "reference", "error"),
    [(np.pi - 0.01, -np.pi + 0.02, -0.03), (-np.pi + 0.02, np.pi - 0.01, 0.03)],
)
def test_the_date_line_and_south_are_crossed_the_short_way_and_other_states_are_no_angles_of_place(
    row: int, state: float, reference: float, error: float
) -> None:
    x, r, k = np.zeros(7), np.zeros(7), np.zeros(7)
    x[row], r[row], k[row] = state, reference, 2.0
    expected = error if row in (LONGITUDE, AZIMUTH) else state - reference
    assert bank_rate_command(x, r, 0.5, k) == pytest.approx(0.5 - 2.0 * expected, abs=1e-14)


def test_flying_over_north_is_crossed_the_short_way() -> None:
    """Azimuth 359° against 1°."""
    x, r, k = np.zeros(7), np.zeros(7), np.zeros(7)
    x[AZIMUTH], r[AZIMUTH], k[AZIMUTH] = np.radians(359.0), np.radians(1.0), 1.0
    assert bank_rate_command(x, r, 0.0, k) == pytest.approx(np.radians(2.0), abs=1e-14)
