"""Noise over altitude: its law at each, its correlation between two; tables of the air."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from ampi.simulation.air_tables import (
    density_of,
    density_over_altitude,
    drawn_air,
    in_months,
    wind_of,
    wind_over_altitude,
)
from ampi.simulation.csv_table import CsvTable, read_csv_table
from ampi.simulation.profiles import (
    ALTITUDES,
    correlated_noise,
    density_noise,
    on_altitudes,
    wind_noise,
)

Array = NDArray[np.float64]
N = 6000


def seeds(n: int) -> Array:
    return np.random.default_rng(11).random(n)


def same(value: float, n: int = N) -> Array:
    return np.full(n, value)


@pytest.mark.parametrize("length", [2e3, 10e3, 40e3])
def test_noise_is_stationary_and_its_correlation_falls_exponentially(length: float) -> None:
    (z,) = correlated_noise(seeds(N), same(length))
    for k in (0, 1, 20, 130):
        assert stats.kstest(z[:, k], "norm").pvalue > 1e-3
    for lag in (1, 5, 15):
        expected = np.exp(-lag * 1e3 / length)
        for k in (0, 60):
            found = np.corrcoef(z[:, k], z[:, k + lag])[0, 1]
            assert found == pytest.approx(
                expected, abs=4.0 * (1.0 - expected**2) / np.sqrt(N) + 1e-4
            )


@pytest.mark.parametrize("deviation", [0.03, 0.3, 1.5])
def test_density_is_positive_of_mean_one_and_of_the_deviation_asked(deviation: float) -> None:
    factor = density_noise(seeds(N), same(deviation), same(10e3))
    assert factor.min() > 0.0
    ends = factor[:, [0, 40, 80, 120]]  # four correlation lengths apart: nearly independent
    if deviation < 1.0:  # the deviation of a long tail is known badly from a sample
        assert ends.mean() == pytest.approx(1.0, abs=4.0 * deviation / np.sqrt(ends.size))
        assert ends.std() == pytest.approx(deviation, rel=0.05)
    logarithm = np.log1p(deviation**2)
    expected = stats.norm(-0.5 * logarithm, np.sqrt(logarithm))
    assert stats.kstest(np.log(ends[:, 1]), expected.cdf).pvalue > 1e-3


def test_both_components_of_the_wind_are_independent() -> None:
    wind = wind_noise(seeds(N), same(20.0), same(15e3))
    assert wind.shape == (2, N, len(ALTITUDES))
    assert wind[:, :, 50].std(axis=1) == pytest.approx([20.0, 20.0], rel=0.04)
    assert abs(np.corrcoef(wind[0, :, 50], wind[1, :, 50])[0, 1]) < 4.0 / np.sqrt(N)


def test_each_flight_has_a_deviation_and_a_length_of_its_own() -> None:
    u, deviation, length = seeds(3), np.array([0.1, 0.0, 0.2]), np.array([5e3, 10e3, 20e3])
    together = density_noise(u, deviation, length)
    assert np.all(together[1] == 1.0)
    for i in range(3):
        alone = density_noise(u[i : i + 1], deviation[i : i + 1], length[i : i + 1])
        assert np.array_equal(alone[0], together[i])


def test_between_the_altitudes_of_a_table_it_is_linear_and_beyond_constant() -> None:
    knots = np.array([5e3, 20e3, 61.5e3])
    values = np.array([[1.0, 4.0, -2.0], [0.0, 1.0, 0.0]])
    found = on_altitudes(knots, values)
    assert found == pytest.approx(np.array([np.interp(ALTITUDES, knots, row) for row in values]))


def test_tables_multiply_in_density_and_add_in_wind() -> None:
    altitudes = np.array([0.0, 130e3])
    density = CsvTable("d.csv", ("altitude_m", "factor"), np.array([altitudes, [1.0, 4.0]]).T)
    names = ("altitude_m", "east_m_per_s", "north_m_per_s")
    wind = CsvTable("w.csv", names, np.array([altitudes, [0.0, 13.0], [5.0, 5.0]]).T)
    draws = CsvTable("r.csv", ("density_0km", "density_130km"), np.array([[2.0, 2.0], [3.0, 3.0]]))
    tables = [density_over_altitude(density), wind_over_altitude(wind), drawn_air(draws)]
    uniforms = {"row of r.csv": np.array([0.1, 0.9])}
    found, blown = density_of(tables, uniforms, 2), wind_of(tables, uniforms, 2)
    assert found is not None
    assert blown is not None
    expected = np.outer([2.0, 3.0], 4.0 ** (ALTITUDES / 130e3))
    assert found == pytest.approx(expected)
    assert blown[0] == pytest.approx(np.tile(ALTITUDES * 1e-4, (2, 1)))
    assert np.all(blown[1] == 5.0)
    assert wind_of([tables[0]], uniforms, 2) is None
    assert density_of([tables[1]], uniforms, 2) is None


@pytest.mark.parametrize(
    ("day", "month"),
    [(1.0, 1), (31.9, 1), (32.0, 2), (59.0, 2), (60.0, 3), (365.0, 12), (366.0, 12)],
)
def test_a_day_lies_in_its_month(day: float, month: int) -> None:
    table = CsvTable("d.csv", ("day_of_year", "density_0km"), np.array([[day, 1.0]]))
    assert len(in_months(table, (month,)).values) == 1
    with pytest.raises(ValueError, match="expected rows of the months"):
        in_months(table, tuple(m for m in range(1, 13) if m != month))


FAULTY = {
    "": "expected a line of columns and rows of numbers, got none",
    "a,b\n": "expected one or more rows of numbers, got none",
    "a,a\n1,2\n": "line 1: expected a name for each column, each once",
    "a,b\n1\n": "line 2: expected 2 cells, one for each column, got 1",
    "a,b\n1,2\n1,x\n": "line 3, column b: expected a number, got 'x'",
    "a,b\n1,inf\n": "line 2, column b: expected a finite number, got 'inf'",
}


@pytest.mark.parametrize("text", FAULTY)
def test_a_faulty_file_is_told(tmp_path: Path, text: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=f"t.csv: ({FAULTY[text]})"):
        read_csv_table(path, "t.csv")


def test_comments_and_blank_lines_are_no_rows(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("# [P] a source\naltitude_m, factor\n\n0, 1.5\n")
    table = read_csv_table(path, "t.csv")
    assert table.columns == ("altitude_m", "factor")
    assert np.array_equal(table.values, [[0.0, 1.5]])
    assert not table.values.flags.writeable
