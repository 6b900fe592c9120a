"""The table over all schemes and worlds: numpy's numbers, worlds in order, JSON without surprises."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binomtest, spearmanr

from ampi.cli.console import print_json
from ampi.missions.mission import Mission
from ampi.report.correlations import correlations
from ampi.report.dispersed import BAND, dispersed
from ampi.report.scheme_groups import (
    by_world,
    differs_from_model,
    in_order,
    like_the_paper,
    scheme_groups,
)
from ampi.report.schemes_table import RADII, schemes, schemes_as_dict, schemes_table
from ampi.report.text import WIDTH, verdict_text
from ampi.simulation.flights import Flights
from ampi.simulation.profiles import ALTITUDES
from ampi.simulation.uncertainties import BY_NAME

ABROAD = "linear_quadratic abroad, ampi"
BESIDE = "linear_quadratic abroad, nominal"


def all_misses(flights: Flights) -> np.ndarray:
    return np.where(flights.reached, flights.miss, np.inf)


# --- order ----------------------------------------------------------------------------------------


def test_worlds_that_differ_come_first_and_nominal_tracking_before_ampi(
    many: dict[str, Flights],
) -> None:
    told = [(f.world, f.law, f.mode.value) for f in in_order(many).values()]
    assert told == [
        (world, law, mode)
        for world in ("everything", "entry")
        for law in ("linear_quadratic", "drag_sliding_mode")
        for mode in ("nominal", "ampi")
    ]


def test_a_world_differs_by_what_is_true_in_it_not_by_its_name(many: dict[str, Flights]) -> None:
    home, abroad = many["linear_quadratic at home, ampi"], many[ABROAD]
    assert not differs_from_model(replace(home, world="my own"))
    assert differs_from_model(replace(abroad, world="entry"))
    assert differs_from_model(replace(home, profiles="wind"))
    noise = home.numbers.copy()
    noise[:, list(BY_NAME).index("navigation_altitude_noise")] = 33.0
    assert differs_from_model(replace(home, numbers=noise))


def test_groups_are_labelled_by_references_that_tell_them_apart(many: dict[str, Flights]) -> None:
    groups = scheme_groups(many)
    assert [g.title for g in groups[:2]] == [
        "everything, linear quadratic",
        "everything, drag sliding mode",
    ]
    assert all(list(g.campaigns) == ["nominal", "ampi"] for g in groups)
    assert [many[name] for name in groups[0].names] == list(groups[0].campaigns.values())
    twins = {**many, "slow": replace(many[ABROAD], cycle=2.0)}
    assert list(scheme_groups(twins)[0].campaigns) == [BESIDE, ABROAD, "slow"]
    (alone,) = scheme_groups({"any name": many[ABROAD]})
    assert list(alone.campaigns) == ["any name"]


def test_two_worlds_of_one_name_are_two_worlds(many: dict[str, Flights]) -> None:
    other = replace(many[ABROAD], world_sha256="a" * 64)
    assert list(by_world({"one": many[ABROAD], "two": other})) == [
        "everything fffffff",
        "everything aaaaaaa",
    ]


def test_the_papers_kind_of_flights(many: dict[str, Flights]) -> None:
    chosen = like_the_paper(scheme_groups(many))
    assert (chosen.world, chosen.law) == ("entry", "drag_sliding_mode")


# --- numbers --------------------------------------------------------------------------------------


def test_a_scheme_counts_every_flight(many: dict[str, Flights]) -> None:
    on_target = np.where(many[ABROAD].reached, many[ABROAD].miss, 0.0)  # at the ground, and lost
    flights = replace(many[ABROAD], miss=on_target)
    scheme = schemes({**many, ABROAD: flights})[ABROAD]
    miss = all_misses(flights)
    for radius in RADII:
        count = int(np.sum(miss < radius))
        exact = binomtest(count, flights.n).proportion_ci(method="exact")
        share = scheme.within[radius]
        assert share.count == count
        assert (share.low, share.high) == pytest.approx((exact.low, exact.high))
    assert scheme.verdict.misses.median.value == pytest.approx(np.median(miss))
    size = np.sort(np.where(flights.reached, np.abs(flights.altitude_error), np.inf))
    assert scheme.altitude.lost == 3
    assert scheme.altitude.median.value == pytest.approx(np.median(size))


def test_a_difference_is_against_the_same_law_in_the_same_world(many: dict[str, Flights]) -> None:
    judged = schemes(many)
    paired = judged[ABROAD].against_nominal
    assert paired is not None
    ours, theirs = all_misses(many[ABROAD]), all_misses(many[BESIDE])
    assert paired.median.value == pytest.approx(np.median(ours) - np.median(theirs))
    near, beside = ours < 5e3, theirs < 5e3
    one, other = int(np.sum(near & ~beside)), int(np.sum(~near & beside))
    share = paired.within[5e3]
    assert share.difference.value == pytest.approx((one - other) / 60)
    assert share.p_value == pytest.approx(binomtest(one, one + other).pvalue)
    assert judged[BESIDE].against_nominal is None


def test_the_table_shows_those_numbers(many: dict[str, Flights]) -> None:
    table, judged = schemes_table(many), schemes(many)
    assert next(iter(table.rows)) == "everything, linear quadratic"
    within, misses, steering, failures, less = (g.cells[ABROAD] for g in table.groups)
    verdict = judged[ABROAD].verdict
    assert [cell.value for cell in within] == [
        "60",
        *(f"{judged[ABROAD].within[radius].percent:.1f}" for radius in RADII),
    ]
    assert float(misses[0].value) == pytest.approx(1e-3 * verdict.misses.median.value, rel=0.05)
    assert [cell.value for cell in misses[1:]] == ["∞"] * 3  # three of sixty did not arrive
    assert float(steering[1].value) == pytest.approx(
        100.0 * many[ABROAD].saturation.mean(), rel=0.05
    )
    assert float(steering[2].value) == pytest.approx(
        np.degrees(many[ABROAD].activity.mean()), rel=0.05
    )
    assert sum(float(cell.value) for cell in failures) == pytest.approx(100.0, abs=0.3)
    named = dict(zip(table.groups[3].quantities, (c.value for c in failures), strict=True))
    assert [named[k] for k in ("not a number", "ground", "time limit")] == ["1.7"] * 3  # one of 60
    assert less[0].value.startswith("-")
    assert [cell.value for cell in table.groups[4].cells[BESIDE]] == ["–"] * 3


def test_what_is_infinite_for_certain_has_no_interval(many: dict[str, Flights]) -> None:
    lost = replace(many[ABROAD], status=np.ones(60, dtype=np.int64))
    (row,) = schemes_table({"a": lost}).groups[1].cells.values()
    assert [(cell.value, cell.interval) for cell in row] == [("∞", "")] * 4


def test_the_terminal_shows_the_wrong_world_first(
    mission: Mission, many: dict[str, Flights]
) -> None:
    text = verdict_text(mission, many)
    lines = text.splitlines()
    assert max(map(len, lines)) <= WIDTH
    assert text.index("World everything: lift_factor") < text.index("World entry: entry.speed")
    start = lines.index("WORLDS, LAWS AND REFERENCES")
    assert lines[start + 3] == "everything, linear quadratic"
    shown = schemes(many)[ABROAD].within[25e3]
    assert (
        f"{shown.percent:.1f} [{100 * shown.low:.1f}, {100 * shown.high:.1f}]" in lines[start + 5]
    )
    titles = [line.strip("= ") for line in lines if line.startswith("===")]
    assert titles == [group.title for group in scheme_groups(many)]


def test_one_group_has_the_old_tables_alone(
    mission: Mission, campaigns: dict[str, Flights]
) -> None:
    assert "===" not in verdict_text(mission, campaigns)


def test_the_same_as_json(
    mission: Mission, many: dict[str, Flights], capsys: pytest.CaptureFixture[str]
) -> None:
    print_json(schemes_as_dict(mission, many))
    plain = json.loads(capsys.readouterr().out)
    assert plain["mission"] == "shefex3"
    assert plain["passed"].startswith("within 25 km of the target")
    scheme, judged = plain["schemes"][ABROAD], schemes(many)[ABROAD]
    assert (scheme["law"], scheme["mode"], scheme["world"]) == (
        "linear_quadratic",
        "ampi",
        "everything",
    )
    assert scheme["within"]["5000.0"]["count"] == judged.within[5e3].count
    assert scheme["misses"]["worst_mean"]["value"] is None  # infinite
    assert scheme["against_nominal"]["within"]["5000.0"]["p_value"] <= 1.0
    assert plain["schemes"][BESIDE]["against_nominal"] is None
    lift = scheme["rank_correlations"]["lift factor"]
    assert lift["along"]["value"] > 0.9


# --- dispersions ----------------------------------------------------------------------------------


def test_what_varies_is_named_in_words_with_its_unit(
    mission: Mission, many: dict[str, Flights]
) -> None:
    numbers = many[ABROAD].numbers.copy()
    rng = np.random.default_rng(0)
    alpha = 0.01 * rng.standard_normal(60)
    numbers[:, list(BY_NAME).index("angle_of_attack_error")] = alpha
    density, wind = rng.uniform(0.8, 1.2, (60, len(ALTITUDES))), np.zeros((60, 2, len(ALTITUDES)))
    wind[:, 0] = np.arange(60.0)[:, None]
    flights = replace(
        many[ABROAD], numbers=numbers, density=density, wind=wind, profiles="density wind"
    )
    found = {one.key: one for one in dispersed(mission, flights)}
    assert list(found) == [
        *(parameter.key for parameter in mission.parameters),
        "lift_factor",
        "angle_of_attack_error_deg",
        "density_profile, 30 to 60 km",
        "wind_profile_east_m_per_s, 30 to 60 km",
    ]
    assert found["angle_of_attack_error_deg"].values == pytest.approx(np.degrees(alpha))
    assert found["angle_of_attack_error_deg"].words == "angle of attack error"
    band = slice(int(BAND[0] / 1e3), int(BAND[1] / 1e3) + 1)
    mean = found["density_profile, 30 to 60 km"].values
    assert mean == pytest.approx(density[:, band].mean(axis=1))
    speed = found["speed_m_per_s"]
    assert speed.words == "entry speed"
    assert speed.values == pytest.approx(flights.parameters[:, 3] - mission.entry.speed)
    assert speed.on_axis is not None
    assert speed.on_axis.all()


def test_correlations_are_those_of_scipy_and_know_the_cause(
    mission: Mission, many: dict[str, Flights]
) -> None:
    flights = many[ABROAD]
    found = correlations(mission, flights)
    assert next(iter(found)) == "lift factor"
    assert len(found) == 7
    lift = flights.truth.numbers["lift_factor"]
    miss = all_misses(flights)
    assert found["lift factor"].miss.value == pytest.approx(spearmanr(lift, miss).statistic)
    good = flights.reached
    along = spearmanr(lift[good], flights.along[good]).statistic
    assert found["lift factor"].along.value == pytest.approx(along)
    sizes = [one.size for one in found.values()]
    assert sizes == sorted(sizes, reverse=True)


def test_correlations_of_flights_of_which_none_arrived(
    mission: Mission, many: dict[str, Flights]
) -> None:
    flights = many[ABROAD]
    lost = correlations(mission, replace(flights, status=np.ones(flights.n, dtype=np.int64)))
    assert np.isnan(lost["lift factor"].along.value)
    assert np.isnan(lost["lift factor"].miss.value)
    still = replace(
        flights,
        parameters=np.tile(mission.entry_state, (60, 1)),
        numbers=flights.numbers[:1].repeat(60, axis=0),
    )
    assert correlations(mission, still) == {}
