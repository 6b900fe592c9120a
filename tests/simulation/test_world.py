"""A flight is a function of its uniform numbers; what is drawn has the laws that the file asks for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.simulation.truth import Truth
from ampi.simulation.uncertainties import BY_NAME, CATALOGUE
from ampi.simulation.world import World
from ampi.simulation.world_loading import load_world
from tests.support.missions import text_on_grid
from tests.support.worlds import world, write_draws

Array = NDArray[np.float64]
laws = settings(deadline=None, max_examples=25)
DEGREE = np.pi / 180.0
EQ_34 = np.array([250.0, 0.5 * DEGREE, 0.5 * DEGREE, 70.0, 0.5 * DEGREE, 0.5 * DEGREE])

CORRELATED = """
[aerodynamics]
lift_factor = { distribution = "normal", three_sigma = 0.1 }
drag_factor = { distribution = "uniform", low = 0.9, high = 1.1 }
[vehicle]
mass_factor = { distribution = "normal", three_sigma = 0.02 }
[wind]
east_m_per_s = { distribution = "normal", mean = 20.0, three_sigma = 60.0 }
[[correlation]]
of = ["lift_factor", "wind_east"]
value = -0.8
[[correlation]]
of = ["lift_factor", "drag_factor"]
value = 0.5
"""


@pytest.fixture(scope="module")
def everything() -> World:
    return load_world("everything")


def same(a: Truth, b: Truth) -> bool:
    pairs = [(a.parameters, b.parameters), (a.seeds, b.seeds), (a.density, b.density)]
    pairs += [(a.wind, b.wind), *((a.numbers[name], b.numbers[name]) for name in BY_NAME)]
    return all(
        x is y is None or (x is not None and y is not None and np.array_equal(x, y))
        for x, y in pairs
    )


# --- determinism ----------------------------------------------------------------------------------


@laws
@given(seed=st.integers(0, 2**40), n=st.integers(1, 20), first=st.integers(0, 50))
def test_a_flight_is_the_same_alone_and_in_company(
    shefex3: Mission, everything: World, seed: int, n: int, first: int
) -> None:
    many = everything.draw(shefex3, n, seed, first=first)
    i = (seed + n) % n
    assert same(everything.draw(shefex3, 1, seed, first=first + i), many.take([i]))


@pytest.mark.parametrize("i", [0, 6, 63])
def test_correlated_flights_and_rows_are_the_same_alone(
    shefex3: Mission, tmp_path: Path, i: int
) -> None:
    write_draws(tmp_path / "air.csv")
    here = world(CORRELATED + '[draws]\ntable = "air.csv"\n', folder=tmp_path)
    many = here.draw(shefex3, 64, 5)
    assert same(here.draw(shefex3, 1, 5, first=i), many.take([i]))
    for k in (0, 32):
        assert same(here.draw(shefex3, 32, 5, first=k), many.take(slice(k, k + 32)))


def test_pools_and_seeds_are_disjoint(shefex3: Mission, everything: World) -> None:
    draws = [
        everything.uniforms(shefex3, 200, seed, pool)
        for seed, pool in ((1, "reported"), (1, "tuning"), (2, "reported"), (2, "tuning"))
    ]
    numbers = np.concatenate([uniforms.ravel() for uniforms in draws])
    assert len(np.unique(numbers)) == numbers.size
    assert numbers.min() > 0.0
    assert numbers.max() < 1.0
    assert stats.kstest(numbers, "uniform").pvalue > 1e-3


def test_worlds_share_the_draws_of_what_they_share(shefex3: Mission, everything: World) -> None:
    full, entry = everything.draw(shefex3, 8, 3), load_world("entry").draw(shefex3, 8, 3)
    mass = world('[vehicle]\nmass_factor = { distribution = "normal", three_sigma = 0.02 }\n')
    assert np.array_equal(full.parameters, entry.parameters)
    assert np.array_equal(
        full.numbers["mass_factor"], mass.draw(shefex3, 8, 3).numbers["mass_factor"]
    )


def test_a_designs_own_numbers_may_be_0_and_1(shefex3: Mission, everything: World) -> None:
    m = everything.dimension(shefex3)
    assert m == len(everything.inputs(shefex3)) == len(set(everything.inputs(shefex3)))
    ends = everything.truth(shefex3, np.array([np.zeros(m), np.ones(m)]))
    assert all(np.all(np.isfinite(values)) for values in ends.numbers.values())
    assert np.all(np.isfinite(ends.parameters))


# --- laws -----------------------------------------------------------------------------------------


def test_entry_is_eq_34(shefex3: Mission) -> None:
    drawn = load_world("entry").draw(shefex3, 3000, 34)
    share = 3.0 * (drawn.parameters - shefex3.nominal_parameters) / EQ_34
    for column in share.T:
        assert stats.kstest(column, "norm").pvalue > 1e-3
    assert np.abs(np.corrcoef(share, rowvar=False) - np.eye(6)).max() < 0.07
    assert drawn.density is None
    assert drawn.wind is None
    nominal = {uncertainty.name: uncertainty.nominal for uncertainty in CATALOGUE}
    assert all(np.all(drawn.numbers[name] == value) for name, value in nominal.items())


def test_hexeract_is_filled_and_not_left(shefex3: Mission) -> None:
    drawn = load_world("hexeract").draw(shefex3, 3000, 34)
    share = (drawn.parameters - shefex3.nominal_parameters) / EQ_34
    assert np.abs(share).max() <= 1.0 + 1e-9
    for column in share.T:
        assert stats.kstest(column, "uniform", args=(-1.0, 2.0)).pvalue > 1e-3


def test_corners_none_and_scale_are_of_the_grids_box(shefex3: Mission) -> None:
    lopsided = parse_mission(text_on_grid("[grid]\nspeed_m_per_s = [-70.0, 0.0, 10.0]\n"))
    nominal = lopsided.nominal_parameters

    def offsets(entry: str) -> Array:
        head = f'name = "w"\ntitle = "W"\n[entry]\ndistribution = {entry}\n'
        return world(head=head).draw(lopsided, 400, 1).parameters - nominal

    corners = offsets('"corners"\nscale = 2.0')
    assert sorted(np.unique(corners.round(9))) == pytest.approx([-140.0, 20.0])
    assert np.all(offsets('"none"') == 0.0)
    assert offsets('"uniform"').max() == pytest.approx(10.0, abs=1.0)
    assert offsets('"normal"').std() == pytest.approx(70.0 / 3.0, rel=0.1)


def test_offsets_replace_the_grids_own(shefex3: Mission) -> None:
    body = """[entry.offsets]
speed_km_per_s = { distribution = "uniform", low = 0.01, high = 0.02 }
"entry.azimuth_deg" = 0.25
"""
    offsets = world(body).draw(shefex3, 500, 2).parameters - shefex3.nominal_parameters
    assert offsets[:, 3].min() >= 10.0 - 1e-9
    assert offsets[:, 3].max() <= 20.0 + 1e-9
    assert offsets[:, 5] == pytest.approx(np.full(500, 0.25 * DEGREE))
    assert offsets[:, 0].std() == pytest.approx(250.0 / 3.0, rel=0.15)


def test_the_copula_correlates_and_leaves_each_law(shefex3: Mission) -> None:
    numbers = world(CORRELATED).draw(shefex3, 5000, 7).numbers
    lift, drag, wind = (numbers[n] for n in ("lift_factor", "drag_factor", "wind_east"))
    assert np.corrcoef(lift, wind)[0, 1] == pytest.approx(-0.8, abs=0.03)
    rank = stats.spearmanr(lift, drag).statistic  # 6/π asin(ρ/2) of a Gaussian copula
    assert rank == pytest.approx(6.0 / np.pi * np.arcsin(0.25), abs=0.04)
    assert abs(np.corrcoef(lift, numbers["mass_factor"])[0, 1]) < 0.06
    assert stats.kstest(drag, "uniform", args=(0.9, 0.2)).pvalue > 1e-3
    assert stats.kstest(wind, "norm", args=(20.0, 20.0)).pvalue > 1e-3


def test_a_correlation_moves_nobody_else(shefex3: Mission) -> None:
    plain = world(CORRELATED.partition("[[correlation]]")[0]).draw(shefex3, 50, 7).numbers
    tied = world(CORRELATED).draw(shefex3, 50, 7).numbers
    assert np.array_equal(plain["lift_factor"], tied["lift_factor"])  # the first of them
    assert np.array_equal(plain["mass_factor"], tied["mass_factor"])
    assert not np.any(plain["wind_east"] == tied["wind_east"])


def test_numbers_of_one_file_come_from_one_row(shefex3: Mission, tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("lift,drag,speed\n1.1,1.2,1\n0.9,0.8,2\n1.0,1.1,3\n")
    column = '{{ distribution = "table", file = "r.csv", column = "{}" }}'.format
    body = f"[entry.offsets]\nspeed_m_per_s = {column('speed')}\n[aerodynamics]\n"
    body += f"lift_factor = {column('lift')}\ndrag_factor = {column('drag')}\n"
    here = world(body, folder=tmp_path)
    assert here.inputs(shefex3).count("row of r.csv") == 1
    drawn = here.draw(shefex3, 600, 1)
    speed = drawn.parameters[:, 3] - shefex3.nominal_parameters[3]
    rows = np.stack([drawn.numbers["lift_factor"], drawn.numbers["drag_factor"], speed], axis=1)
    found, counts = np.unique(rows.round(9), axis=0, return_counts=True)
    assert found == pytest.approx(np.array([[0.9, 0.8, 2.0], [1.0, 1.1, 3.0], [1.1, 1.2, 1.0]]))
    assert stats.chisquare(counts).pvalue > 1e-3


def test_a_month_draws_its_own_rows(shefex3: Mission, tmp_path: Path) -> None:
    write_draws(tmp_path / "air.csv")  # rows 0, 1: January; 6: June and July follow
    body = '[draws]\ntable = "air.csv"\nmonths = [1]\n'
    wind = world(body, folder=tmp_path).draw(shefex3, 100, 1).wind
    assert wind is not None
    assert set(np.unique(wind[0])) == {0.0, 1.0}
    assert np.array_equal(wind[1], -2.0 * wind[0])


# --- structure and units --------------------------------------------------------------------------


def test_a_profile_is_there_or_not_by_the_world_alone(shefex3: Mission, tmp_path: Path) -> None:
    (tmp_path / "d.csv").write_text("altitude_m,factor\n0,1.0\n120000,1.0\n")
    for body, density, wind in (
        ("[density]\nfactor = 1.1\nnoise = 0.0\n", False, False),
        ("[density]\nnoise = 0.1\n", True, False),
        ('[density]\ntable = "d.csv"\n', True, False),
        ("[wind]\nnorth_m_per_s = 5.0\n", False, True),
        ("[wind]\nnoise_m_per_s = 5.0\n", False, True),
    ):
        drawn = world(body, folder=tmp_path).draw(shefex3, 2, 1)
        assert ((drawn.density is not None), (drawn.wind is not None)) == (density, wind)


def test_constants_are_converted_and_in_the_wind(shefex3: Mission) -> None:
    body = (
        "[wind]\neast_km_per_s = 0.02\nnorth_m_per_s = -7.0\n[navigation]\nazimuth_bias_deg = 2\n"
    )
    drawn = world(body).draw(shefex3, 3, 1)
    assert drawn.wind is not None
    assert np.all(drawn.wind[0] == 20.0)
    assert np.all(drawn.wind[1] == -7.0)
    assert drawn.numbers["navigation_azimuth_bias"] == pytest.approx(np.full(3, 2.0 * DEGREE))


def test_what_differs_is_told_in_the_units_of_the_file(shefex3: Mission) -> None:
    lines = world(CORRELATED).in_words(shefex3)
    assert "entry.speed: normal, 3σ 70 m/s" in lines
    assert "wind_east: normal about 20 m/s, 3σ 60 m/s" in lines
    assert "correlation of lift_factor and wind_east: -0.8" in lines
    assert len(lines) == 6 + 4 + 2


@pytest.mark.parametrize(
    ("uniforms", "sentence"),
    [
        (np.full((2, 5), 0.5), r"expected shape \(n, 6\), got \(2, 5\)"),
        (np.full((2, 6), 1.5), "expected numbers from 0 to 1"),
        (np.full((2, 6), np.nan), "expected numbers from 0 to 1"),
    ],
)
def test_uniform_numbers_that_are_none_are_refused(
    shefex3: Mission, uniforms: Array, sentence: str
) -> None:
    with pytest.raises(ValueError, match=f"uniforms: {sentence}"):
        load_world("entry").truth(shefex3, uniforms)
