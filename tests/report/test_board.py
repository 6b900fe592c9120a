"""What stands first on the page, the budget, corrections, wrong worlds: numbers of judge and numpy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import spearmanr

from ampi.missions.mission import Mission
from ampi.report.board import board
from ampi.report.dispersed import dispersed
from ampi.report.figures.budget import LEFT, MOST, OTHERS, budget, budget_figure
from ampi.report.figures.corrected import corrections_of_campaigns, pairs
from ampi.report.figures.scheme_style import style_of
from ampi.report.scheme_exhibits import scheme_exhibits, wrong_world_exhibits
from ampi.report.scheme_groups import scheme_groups
from ampi.simulation.estimates.ellipses import ellipse_area, ellipse_area_estimate
from ampi.simulation.flights import Flights
from ampi.simulation.statistics import judge, ratio_to_nominal

ABROAD = "linear_quadratic abroad, ampi"
BESIDE = "linear_quadratic abroad, nominal"


@pytest.fixture
def corrected(many: dict[str, Flights]) -> dict[str, Flights]:
    """One law in both worlds, and in the wrong one with half the miss by correction."""
    own = {name: f for name, f in many.items() if f.law == "linear_quadratic"}
    half = {"miss": 0.5, "along": 0.5, "across": 0.5}
    for name in (BESIDE, ABROAD):
        f = many[name]
        nearer = {key: share * getattr(f, key) for key, share in half.items()}
        changes = np.where(np.isfinite(f.bank_rate), 0.02, np.nan)
        own[f"{name} corrected"] = replace(
            f, correction="bank_and_angle", angle_of_attack=changes, **nearer
        )
    return own


# --- at a glance ----------------------------------------------------------------------------------


def test_the_paragraph_begins_with_what_is_asked_and_the_wrong_world(
    mission: Mission, corrected: dict[str, Flights]
) -> None:
    asked, wrong, home = board(mission, corrected).sentences
    assert asked.startswith("A flight has passed if it ends within 25 km of the target")
    assert wrong.startswith("In the world everything, which differs from the model, ")
    assert home.startswith("In the world entry, as modelled, ")


def test_the_best_passes_the_most_and_is_held_against_the_same_without_correction(
    mission: Mission, corrected: dict[str, Flights]
) -> None:
    sentence = board(mission, corrected).sentences[1]
    shares = {n: judge(f).passed for n, f in corrected.items() if f.world == "everything"}
    best = max(shares, key=lambda name: shares[name].count)
    assert best == f"{ABROAD} corrected"
    assert f"ampi, corrected by bank and angle does best: {shares[best]} of 60" in sentence
    assert f"Without correction {shares[ABROAD]} of 60 flights pass." in sentence
    misses = judge(corrected[best]).misses
    assert f"{1e-3 * misses.median.value:.2g} km [" in sentence


def test_without_corrections_it_is_held_against_nominal_tracking(
    mission: Mission, campaigns: dict[str, Flights]
) -> None:
    (_, sentence) = board(mission, campaigns).sentences
    assert f"By nominal tracking {judge(campaigns['nominal']).passed} of 60" in sentence
    alone = board(mission, {"ampi": campaigns["ampi"]})
    assert "best" not in alone.sentences[1] and "tracking" not in alone.sentences[1]


def test_the_table_has_a_row_for_every_campaign_with_intervals(
    mission: Mission, corrected: dict[str, Flights]
) -> None:
    found = board(mission, corrected)
    assert list(found.rows) == ["everything", "entry"]
    assert {n for own in found.rows.values() for n in own} == set(corrected)
    for name, cells in found.group.cells.items():
        verdict = judge(corrected[name])
        assert cells[1].value == f"{verdict.passed.percent:.1f}"
        assert cells[2].value == f"{verdict.limits_kept.percent:.1f}"
        assert all(cell.interval or cell.value == "∞" for cell in cells[1:])
    two = board(mission, {"a": corrected[ABROAD], "b": replace(corrected[ABROAD], law="other_law")})
    assert list(two.rows["everything"].values()) == ["linear quadratic, ampi", "other law, ampi"]


# --- corrections ----------------------------------------------------------------------------------


def test_corrected_flights_are_a_group_and_a_colour_of_their_own(
    corrected: dict[str, Flights],
) -> None:
    titles = [group.title for group in scheme_groups(corrected)]
    assert titles[:2] == [
        "everything, linear quadratic",
        "everything, linear quadratic, corrected by bank and angle",
    ]
    with_, without = corrected[f"{ABROAD} corrected"], corrected[ABROAD]
    assert style_of(with_).colour != style_of(without).colour
    assert style_of(with_).marker == style_of(without).marker


def test_a_corrected_scheme_is_held_against_nominal_tracking_corrected_alike(
    corrected: dict[str, Flights],
) -> None:
    flights = corrected[f"{ABROAD} corrected"]
    alike = ratio_to_nominal(flights, corrected)
    plain = {name: f for name, f in corrected.items() if f.correction == "none"}
    assert alike is not None
    assert ratio_to_nominal(flights, plain) is None
    assert alike.ratio == pytest.approx(ratio_to_nominal(plain[ABROAD], plain).ratio)  # type: ignore[union-attr]


def test_misses_with_stand_over_misses_without(
    mission: Mission, corrected: dict[str, Flights]
) -> None:
    (pair,) = pairs(corrected).values()
    assert pair.plain is corrected[ABROAD]
    figure = corrections_of_campaigns(mission, corrected)
    left, right = figure.axes
    points = left.lines[0]
    assert points.get_ydata() == pytest.approx(0.5 * points.get_xdata())
    assert left.texts[0].get_text() == "57 of 57 nearer, 3 lost"
    assert len(right.collections) == 1
    alone = {"one": corrected[f"{ABROAD} corrected"]}
    assert pairs(alone)["everything, bank and angle"].plain is None
    corrections_of_campaigns(mission, alone)


# --- causes and worlds ----------------------------------------------------------------------------


def test_a_budget_is_squared_rank_correlations_and_what_they_leave(
    mission: Mission, many: dict[str, Flights]
) -> None:
    flights = many[ABROAD]
    shares = budget(mission, flights)
    inputs = {one.words: one.values for one in dispersed(mission, flights) if one.varies}
    good = flights.reached
    rho = {k: spearmanr(v[good], flights.along[good]).statistic for k, v in inputs.items()}
    assert next(iter(shares)) == "lift factor"
    for name in list(shares)[:-2]:
        assert shares[name].value == pytest.approx(rho[name] ** 2)
        assert 0.0 <= shares[name].low <= shares[name].value <= shares[name].high
    assert len(shares) <= MOST + 2
    total = sum(one.value for one in shares.values())
    assert total == pytest.approx(1.0) or shares[LEFT].value == 0.0
    assert shares[OTHERS].value >= 0.0
    nobody = replace(flights, status=np.ones(60, dtype=np.int64))
    assert budget(mission, nobody) == {}


def test_a_budget_has_a_panel_for_what_is_corrected(
    mission: Mission, corrected: dict[str, Flights]
) -> None:
    titles = [axes.get_title(loc="left") for axes in budget_figure(mission, corrected).axes]
    assert titles == ["everything", "everything, corrected"]


def test_flights_of_a_wrong_world_are_drawn_as_those_of_the_models(
    mission: Mission, corrected: dict[str, Flights], campaigns: dict[str, Flights]
) -> None:
    exhibits = wrong_world_exhibits(mission, corrected)
    assert len(exhibits) == 7
    assert all(e.name.endswith("-wrong") and not e.after for e in exhibits)
    assert all("World everything, linear quadratic law." in e.caption for e in exhibits)
    assert "ampi and ampi, corrected" in exhibits[0].caption
    assert wrong_world_exhibits(mission, campaigns) == ()
    names = [e.name for e in scheme_exhibits(mission, corrected)]
    assert names == ["map", "corrections", "budget", "sensitivity"]
    assert "corrections" not in [e.name for e in scheme_exhibits(mission, campaigns)]


def test_an_area_lies_in_its_interval_and_scales_with_the_misses() -> None:
    along, across = np.random.default_rng(1).normal(0.0, (3e3, 1e3), (400, 2)).T
    found = ellipse_area_estimate(along, across)
    assert found.value == ellipse_area(along, across)
    true = np.pi * -2.0 * np.log(0.05) * 3e6
    assert found.low < true < found.high
    larger = ellipse_area_estimate(2.0 * along, 2.0 * across)
    assert (larger.low, larger.high) == pytest.approx((4.0 * found.low, 4.0 * found.high))
    assert np.isnan(ellipse_area_estimate(along[:2], across[:2]).value)
