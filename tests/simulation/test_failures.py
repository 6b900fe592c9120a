"""Every flight has exactly one class, by the precedence that is written."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ampi.simulation.closed_loop import FlightStatus
from ampi.simulation.estimates.failures import FailureClass, Reach, classify, counts, skipped
from ampi.simulation.flights import Flights
from ampi.simulation.statistics import judge

laws = settings(deadline=None, max_examples=60)


def test_one_flight_of_every_class() -> None:
    reached, ground, late, broken, slow = (
        int(FlightStatus[name])
        for name in ("REACHED_SPEED", "GROUND", "TIME_LIMIT", "NOT_FINITE", "STARTED_SLOW")
    )
    status = np.array([reached, broken, slow, ground, late, ground, late, reached, reached])
    far = np.array([False, True, True, True, False, False, False, False, False])
    up = np.array([False, True, False, True, True, False, False, False, False])
    peak = np.full((9, 2), 0.9)
    peak[[1, 3, 7], 1] = 1.5
    reach = Reach(np.where(far, 9e5, 5e5), np.full(9, 4e5), np.full(9, 8e5))
    passed = np.arange(9) == 0
    got = classify(status, passed, peak, skipped=up, reach=reach)
    assert got.tolist() == [int(kind) for kind in FailureClass]
    assert [share.count for share in counts(got).values()] == [1] * len(FailureClass)


@laws
@given(seed=st.integers(0, 10_000), n=st.integers(0, 60))
def test_classes_follow_the_precedence_and_add_up(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    status = rng.integers(0, len(FlightStatus), n)
    passed, up = rng.random((2, n)) < 0.3
    peak = rng.uniform(0.2, 1.1, (n, 3))
    peak[rng.random(n) < 0.1] = np.nan
    distance, least = rng.uniform(0.0, 3.0, (2, n))
    least[rng.random(n) < 0.3] = np.nan
    reach = Reach(distance, least, least + 1.0)
    got = classify(status, passed, peak, skipped=up, reach=reach)

    def one(i: int) -> FailureClass:
        ends = {
            FlightStatus.GROUND: FailureClass.GROUND,
            FlightStatus.TIME_LIMIT: FailureClass.TIME_LIMIT,
        }
        if passed[i]:
            return FailureClass.NONE
        if status[i] == FlightStatus.NOT_FINITE:
            return FailureClass.NOT_A_NUMBER
        if status[i] == FlightStatus.STARTED_SLOW:
            return FailureClass.STARTED_SLOW
        if distance[i] < least[i] or distance[i] > least[i] + 1.0:
            return FailureClass.OUT_OF_REACH
        if up[i]:
            return FailureClass.SKIP
        if status[i] in ends:
            return ends[FlightStatus(status[i])]
        kept = all(use <= 1.001 for use in peak[i])
        return FailureClass.MISSED if kept else FailureClass.LIMIT

    assert got.tolist() == [int(one(i)) for i in range(n)]
    assert sum(share.count for share in counts(got).values()) == n


def test_a_target_within_or_at_an_unknown_range_is_not_out_of_reach() -> None:
    nan = np.nan
    reach = Reach(
        distance=np.array([5.0, 5.0, 5.0, 5.0, 5.0, 4.0]),
        least=np.array([4.0, nan, nan, 6.0, 1.0, 4.0]),
        greatest=np.array([6.0, nan, 4.0, nan, 2.0, 4.0]),
    )
    assert reach.missing.tolist() == [False, False, True, True, True, False]


def test_a_range_that_is_upside_down() -> None:
    one = np.ones(3)
    with pytest.raises(ValueError, match=r"least range below the greatest, .* flights \[1\]"):
        Reach(one, np.array([1.0, 3.0, np.nan]), np.array([2.0, 2.0, 2.0]))


def test_a_skip_rises_after_its_pull_up_and_does_not_come_back() -> None:
    nan, late, ground, reached = np.nan, FlightStatus.TIME_LIMIT, FlightStatus.GROUND, 0
    cases: list[tuple[list[float], int, bool]] = [
        ([120, 80, 60, 90, 100], late, True),  # above 85 and its time was up
        ([120, 80, 60, 90, 70], reached, False),  # a bounce that came back
        ([120, 80, 60, 84, 83], late, False),  # long, but within the atmosphere
        ([120, 80, 60, 130, 125], ground, True),  # above its entry
        ([120, 80, 60, 130, nan], reached, True),
        ([120, 100, 90, 80, 70], late, False),  # never pulled up
        ([120, 122, 110, 80, 60], late, False),  # rose from the entry alone
        ([120, 122, 110, 121, 60], ground, True),  # and again
        ([nan, nan, nan, nan, nan], FlightStatus.NOT_FINITE, False),
    ]
    altitude = 1e3 * np.array([case[0] for case in cases])
    status = np.array([int(case[1]) for case in cases])
    assert skipped(altitude, status, 85e3).tolist() == [case[2] for case in cases]
    assert not skipped(altitude[:, :1], status, 85e3).any()


def test_arrays_of_other_flights_are_refused() -> None:
    three, peak = np.zeros(3, dtype=np.int64), np.ones((3, 1))
    with pytest.raises(ValueError, match=r"one value for each of 3 flights, not so for \['NONE'\]"):
        classify(three, np.zeros(2, dtype=bool), peak)
    with pytest.raises(ValueError, match=r"\['SKIP'\]"):
        classify(three, three > 0, peak, skipped=np.zeros(4, dtype=bool))


def test_classes_that_are_none() -> None:
    with pytest.raises(ValueError, match="expected members of FailureClass"):
        counts(np.array([0, 17]))


def test_the_verdict_counts_them(make_flights: Callable[..., Flights]) -> None:
    status = np.resize([int(s) for s in FlightStatus], 50)
    flights = make_flights(50, status=status)
    found = classify(flights.status, flights.passed, flights.peak)
    verdict = judge(flights, classes=found)
    assert verdict.classes is not None
    assert verdict.classes["NONE"].count == verdict.passed.count
    assert sum(share.count for share in verdict.classes.values()) == 50
    assert verdict.as_dict()["classes"]["GROUND"]["count"] == 10
