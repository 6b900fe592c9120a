"""What a method may be asked for, and the one sentence when it may not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ampi.missions import Mission, load_mission
from ampi.missions.loading import shipped_missions
from ampi.scp.guess import ConstantBank
from ampi.scp.problem.capabilities import (
    CONDENSED,
    METHODS,
    Capabilities,
    MethodError,
    asked_for,
    check,
)
from ampi.scp.solve import solve

OTHERS = {
    **METHODS,
    "able": Capabilities(CONDENSED.constraints | {"bank_angle_minimum"}, CONDENSED.terms),
}


def test_the_condensed_method_knows_all_but_a_least_bank_angle() -> None:
    for name in shipped_missions():
        constraints, terms = asked_for(load_mission(name))
        assert set(terms) <= CONDENSED.terms
        assert set(constraints) - CONDENSED.constraints <= {"bank_angle_minimum"}


def test_what_is_asked_for_is_read_from_the_mission() -> None:
    constraints, terms = asked_for(load_mission("cavh_liu2015"))
    wanted = {"drag_floor", "no_fly_zone", "final flight_path_angle", "final azimuth"}
    assert set(constraints) == wanted
    assert set(terms) == {"flight_time", "bank_rate_effort"}
    assert asked_for(load_mission("shefex3")) == (
        ["fixed phases"],
        ["bank_rate_effort", "target weights"],
    )


def test_a_constraint_that_the_method_does_not_know_is_named() -> None:
    mission = load_mission("x33_liu2015")
    with pytest.raises(
        MethodError, match=r"bank_angle_minimum: .*'exact_hessian' \(liu2015 knows it\)"
    ):
        solve(mission)
    with pytest.raises(
        MethodError, match=r"\(liu2015, able know it\); choose another method or remove it"
    ):
        check(mission, "exact_hessian", OTHERS)
    check(mission, "able", OTHERS)


def test_a_term_that_the_method_does_not_know_is_named(mission: Mission) -> None:
    poor = {
        "poor": Capabilities(CONDENSED.constraints, frozenset()),
        "exact_hessian": CONDENSED,
    }
    with pytest.raises(MethodError, match=r"bank_rate_effort: .*\(exact_hessian knows it\)"):
        check(mission, "poor", poor)


def test_an_unknown_method_is_named(mission: Mission) -> None:
    with pytest.raises(
        MethodError, match=r"method: expected one of exact_hessian, .*, got 'simplex'"
    ):
        solve(mission, method="simplex")


@pytest.mark.parametrize("method", ["zhou2021", "zhou2021_fixed", "liu2015"])
def test_a_bank_angle_for_a_method_that_starts_from_straight_lines_is_refused(method: str) -> None:
    mission = load_mission("x33_liu2015" if method == "liu2015" else "cavh_zhou2021")
    with pytest.raises(
        MethodError, match=rf"guess: method '{method}' starts from straight lines .*; leave it out"
    ):
        solve(mission, method=method, guess=ConstantBank(0.5))


@pytest.mark.parametrize(("degrees", "told"), [(61.0, "61"), (-90.0, "-90"), (np.nan, "nan")])
def test_a_bank_angle_beyond_the_limit_is_refused(
    mission: Mission, degrees: float, told: str
) -> None:
    message = rf"guess: expected a bank angle between ±60°, .* mission shefex3; got {told}°"
    with pytest.raises(MethodError, match=message):
        solve(mission, guess=ConstantBank(float(np.radians(degrees))))


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"free": ("altitude",)}, "free final state"),
        ({"altitude_range": (20e3, 40e3)}, "final range"),
        ({"bank_angle": (0.0, 0.0)}, "final bank_angle"),
    ],
)
def test_over_energy_the_final_state_that_is_not_known_is_named(
    changes: dict[str, Any], name: str
) -> None:
    mission = load_mission("cavh_liu2015")
    other = mission.model_copy(update={"target": mission.target.model_copy(update=changes)})
    check(other, "exact_hessian")
    with pytest.raises(MethodError, match=rf"^{name}: .*not known to method 'liu2015' \(exact"):
        check(other, "liu2015")
