"""A flight told correction by correction: the same flight, and the same numbers in the file."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from ampi import load_guidance
from ampi.correction.corrector import CorrectionOutcome
from ampi.correction.settings import N_PLAN, CorrectorSettings
from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.onboard_model import correction_of
from ampi.report.figures.correction import corrections_figure, time_to_go_figure
from ampi.report.figures.style import image_bytes
from ampi.simulation.correction_log import CorrectionLog, fly_logged, write_correction_log
from ampi.simulation.flights import Flights
from ampi.simulation.monte_carlo import Scheme, fly_one
from ampi.simulation.predicted_misses import predicted_misses

CYCLE, CASE = 0.5, 3  # s
OF_FLIGHT = ("final_states", "states", "bank_rate", "angle_of_attack", "peak", "corrections")


@pytest.fixture(scope="module")
def scheme(database_file: Path) -> Scheme:
    correcting = load_guidance(database_file, cycle=CYCLE, correction="bank_and_angle")
    return Scheme(correcting, "everything")


@pytest.fixture(scope="module")
def log(mission: Mission, scheme: Scheme) -> CorrectionLog:
    return fly_logged(mission, scheme, CASE, cycle=CYCLE)


@pytest.fixture(scope="module")
def rows(log: CorrectionLog, tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, str]]:
    path = tmp_path_factory.mktemp("log") / "corrections.csv"
    write_correction_log(path, log)
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def same(one: Flights, other: Flights) -> bool:
    return all(getattr(one, name).tobytes() == getattr(other, name).tobytes() for name in OF_FLIGHT)


def test_a_flight_that_is_observed_is_the_same_to_the_bit(
    mission: Mission, scheme: Scheme, log: CorrectionLog
) -> None:
    assert same(log.flight, fly_one(mission, scheme, CASE, cycle=CYCLE))


def test_in_numpy_too(short: Mission, short_guidance: Guidance) -> None:
    """A flight of a minute, which is corrected once."""
    seldom = CorrectorSettings(last_period=100.0)
    correcting = short_guidance.corrected(correction_of(short, corrector=seldom))
    correcting.mission_sha256 = short.digest
    own = Scheme(correcting, "everything")
    found = fly_logged(short, own, CASE, cycle=1.0, engine="numpy")
    assert found.times.tolist() == [40.0]
    assert same(found.flight, fly_one(short, own, CASE, cycle=1.0, engine="numpy"))


def test_every_correction_is_in_the_log_with_its_reason(
    log: CorrectionLog, rows: list[dict[str, str]]
) -> None:
    counts = np.bincount(log.outcome, minlength=len(CorrectionOutcome))
    assert counts.tolist() == log.flight.corrections[0].tolist()
    assert len(rows) == len(log) > 30
    assert np.all(np.diff(log.times) > 0.0) and log.times[0] == 40.0
    for row, outcome in zip(rows, log.outcome, strict=True):
        assert row["reason"] == CorrectionOutcome[row["outcome"]].sentence
        assert int(CorrectionOutcome[row["outcome"]]) == outcome


def test_the_file_says_what_the_log_says(log: CorrectionLog, rows: list[dict[str, str]]) -> None:
    def column(name: str) -> list[float]:
        return [float(row[name]) for row in rows]

    assert column("predicted_miss_north_m") == log.miss[:, 1].tolist()
    assert column("time_to_go_s") == log.to_go.tolist()
    assert column("bank_angle_12_rad") == log.plans.values[12].tolist()
    assert column("angle_of_attack_change_4_rad") == log.plans.values[N_PLAN - 1].tolist()
    assert column("wind_east_truth_m_per_s") == log.estimates.truth[:, 3].tolist()
    wide = 3.0 * np.sqrt(log.estimates.covariance[:, 5, 5])
    np.testing.assert_allclose(column("angle_3_sigma_rad"), wide, rtol=1e-15)


def test_the_plan_is_predicted_to_arrive_and_the_estimate_holds_the_truth(
    log: CorrectionLog,
) -> None:
    """What an independent reader of the numbers would ask of them."""
    assert np.all(np.abs(log.times + log.to_go - log.flight.final_time)[log.to_go < 30.0] < 3.0)
    assert np.median(np.linalg.norm(log.miss[:, :2], axis=1)) < 50.0
    assert np.all(log.margin <= 0.05)
    known = log.estimates
    lift_to_drag = np.log(log.flight.truth.numbers["lift_factor"][0]) - np.log(
        log.flight.truth.numbers["drag_factor"][0]
    )
    np.testing.assert_allclose(known.truth[:, 2], lift_to_drag, rtol=1e-12)
    inside = np.abs(known.mean - known.truth) <= 3.0 * known.deviation
    assert inside.mean() > 0.9


def test_predictions_of_many_flights_are_those_of_each(
    mission: Mission, scheme: Scheme, log: CorrectionLog
) -> None:
    many = predicted_misses(mission, scheme, CASE + 1)
    assert many.actual_miss[CASE] == pytest.approx(log.flight.miss[0], abs=1e-6)
    last = np.searchsorted(log.times, log.flight.final_time[0] - many.to_go, side="right") - 1
    of_one = np.linalg.norm(log.miss[:, :2], axis=1)[last[last >= 0]]
    np.testing.assert_allclose(many.miss[last >= 0, CASE], of_one, rtol=1e-9, atol=1e-6)
    assert len(image_bytes(time_to_go_figure(many))) > 10_000


def test_the_figure_has_every_plan_and_every_correction(
    mission: Mission, log: CorrectionLog
) -> None:
    bank, change, misses, _ = corrections_figure(mission, log, "flight").axes
    for axes in (bank, change):
        assert len(axes.collections[0].get_segments()) == len(log)
    points = [line for line in misses.lines if line.get_marker() not in ("None", "")]
    assert sum(len(line.get_xdata()) for line in points) == len(log)


def test_a_scheme_that_does_not_correct_is_refused(mission: Mission, guidance: Guidance) -> None:
    sentence = "expected a scheme that corrects its plan in flight"
    with pytest.raises(ValueError, match=sentence):
        fly_logged(mission, Scheme(guidance, "everything"), CASE)
    with pytest.raises(ValueError, match=sentence):
        predicted_misses(mission, Scheme(guidance, "everything"), 2)
