"""SOLVED is a claim about a flight: every answer of `solve` is flown again, and says what that found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ampi.missions import Mission, load_mission
from ampi.missions.family import MissionFamily
from ampi.missions.loading import parse_mission
from ampi.missions.path_limits import KEPT, PathLimits
from ampi.propagation import reintegration
from ampi.propagation.reintegration import (
    IntegrationError,
    flight_checks,
    flown_again,
    reintegrate,
)
from ampi.pseudospectral.mesh import Mesh, Phase
from ampi.scp.guess import ConstantBank
from ampi.scp.problem.shortfall import outcome_sentence
from ampi.scp.solve import optimum, solve
from ampi.trajectory import POSITION_TOLERANCE, FlightCheck, Status, Trajectory

GUESS = ConstantBank(np.radians(30.0))
ORBITAL = Path(__file__).parent / "orbital.toml"
MARS = Path(__file__).parent / "mars.toml"


def with_limits(mission: Mission, **limits: float) -> Mission:
    changed = mission.limits.model_copy(update=limits)
    return mission.model_copy(update={"limits": changed})


@pytest.fixture(scope="module")
def tight(mission: Mission, nominal: Trajectory) -> Mission:
    """Dynamic pressure limited to 90 % of its peak: between the nodes the optimum exceeds it."""
    flight = nominal.statistics.flight
    assert flight is not None
    used = flight.use["dynamic_pressure"] * mission.limits.dynamic_pressure
    return with_limits(mission, dynamic_pressure=0.9 * used)


def test_a_solution_carries_what_its_flight_found(mission: Mission, nominal: Trajectory) -> None:
    flight, again = nominal.statistics.flight, reintegrate(mission, nominal)
    assert flight is not None
    assert flight.accurate
    assert flight.position_error == again.position_error[0]
    assert list(flight.use) == list(PathLimits.of(mission).names)
    assert list(flight.use.values()) == again.peak[0].tolist()
    summary = nominal.summary()
    assert summary["reintegrated_position_error_m"] == flight.position_error
    assert summary["greatest_limit_use"] == max(flight.use.values())


def test_a_limit_exceeded_between_the_nodes_is_no_solution(tight: Mission) -> None:
    nodal = optimum(tight, guess=GUESS)
    assert nodal.status is Status.SOLVED
    found = solve(tight, guess=GUESS)
    assert np.array_equal(found.states, nodal.states)
    assert found.status is Status.INACCURATE
    assert not found.status.ok
    assert found.status.converged
    flight = found.statistics.flight
    assert flight is not None
    assert 1.0 + KEPT < flight.use["dynamic_pressure"] < 1.02
    assert list(flight.exceeded) == ["dynamic_pressure"]
    said = outcome_sentence(tight, found)
    assert f"uses {100.0 * flight.use['dynamic_pressure']:.4g} % of dynamic_pressure" in said
    assert said.endswith("try: ampi solve --refine, [limits] dynamic_pressure_margin.")


def test_a_margin_keeps_the_limit_itself(tight: Mission) -> None:
    """The optimum uses 96 % at its nodes, and the flight less than all between them."""
    asked = with_limits(tight, dynamic_pressure_margin=0.04)
    found = solve(asked, guess=GUESS)
    assert found.status is Status.SOLVED
    flight = found.statistics.flight
    assert flight is not None
    assert 0.96 <= flight.use["dynamic_pressure"] <= 1.0
    times, rate = found.times, found.bank_rate
    used = PathLimits.of(asked).use(asked.flight_model, found.states, rate, times)
    assert float(np.max(used[0])) == pytest.approx(0.96, abs=1e-6)


@pytest.mark.parametrize(
    ("error", "use", "accurate"),
    [
        (POSITION_TOLERANCE, 1.0 + KEPT, True),
        (1.001 * POSITION_TOLERANCE, 0.5, False),
        (0.0, 1.0 + 1.001 * KEPT, False),
        (np.nan, 0.5, False),
        (0.0, np.nan, False),
    ],
)
def test_what_is_tolerated(
    mission: Mission, nominal: Trajectory, error: float, use: float, accurate: bool
) -> None:
    flight = FlightCheck(error, 0.0, 0.0, {"heat_flux": use, "load_factor": 0.1})
    assert flight.accurate is accurate
    judged = nominal.judged_by(flight)
    assert judged.status is (Status.SOLVED if accurate else Status.INACCURATE)
    assert judged.statistics.flight == flight
    missed = replace(nominal, status=Status.TARGET_MISSED).judged_by(flight)
    assert missed.status is Status.TARGET_MISSED  # the first fault stays


def test_a_limit_exceeded_by_far_is_a_number_one_can_read(
    mission: Mission, nominal: Trajectory
) -> None:
    judged = nominal.judged_by(FlightCheck(1.0, 0.0, 0.0, {"bank_rate": 593.7}))
    assert "uses 59,370 % of bank_rate" in outcome_sentence(mission, judged)


def test_a_flight_that_cannot_be_integrated_is_far_off(
    mission: Mission, nominal: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Alone, and in a batch without harm to its company."""
    real = reintegration.reintegrate_many

    def gives_up(family: MissionFamily, *arguments: object) -> object:
        if np.any(family.entry_states[:, 3] > 4800.0):
            raise IntegrationError("step size")
        return real(family, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(reintegration, "reintegrate_many", gives_up)
    faster = np.array([0.0, 0.0, 0.0, 100.0, 0.0, 0.0])
    fast = mission.with_entry(mission.entry_state + faster)
    states, final_time = np.stack([nominal.states] * 2), np.full(2, nominal.final_time)
    family = MissionFamily.of([fast, mission])
    lost, kept = flight_checks(family, nominal.mesh, states, final_time)
    assert np.isinf(lost.position_error)
    assert kept == nominal.statistics.flight
    assert flown_again(fast, nominal).status is Status.INACCURATE
    assert "cannot be integrated" in outcome_sentence(fast, flown_again(fast, nominal))


def test_where_nothing_flies_nothing_is_flown_again(mission: Mission, nominal: Trajectory) -> None:
    stopped = replace(nominal, status=Status.STALLED)
    assert flown_again(mission, stopped) is stopped


def test_a_method_of_the_literature_is_flown_again_too(
    mission: Mission, nominal: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """cavh_liu2015 by liu2015 lies 172 km from its own flight, and was called solved."""
    states = nominal.states.copy()
    states[6] += np.radians(1.0)
    unflown = replace(nominal.statistics, flight=None)
    coarse = replace(nominal, states=states, statistics=unflown)
    monkeypatch.setattr("ampi.scp.solve._by_the_literature", lambda *arguments: coarse)
    plain = mission.model_copy(update={"objective": load_mission("rlv_liu2024").objective})
    plain = plain.with_mesh(Mesh((Phase((20, 20)),)))
    found = solve(plain, method="liu2024")
    assert found.status is Status.INACCURATE
    flight = found.statistics.flight
    assert flight is not None
    assert flight.position_error > 1e3


def test_bank_limits_hold_at_and_between_the_nodes_on_the_way_to_an_optimum() -> None:
    """An accepted iterate lay 6.6e-6 rad beyond: no convex step led back, on the optimum."""
    mission = parse_mission(ORBITAL.read_text(encoding="utf-8"))
    found = solve(mission)
    assert found.status is Status.SOLVED
    assert found.cost == pytest.approx(0.0008475, rel=1e-3)
    flight = found.statistics.flight
    assert flight is not None
    assert 1.0 - KEPT < flight.use["bank_angle"] < 1.0 + KEPT
    assert np.abs(found.states[6]).max() <= mission.limits.bank_angle * (1.0 + 1e-9)


def test_a_soft_target_is_met_as_well_as_its_weights_ask() -> None:
    """0.57 km from it on a planet half the Earth's size: that is not out of reach."""
    found = solve(load_mission(MARS))
    assert found.status is Status.SOLVED
    assert abs(found.states[0, -1] - 9e3) < 1.0
