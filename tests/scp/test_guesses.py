"""Other first guesses, where one fails: what is kept, and which answers are one branch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ampi.missions import Mission
from ampi.scp import guesses
from ampi.scp.condensed.settings import SolverSettings
from ampi.scp.condensed.trust_region import TrustRegionSettings
from ampi.scp.guess import ConstantBank
from ampi.scp.guesses import SETTINGS, from_any, from_each
from ampi.scp.solve import solve
from ampi.trajectory import Statistics, Status, Trajectory

BANKS = [ConstantBank(angle) for angle in (0.4, -0.4, 0.8, -0.8)]


def ended(nominal: Trajectory, status: Status, cost: float, iterations: int = 10) -> Trajectory:
    statistics = Statistics(iterations=iterations)
    return replace(nominal, status=status, cost=cost, statistics=statistics)


@pytest.fixture(autouse=True)
def few_guesses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guesses, "constant_banks", lambda mission: BANKS)
    monkeypatch.setattr(guesses, "default_guess", lambda mission: BANKS[0])


def test_a_guess_that_succeeds_is_the_only_one(mission: Mission, nominal: Trajectory) -> None:
    asked: list[tuple[ConstantBank, int]] = []

    def solve_from(guess: ConstantBank, most: int) -> Trajectory:
        asked.append((guess, most))
        return nominal

    assert from_any(mission, solve_from, 77) is nominal
    assert asked == [(BANKS[0], 77)]


def test_where_the_first_fails_the_cheapest_solution_of_the_others_is_kept(
    mission: Mission, nominal: Trajectory
) -> None:
    ends = {
        0.4: ended(nominal, Status.STALLED, 0.1),
        -0.4: ended(nominal, Status.SOLVED, 3.0),
        0.8: ended(nominal, Status.SOLVED, 2.0),
        -0.8: ended(nominal, Status.TARGET_MISSED, 1.0),
    }
    found = from_any(mission, lambda guess, most: ends[guess.bank_angle], 300)
    assert (found.status, found.cost) == (Status.SOLVED, 2.0)
    assert [one.bank_angle for one in found.statistics.guesses] == [0.4, -0.4, 0.8, -0.8]
    assert [one.chosen for one in found.statistics.guesses] == [False, False, True, False]
    assert found.statistics.iterations == 10  # of the one that is kept


def test_the_others_share_a_budget_of_iterations(mission: Mission, nominal: Trajectory) -> None:
    given: list[int] = []

    def solve_from(guess: ConstantBank, most: int) -> Trajectory:
        given.append(most)
        return ended(nominal, Status.STALLED, guess.bank_angle, iterations=min(most, 100))

    from_any(mission, solve_from, 300)
    assert given == [300, SETTINGS.iterations, SETTINGS.iterations - 100]


def test_the_least_that_is_left_open_is_kept_where_nothing_is_solved(
    mission: Mission, nominal: Trajectory
) -> None:
    hot = replace(ended(nominal, Status.LIMITS_EXCEEDED, 1.0))
    hot = replace(hot, statistics=Statistics(iterations=1, limit_excess=(0.0, 0.2, 0.0)))
    warm = replace(hot, statistics=Statistics(iterations=1, limit_excess=(0.0, 0.1, 0.0)))
    lost = replace(ended(nominal, Status.GUESS_FAILED, np.nan), states=nominal.states * np.nan)
    ends = dict(zip((0.4, -0.4, 0.8, -0.8), (lost, hot, warm, lost), strict=True))
    found = from_any(mission, lambda guess, most: ends[guess.bank_angle], 300)
    assert found.statistics.limit_excess == (0.0, 0.1, 0.0)


def test_branches_are_numbered_by_their_cost(mission: Mission, nominal: Trajectory) -> None:
    other = replace(nominal, states=-nominal.states, cost=2.0 * nominal.cost)
    close = replace(nominal, cost=nominal.cost * (1.0 + 1e-4))
    failed = ended(nominal, Status.STALLED, 0.0)
    ends = dict(zip((0.4, -0.4, 0.8, -0.8), (other, close, nominal, failed), strict=True))
    results = from_each(mission, lambda guess: ends[guess.bank_angle])
    assert [one.branch for one in results] == [2, 1, 1, None]


def test_a_call_that_confuses_things_is_told_so(mission: Mission) -> None:
    with pytest.raises(ValueError, match="guess: expected a Trajectory, a ConstantBank"):
        solve(mission, guess=0.5)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="mission: expected a Mission, got 'shefex3'"):
        solve("shefex3")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"settings\.max_iterations: expected more than 0, got 0"):
        SolverSettings(max_iterations=0)
    with pytest.raises(ValueError, match=r"settings\.trust_region\.shrink: expected more than 0"):
        SolverSettings(trust_region=TrustRegionSettings(shrink=-0.5))
    with pytest.raises(ValueError, match=r"settings\.corrections: expected a whole number"):
        SolverSettings(corrections=1.5)  # type: ignore[arg-type]


def test_a_status_is_printed_by_its_name() -> None:
    assert str(Status.SOLVED) == f"{Status.SOLVED}" == "SOLVED"
    assert f"{Status.INACCURATE:d}" == "9"
    assert int(Status.INACCURATE) == 9
    assert Status.INACCURATE == 9
