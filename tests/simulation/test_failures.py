"""Every flight has exactly one class, by the precedence that is written."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.simulation.closed_loop import _Tally
from ampi.simulation.estimates.failures import FailureClass, Reach, classify, counts, skipped
from ampi.simulation.flights import Flights
from ampi.simulation.plant import FlightStatus
from ampi.simulation.statistics import judge

laws = settings(deadline=None, max_examples=60)


def test_one_flight_of_every_class() -> None:
    reached, ground, late, broken, slow = (
        int(FlightStatus[name])
        for name in ("REACHED_SPEED", "GROUND", "TIME_LIMIT", "NOT_FINITE", "STARTED_SLOW")
    )
    status = np.array([reached, broken, slow, ground, late, ground, late, reached, reached])
    far = np.array([False, True, True, True, False, False, False, False, True])
    up = np.array([False, True, False, True, True, False, False, False, False])
    reach = Reach(np.where(far, 9e5, 5e5), np.full(9, 4e5), np.full(9, 8e5))
    passed, arrived = np.arange(9) == 0, np.isin(np.arange(9), [0, 8])
    got = classify(status, passed, arrived, skipped=up, reach=reach)
    assert got.tolist() == [int(kind) for kind in FailureClass]
    assert [share.count for share in counts(got).values()] == [1] * len(FailureClass)


@laws
@given(seed=st.integers(0, 10_000), n=st.integers(0, 60))
def test_classes_follow_the_precedence_and_add_up(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    status = rng.integers(0, len(FlightStatus), n)
    arrived = (status == FlightStatus.REACHED_SPEED) & (rng.random(n) < 0.7)
    passed, up = arrived & (rng.random(n) < 0.5), rng.random(n) < 0.3
    distance, least = rng.uniform(0.0, 3.0, (2, n))
    least[rng.random(n) < 0.3] = np.nan
    reach = Reach(distance, least, least + 1.0)
    got = classify(status, passed, arrived, skipped=up, reach=reach)

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
        if not arrived[i] and not (
            least[i] <= distance[i] <= least[i] + 1.0 or least[i] != least[i]
        ):
            return FailureClass.OUT_OF_REACH
        if up[i]:
            return FailureClass.SKIP
        if status[i] in ends:
            return ends[FlightStatus(status[i])]
        return FailureClass.LIMIT if arrived[i] else FailureClass.MISSED

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


def test_a_skip_rises_after_its_descent_and_does_not_come_back() -> None:
    nan, late, ground, reached = np.nan, FlightStatus.TIME_LIMIT, FlightStatus.GROUND, 0
    cases: list[tuple[float, int, bool]] = [
        (100.0, late, True),  # above 85 and its time was up
        (90.0, reached, False),  # a bounce that came back
        (84.0, late, False),  # long, but within the atmosphere
        (130.0, ground, True),  # above its entry
        (130.0, reached, True),
        (120.0, ground, False),  # as high as its entry
        (nan, late, False),  # never rose
        (nan, FlightStatus.NOT_FINITE, False),
    ]
    rebound = 1e3 * np.array([case[0] for case in cases])
    status = np.array([int(case[1]) for case in cases])
    assert skipped(rebound, status, 85e3, 120e3).tolist() == [case[2] for case in cases]


def test_a_rebound_comes_after_a_descent(mission: Mission, guidance: Guidance) -> None:
    """A climb from the entry is none."""
    nan = np.nan
    altitudes = np.array(
        [
            [120.0, 122.0, 110.0, 80.0, 60.0],
            [120.0, 100.0, 60.0, 90.0, 70.0],
            [120.0, 122.0, 110.0, 121.0, 60.0],
            [120.0, 80.0, 60.0, 90.0, 100.0],
        ]
    )
    tally = _Tally(4, guidance, np.tile(mission.nominal_parameters, (4, 1)))
    for altitude in altitudes.T:
        here = SimpleNamespace(
            x=np.zeros((7, 4)), flying=np.array([True] * 3 + [altitude[3] < 95.0])
        )
        here.x[0] = altitude
        tally.count(here, np.zeros(4), 0.5)  # type: ignore[arg-type]
    assert np.array_equal(tally.rebound, [nan, 90.0, 121.0, 90.0], equal_nan=True)
    assert np.array_equal(tally.cycles, [5, 5, 5, 3])


def test_arrays_of_other_flights_are_refused() -> None:
    three = np.zeros(3, dtype=np.int64)
    with pytest.raises(ValueError, match=r"one value for each of 3 flights, not so for \['NONE'\]"):
        classify(three, np.zeros(2, dtype=bool), three > 0)
    with pytest.raises(ValueError, match=r"\['SKIP'\]"):
        classify(three, three > 0, three > 0, skipped=np.zeros(4, dtype=bool))


def test_classes_that_are_none() -> None:
    with pytest.raises(ValueError, match="expected members of FailureClass"):
        counts(np.array([0, 17]))


def test_the_verdict_counts_them(make_flights: Callable[..., Flights]) -> None:
    status = np.resize([int(s) for s in FlightStatus], 50)
    flights = make_flights(50, status=status)
    verdict = judge(flights)
    assert verdict.classes["NONE"].count == verdict.passed.count
    assert sum(share.count for share in verdict.classes.values()) == 50
    assert verdict.as_dict()["classes"]["GROUND"]["count"] == 10
