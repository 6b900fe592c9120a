"""Entry-state dispersions: one child seed per flight, and the laws of Eq. (34)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.simulation.dispersions import Dispersions, Distribution

Array = NDArray[np.float64]

laws = settings(deadline=None, max_examples=40)
DEGREE = np.pi / 180.0
EQ_34 = np.array([250.0, 0.5 * DEGREE, 0.5 * DEGREE, 70.0, 0.5 * DEGREE, 0.5 * DEGREE])


def shares(mission: Mission, distribution: Distribution, n: int, seed: int = 34) -> Array:
    """Drawn offsets (n, 6) over the half-widths."""
    drawn = Dispersions(tuple(EQ_34), distribution).draw(mission, n, seed)
    return np.asarray((drawn - mission.entry_state) / EQ_34)


# --- laws -----------------------------------------------------------------------------------------


@laws
@given(
    seed=st.integers(0, 2**40),
    counts=st.lists(st.integers(1, 40), min_size=2, max_size=2),
    distribution=st.sampled_from(list(Distribution)),
)
def test_a_flights_draw_depends_on_the_seed_and_its_number_alone(
    shefex3: Mission, seed: int, counts: list[int], distribution: Distribution
) -> None:
    dispersions = Dispersions.from_mission(shefex3, distribution)
    few, many = (dispersions.draw(shefex3, n, seed) for n in sorted(counts))
    assert np.array_equal(few, many[: len(few)])


def test_ten_flights_are_the_first_of_fifty(shefex3: Mission) -> None:
    dispersions = Dispersions.from_mission(shefex3)
    ten, fifty = dispersions.draw(shefex3, 10, 2016), dispersions.draw(shefex3, 50, 2016)
    assert np.array_equal(ten, fifty[:10])
    assert not np.any(np.all(dispersions.draw(shefex3, 50, 2017) == fifty, axis=1))
    assert len(np.unique(fifty, axis=0)) == 50


@laws
@given(widths=st.lists(st.floats(0.0, 1e6), min_size=6, max_size=6), seed=st.integers(0, 1000))
def test_offsets_scale_with_the_half_widths(
    shefex3: Mission, widths: list[float], seed: int
) -> None:
    unit = shares(shefex3, Distribution.UNIFORM, 5, seed)
    drawn = Dispersions(tuple(widths), Distribution.UNIFORM).draw(shefex3, 5, seed)
    expected = shefex3.entry_state + unit * np.array(widths)
    assert drawn == pytest.approx(expected, rel=1e-10, abs=1e-8)


@pytest.mark.parametrize("distribution", list(Distribution))
@pytest.mark.parametrize("entry", range(6))
def test_each_entry_state_is_dispersed_on_its_own(
    shefex3: Mission, distribution: Distribution, entry: int
) -> None:
    widths = np.zeros(6)
    widths[entry] = EQ_34[entry]
    drawn = Dispersions(tuple(widths), distribution).draw(shefex3, 30, 3)
    offsets = drawn - shefex3.entry_state
    assert np.count_nonzero(offsets[:, entry]) == 30
    assert np.all(np.delete(offsets, entry, axis=1) == 0.0)


def test_entry_states_are_uncorrelated(shefex3: Mission) -> None:
    for distribution in Distribution:
        correlation = np.corrcoef(shares(shefex3, distribution, 4000), rowvar=False)
        assert np.abs(correlation - np.eye(6)).max() < 0.06  # 3.8 of its standard deviations


# --- distributions --------------------------------------------------------------------------------


@pytest.mark.parametrize("entry", range(6))
def test_normal_has_three_standard_deviations_at_the_half_width(
    shefex3: Mission, entry: int
) -> None:
    sample = 3.0 * shares(shefex3, Distribution.NORMAL, 4000)[:, entry]
    assert stats.kstest(sample, "norm").pvalue > 0.01
    assert sample.mean() == pytest.approx(0.0, abs=0.06)
    assert sample.std() == pytest.approx(1.0, abs=0.045)


@pytest.mark.parametrize("entry", range(6))
def test_uniform_fills_the_hexeract(shefex3: Mission, entry: int) -> None:
    sample = shares(shefex3, Distribution.UNIFORM, 4000)[:, entry]
    assert stats.kstest(sample, "uniform", args=(-1.0, 2.0)).pvalue > 0.01
    assert np.abs(sample).max() <= 1.0 + 1e-9


def test_corners_are_the_64_vertices_equally_often(shefex3: Mission) -> None:
    sample = shares(shefex3, Distribution.CORNERS, 6400)
    assert np.abs(np.abs(sample) - 1.0).max() < 1e-9
    _, counts = np.unique(np.sign(sample), axis=0, return_counts=True)
    assert len(counts) == 64
    assert stats.chisquare(counts).pvalue > 0.01


def test_some_normal_draws_lie_outside_as_many_as_three_sigma_says(shefex3: Mission) -> None:
    outside = np.abs(shares(shefex3, Distribution.NORMAL, 6000)) > 1.0
    expected = 2.0 * stats.norm.sf(3.0)
    assert stats.binomtest(int(outside.sum()), outside.size, expected).pvalue > 0.01
    assert outside.any()


# --- tables and refusals --------------------------------------------------------------------------


def test_the_missions_grid_is_eq_34(shefex3: Mission, mission: Mission) -> None:
    dispersions = Dispersions.from_mission(shefex3)
    assert dispersions.half_widths == pytest.approx(tuple(EQ_34), rel=1e-9)
    assert dispersions.distribution is Distribution.NORMAL
    narrow = Dispersions.from_mission(mission, Distribution.CORNERS)
    assert narrow.half_widths == pytest.approx((70.0, 0.5 * DEGREE), rel=1e-9)
    assert narrow.distribution is Distribution.CORNERS


@pytest.mark.parametrize(
    "widths",
    [
        (1.0, 1.0, -1.0, 1.0, 1.0, 1.0),
        (1.0, np.nan, 1.0, 1.0, 1.0, 1.0),
        ((1.0,),),
        "narrow",
        3.0,
        ("1 km",),
        (1.0, (2.0, 3.0)),
    ],
)
def test_bad_half_widths_are_refused(widths: Any) -> None:
    with pytest.raises(
        ValueError, match="half_widths: expected non-negative numbers, one per parameter"
    ):
        Dispersions(widths)


@pytest.mark.parametrize("n", [0, -3, 1.5, True, "ten"])
def test_no_flights_are_refused(shefex3: Mission, n: Any) -> None:
    with pytest.raises(ValueError, match=f"n: expected at least one flight, .* got {n!r}"):
        Dispersions.from_mission(shefex3).draw(shefex3, n, 1)


@pytest.mark.parametrize("count", [5, 7])
def test_half_widths_of_another_mission_are_refused(shefex3: Mission, count: int) -> None:
    with pytest.raises(ValueError, match=f"expected 6 numbers for altitude, .*, got {count}"):
        Dispersions((1.0,) * count).draw(shefex3, 1, 1)


def test_a_lopsided_grid_is_filled_and_not_left(shefex3: Mission) -> None:
    text = shefex3.toml[: shefex3.toml.index("[grid]")]
    lopsided = parse_mission(
        text + "[grid]\nspeed_m_per_s = [0.0, 70.0]\ndensity_factor = [-0.1, 0.0, 0.05]\n"
    )
    low, high = ([axis[k] for axis in lopsided.grid_axes] for k in (0, -1))
    drawn = Dispersions.from_mission(lopsided, Distribution.UNIFORM).draw(lopsided, 2000, 8)
    assert np.all((drawn >= low) & (drawn <= high))
    assert drawn.min(axis=0) == pytest.approx(low, abs=0.2)
    assert drawn.max(axis=0) == pytest.approx(high, abs=0.2)
    corners = Dispersions.from_mission(lopsided, Distribution.CORNERS).draw(lopsided, 200, 8)
    found = np.unique(corners.round(9), axis=0)
    assert found == pytest.approx(
        np.array([[a, b] for a in (low[0], high[0]) for b in (0.9, 1.05)])
    )


@pytest.mark.parametrize("centre", [(1.0,), (1.0, np.nan), "ab", 1.0])
def test_a_bad_centre_is_refused(centre: Any) -> None:
    with pytest.raises(ValueError, match=r"dispersions\.centre: expected 2 finite offsets"):
        Dispersions((1.0, 1.0), centre=centre)


@pytest.mark.parametrize("seed", [-1, 1.5, True, None])
def test_what_is_no_seed_is_refused(shefex3: Mission, seed: Any) -> None:
    with pytest.raises(
        ValueError, match=f"seed: expected a whole number, 0 or greater, got {seed}"
    ):
        Dispersions.from_mission(shefex3).draw(shefex3, 1, seed)


def test_a_distribution_goes_by_its_name(shefex3: Mission) -> None:
    """A string that was taken for none of the members drew corners."""
    for law in Distribution:
        named = Dispersions(tuple(EQ_34), law.value)
        assert named == Dispersions(tuple(EQ_34), law)
        assert Dispersions.from_mission(shefex3, law.value).distribution is law
    with pytest.raises(ValueError, match="one of normal, uniform, corners, got 'cauchy'"):
        Dispersions((1.0,), "cauchy")


def test_a_normal_distribution_is_centred_on_the_nominal(shefex3: Mission) -> None:
    """On axes that hold one side only, three standard deviations are the far end."""
    text = shefex3.toml[: shefex3.toml.index("[grid]")]
    lopsided = parse_mission(
        text + "[grid]\nspeed_m_per_s = [0.0, 70.0]\ndensity_factor = [-0.1, 0.0, 0.05]\n"
    )
    dispersions = Dispersions.from_mission(lopsided)
    drawn = dispersions.draw(lopsided, 4000, 8)
    offsets = (drawn - lopsided.nominal_parameters) / [70.0, 0.1]
    assert offsets.mean(axis=0) == pytest.approx(0.0, abs=0.02)
    assert offsets.std(axis=0) == pytest.approx(1.0 / 3.0, abs=0.015)
    assert dispersions.in_words(lopsided) == (
        "normal (3σ): speed_m_per_s ± 70, density_factor ± 0.1"
    )
    box = Dispersions.from_mission(lopsided, "uniform")
    assert box.in_words(lopsided) == (
        "uniform: speed_m_per_s +35 ± 35, density_factor -0.025 ± 0.075"
    )
