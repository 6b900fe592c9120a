"""Rank correlations and Sobol indices: scipy, the Ishigami function, and what lost flights do."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from ampi.simulation.estimates.sensitivity import (
    SobolDesign,
    rank_correlations,
    sobol_design,
    sobol_from,
)

ANGLES = ("x1", "x2", "x3")


def ishigami(uniforms: np.ndarray) -> np.ndarray:
    x = np.pi * (2.0 * uniforms - 1.0)
    return np.sin(x[:, 0]) * (1.0 + 0.1 * x[:, 2] ** 4) + 7.0 * np.sin(x[:, 1]) ** 2


def ishigami_indices() -> tuple[np.ndarray, np.ndarray]:
    """Closed forms, a = 7, b = 0.1."""
    a, b = 7.0, 0.1
    first = np.array([0.5 * (1.0 + b * np.pi**4 / 5.0) ** 2, a**2 / 8.0, 0.0])
    shared = b**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    variance = first.sum() + shared
    return first / variance, (first + np.array([shared, 0.0, shared])) / variance


# --- rank correlations ----------------------------------------------------------------------------


def test_they_are_those_of_scipy_ties_included() -> None:
    rng = np.random.default_rng(0)
    inputs = np.column_stack([rng.standard_normal(200), rng.integers(0, 4, 200)])
    miss = np.exp(inputs @ [0.5, -0.7] + rng.standard_normal(200)).round(1)
    got = rank_correlations(inputs, miss, ["wind", "season"])
    for name, values in zip(got, inputs.T, strict=True):
        assert got[name].value == pytest.approx(stats.spearmanr(values, miss).statistic, abs=1e-12)
        assert got[name].low < got[name].value < got[name].high


def test_their_intervals_hold_as_often_as_they_claim() -> None:
    """Bivariate normal: Spearman's ρ is 6/π asin(r/2)."""
    rng, r, n = np.random.default_rng(1), 0.6, 80
    truth = 6.0 / np.pi * np.arcsin(r / 2.0)
    held = 0
    for _ in range(400):
        x, noise = rng.standard_normal((2, n))
        y = r * x + np.sqrt(1.0 - r * r) * noise
        one = rank_correlations(x[:, None], y, ["x"])["x"]
        held += one.low <= truth <= one.high
    assert stats.binomtest(held, 400, 0.95).pvalue > 0.001


def test_a_linear_miss_ranks_its_inputs_by_their_weight() -> None:
    uniforms = np.random.default_rng(2).random((4000, 4))
    got = rank_correlations(uniforms, uniforms @ [4.0, -2.0, 1.0, 0.0], list("abcd"))
    assert got["a"].value == pytest.approx(4.0 / np.sqrt(21.0), abs=0.03)
    assert got["b"].value == pytest.approx(-2.0 / np.sqrt(21.0), abs=0.04)
    assert got["c"].low > 0.0
    assert got["d"].low < 0.0 < got["d"].high


def test_a_lost_flight_ranks_as_the_farthest() -> None:
    inputs = np.random.default_rng(3).random((50, 2))
    miss = inputs @ [1.0, 2.0]
    far, lost, nan = miss.copy(), miss.copy(), miss.copy()
    far[4], lost[4], nan[4] = 1e9, np.inf, np.nan
    expected = rank_correlations(inputs, far, ["a", "b"])
    assert rank_correlations(inputs, lost, ["a", "b"]) == expected
    assert rank_correlations(inputs, nan, ["a", "b"]) == expected


def test_perfect_and_no_correlation() -> None:
    ramp = np.arange(10.0)
    inputs = np.column_stack([ramp**3, -ramp, np.ones(10)])
    got = rank_correlations(inputs, np.exp(ramp), ["up", "down", "still"])
    assert (got["up"].value, got["up"].low, got["up"].high) == (1.0, 1.0, 1.0)
    assert (got["down"].value, got["down"].low, got["down"].high) == (-1.0, -1.0, -1.0)
    assert np.isnan([got["still"].value, got["still"].low, got["still"].high]).all()


@pytest.mark.parametrize(("n", "m", "names"), [(3, 1, 1), (9, 2, 1), (9, 1, 2)])
def test_arrays_that_do_not_belong_together(n: int, m: int, names: int) -> None:
    with pytest.raises(ValueError, match=r"expected inputs \(n, m\), outputs \(n,\) and m names"):
        rank_correlations(np.ones((n, m)), np.ones(n), list("abc")[:names])


# --- Sobol indices --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def design() -> SobolDesign:
    return sobol_design(1024, ANGLES, 7)


def test_the_design_mixes_one_column_at_a_time(design: SobolDesign) -> None:
    n, m = design.rows, 3
    assert (n, design.uniforms.shape) == (1024, (1024 * 5, 3))
    a, b, *mixed = design.uniforms.reshape(m + 2, n, m)
    for i, page in enumerate(mixed):
        others = np.delete(np.arange(m), i)
        assert np.array_equal(page[:, i], b[:, i])
        assert np.array_equal(page[:, others], a[:, others])
    assert design.uniforms.min() > 0.0
    assert design.uniforms.max() < 1.0
    assert stats.kstest(a.ravel(), "uniform").pvalue > 0.5  # more even than random numbers
    assert np.abs(np.corrcoef(a.T, b.T) - np.eye(6)).max() < 0.02


def test_the_design_is_frozen_by_its_seed(design: SobolDesign) -> None:
    assert np.array_equal(design.uniforms, sobol_design(1024, ANGLES, 7).uniforms)
    assert not np.any(design.uniforms == sobol_design(1024, ANGLES, 8).uniforms)


def test_the_ishigami_function(design: SobolDesign) -> None:
    got = sobol_from(design, ishigami(design.uniforms), "plain")
    for found, expected in zip((got.first, got.total), ishigami_indices(), strict=True):
        for name, truth in zip(ANGLES, expected, strict=True):
            assert found[name].low < truth < found[name].high
            assert found[name].value == pytest.approx(truth, abs=0.03)
            assert found[name].high - found[name].low < 0.25
    assert got.lost == 0


def test_values_and_intervals_are_those_of_scipy(design: SobolDesign) -> None:
    f = ishigami(design.uniforms)
    pages = f.reshape(5, 1, 1024)
    witness = stats.sobol_indices(
        func={"f_A": pages[0], "f_B": pages[1], "f_AB": pages[2:]}, n=1024
    )
    got = sobol_from(design, f, "plain")
    for found, expected in ((got.first, witness.first_order), (got.total, witness.total_order)):
        assert [e.value for e in found.values()] == pytest.approx(expected.tolist(), rel=1e-9)
    scipys = witness.bootstrap()  # BCa, on its own draws
    for found, expected in ((got.first, scipys.first_order), (got.total, scipys.total_order)):
        assert [e.high - e.low for e in found.values()] == pytest.approx(
            np.subtract(*expected.confidence_interval[::-1]).tolist(), rel=0.25
        )


def test_an_additive_miss_has_no_interactions_and_an_idle_input_none_at_all() -> None:
    design = sobol_design(512, ["a", "b", "idle"], 3)
    got = sobol_from(design, np.exp(design.uniforms @ [3.0, 4.0, 0.0]))  # the logarithm is linear
    assert got.first["a"].value == pytest.approx(9.0 / 25.0, abs=0.02)
    assert got.total["a"].value == pytest.approx(9.0 / 25.0, abs=0.02)
    assert got.total["b"].value == pytest.approx(16.0 / 25.0, abs=0.02)
    assert (got.first["idle"].value, got.total["idle"].value) == (0.0, 0.0)
    assert (got.total["idle"].low, got.total["idle"].high) == (0.0, 0.0)


def test_a_few_far_flights_decide_everything_on_the_plain_scale_alone() -> None:
    design = sobol_design(1024, ["a", "b"], 5)
    u = design.uniforms
    miss = 100.0 * np.exp(4.0 * u[:, 0]) * np.where(u[:, 1] > 0.99, 1e4, 1.0)
    plain, robust, rank = (
        sobol_from(design, miss, scale) for scale in ("plain", "logarithm", "rank")
    )
    assert plain.total["b"].value > 0.9
    for other in (robust, rank):
        assert other.first["a"].value > 0.5 > other.first["b"].value
    assert rank == sobol_from(design, miss**2, "rank")  # knows no scale


@pytest.mark.parametrize("scale", ["plain", "logarithm", "rank"])
def test_lost_flights_count_as_the_farthest_that_arrived(scale: str) -> None:
    design = sobol_design(256, ["a", "b"], 6)
    miss = np.exp(3.0 * design.uniforms @ [1.0, 2.0])
    lost = miss > np.quantile(miss, 0.98)
    got = sobol_from(design, np.where(lost, np.nan, miss), scale)
    assert got.lost == np.count_nonzero(lost)
    capped = sobol_from(design, np.minimum(miss, miss[~lost].max()), scale)
    assert got.first == capped.first
    assert got.total == capped.total


def test_what_cannot_be_a_design_or_its_output(design: SobolDesign) -> None:
    with pytest.raises(ValueError, match="n: expected a power of 2, got 1000"):
        sobol_design(1000, ["a"], 0)
    with pytest.raises(ValueError, match=r"expected 5120 numbers of this design, got \(7,\)"):
        sobol_from(design, np.ones(7))
    for useless in (np.full(5120, np.nan), np.ones(5120)):
        with pytest.raises(ValueError, match="expected flights that arrived and differ"):
            sobol_from(design, useless)
    with pytest.raises(ValueError, match="expected logarithm, rank or plain, got 'log'"):
        sobol_from(design, ishigami(design.uniforms), "log")  # type: ignore[arg-type]
