"""Each law of a world file against scipy.stats, and the bounds that a draw keeps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydantic import TypeAdapter
from scipy import stats

from ampi.simulation.distributions import LEAST, Law, TableColumn, law_as_written

Array = NDArray[np.float64]
LAW: TypeAdapter[Any] = TypeAdapter(Law)
laws = settings(deadline=None, max_examples=60)
MIDDLES = (np.arange(4000) + 0.5) / 4000

numbers = st.floats(-1e3, 1e3)
widths = st.floats(1e-3, 1e3)


def law(distribution: str, **fields: Any) -> Any:
    return LAW.validate_python({"distribution": distribution, **fields})


@laws
@given(mean=numbers, sigma=widths, u=st.floats(1e-12, 1.0 - 1e-12))
def test_normal_is_that_of_scipy(mean: float, sigma: float, u: float) -> None:
    drawn = law("normal", mean=mean, three_sigma=3.0 * sigma).quantiles(np.array([u]), 0.0)
    assert drawn == pytest.approx(stats.norm.ppf(u, mean, sigma), rel=1e-9, abs=1e-9)


@laws
@given(
    sigma=widths, low=st.floats(-5.0, 5.0), width=st.floats(0.1, 5.0), u=st.floats(1e-6, 1 - 1e-6)
)
def test_truncated_is_that_of_scipy(sigma: float, low: float, width: float, u: float) -> None:
    ends = {"low": 7.0 + low * sigma, "high": 7.0 + (low + width) * sigma}
    bell = law("truncated", mean=7.0, sigma=sigma, **ends)
    expected = stats.truncnorm.ppf(u, low, low + width, 7.0, sigma)
    assert bell.quantiles(np.array([u]), 0.0) == pytest.approx(expected, rel=1e-7, abs=1e-7 * sigma)


@pytest.mark.parametrize("bound", [{"low": 20.0}, {"high": -20.0}])
def test_a_far_tail_keeps_its_digits(bound: dict[str, float]) -> None:
    drawn = law("truncated", sigma=1.0, **bound).quantiles(MIDDLES, 0.0)
    low, high = bound.get("low", -np.inf), bound.get("high", np.inf)
    expected = stats.truncnorm.ppf(MIDDLES, low, high)
    assert drawn == pytest.approx(expected, rel=1e-9)
    assert len(np.unique(drawn)) == len(MIDDLES)


@laws
@given(low=numbers, width=widths, u=st.floats(0.0, 1.0))
def test_uniform_is_that_of_scipy(low: float, width: float, u: float) -> None:
    drawn = law("uniform", low=low, high=low + width).quantiles(np.array([u]), 0.0)
    assert drawn == pytest.approx(stats.uniform.ppf(u, low, width), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("shares", [None, (0.2, 0.5, 0.3), (0.0, 1.0, 0.0)])
def test_discrete_values_come_as_often_as_they_are_probable(shares: Any) -> None:
    values = (4.0, -1.0, 2.0)
    drawn = law("discrete", values=values, probabilities=shares).quantiles(MIDDLES, 0.0)
    for value, share in zip(values, shares or (1 / 3,) * 3, strict=True):
        assert np.mean(drawn == value) == pytest.approx(share, abs=1 / len(MIDDLES))


def test_moments_are_those_of_the_laws() -> None:
    for drawn, frozen in (
        (law("normal", three_sigma=0.6), stats.norm(1.0, 0.2)),
        (law("truncated", sigma=0.2, low=0.9), stats.truncnorm(-0.5, np.inf, 1.0, 0.2)),
        (law("uniform", low=-1.0, high=3.0), stats.uniform(-1.0, 4.0)),
    ):
        sample = drawn.quantiles(MIDDLES, 1.0)  # the nominal number is the mean of the bells
        assert sample.mean() == pytest.approx(frozen.mean(), abs=1e-3)
        assert sample.std() == pytest.approx(frozen.std(), rel=2e-3)


@laws
@given(
    kind=st.sampled_from(
        [
            {"distribution": "normal", "sigma": 0.5},
            {"distribution": "truncated", "sigma": 0.5, "low": 0.2, "high": 3.0},
            {"distribution": "truncated", "sigma": 0.5, "low": 0.2},
            {"distribution": "uniform", "low": -1.0, "high": 2.0},
            {"distribution": "discrete", "values": [3.0, 1.0]},
            2.5,
        ]
    ),
    cell=st.integers(0, 2**52 - 1),
)
def test_every_draw_is_finite_and_between_the_ends(kind: Any, cell: int) -> None:
    drawn = LAW.validate_python(kind)
    (value,) = drawn.quantiles(np.array([(cell + 0.5) * 2.0**-52]), 1.0)
    low, high = drawn.ends(1.0)
    assert np.isfinite([low, high]).all()
    assert low <= value <= high


def test_the_outermost_cells_are_the_ends() -> None:
    ends = law("normal", sigma=1.0).ends(0.0)
    assert ends == pytest.approx((stats.norm.ppf(LEAST), stats.norm.isf(LEAST)))


@pytest.mark.parametrize(
    "written",
    [
        2.5,
        {"distribution": "normal", "three_sigma": 70.0},
        {"distribution": "truncated", "mean": 1.0, "sigma": 0.1, "low": 0.5},
        {"distribution": "uniform", "low": 0.0, "high": 1.0},
        {"distribution": "discrete", "values": [1.0, 2.0], "probabilities": [0.5, 0.5]},
        {"distribution": "table", "file": "a.csv", "column": "lift"},
    ],
)
def test_a_law_is_written_as_it_was_read(written: Any) -> None:
    assert law_as_written(LAW.validate_python(written)) == written


def test_a_column_is_read_from_its_table_alone() -> None:
    assert isinstance(law("table", file="a.csv", column="lift"), TableColumn)
