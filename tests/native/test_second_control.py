"""The angle of attack in closed loop: the engine as numpy; who steers it as who follows a schedule."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ampi.guidance import Guidance
from ampi.loading import load_guidance
from ampi.missions.mission import Mission
from ampi.simulation import closed_loop, native_loop
from ampi.tracking.angle_limiter import AngleRange
from tests.native.conftest import LAWS
from tests.native.test_native_loop import METRES, assert_same_flights, flown
from tests.support.databases import small_database
from tests.support.steered import steered_mission
from tests.support.truths import nominal_truth


@pytest.fixture(scope="session")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_database(tmp_path_factory)


@pytest.fixture(scope="session")
def modulating(database: Path) -> dict[str, Guidance]:
    """By law; the nominal cycle is half a second."""
    return {law: load_guidance(database, law=law, modulate=True, cycle=0.5) for law in LAWS}


@pytest.fixture(scope="session")
def steered() -> Mission:
    """SHEFEX-3 without a schedule, to a speed that it passes soon."""
    mission = steered_mission()
    target = mission.target.model_copy(update={"speed": 4300.0, "altitude": 55e3})
    return mission.model_copy(update={"target": target})


def told_the_schedule(guidance: Guidance, mission: Mission) -> Guidance:
    """The same of a vehicle that steers: the schedule of `mission`, over time, is its row."""
    table, schedule = guidance.table, mission.flight_model.vehicle.angle_of_attack
    assert schedule is not None
    assert schedule.variable == "time"
    mesh = mission.pseudospectral_mesh
    rows = [[schedule(t, 0.0) for t in mesh.times(tf)] for tf in table.final_time.ravel()]
    angle = np.array(rows, dtype=float).reshape(*table.final_time.shape, 1, -1)
    values = np.concatenate([table.values, angle], axis=-2)
    layout = table.layout.with_angle_of_attack
    return Guidance(
        replace(table, values=values, layout=layout),
        guidance.limits,
        law=guidance.law,
        modulation=guidance.modulation,
        angles=AngleRange(0.1, 0.8, 0.1),
        cycle=0.5,
    )


@pytest.mark.parametrize("law", LAWS)
def test_flights_that_modulate_are_those_of_numpy(
    short: Mission, modulating: dict[str, Guidance], law: str
) -> None:
    guidance = modulating[law]
    native = flown(native_loop, short, guidance, "everything", 4)
    assert_same_flights(native, flown(closed_loop, short, guidance, "everything", 4))
    moved = np.nanmax(np.abs(native.angle_of_attack), axis=1)
    assert np.any(moved > np.radians(0.1)), moved


@pytest.mark.parametrize("law", LAWS)
def test_flights_without_a_schedule_are_those_of_numpy(
    mission: Mission, steered: Mission, modulating: dict[str, Guidance], law: str
) -> None:
    guidance = told_the_schedule(modulating[law], mission)
    native = flown(native_loop, steered, guidance, "everything", 4)
    assert_same_flights(native, flown(closed_loop, steered, guidance, "everything", 4))
    assert np.nanmin(native.angle_of_attack) > 0.1


def test_who_steers_along_the_schedule_flies_as_who_follows_it(
    mission: Mission, short: Mission, steered: Mission, guidance: Guidance
) -> None:
    """But for a cycle: what is commanded at its begin is reached at its end."""
    parameters = np.tile(mission.nominal_parameters, (2, 1))
    parameters[1, 0] += 30.0
    truth, off = nominal_truth(parameters), []
    for cycle in (0.5, 0.1):
        own = told_the_schedule(guidance, mission).at_cycle(cycle)
        flights = native_loop.fly_batch(steered.family(parameters), own, truth, 2.0)
        plain = guidance.at_cycle(cycle)
        expected = native_loop.fly_batch(short.family(parameters), plain, truth, 2.0)
        off.append(np.abs((flights.final_states - expected.final_states) * METRES.T).max())
    assert off[0] < 300.0
    assert off[1] < 0.35 * off[0]
    k = expected.peak.shape[1]
    loads = slice(0, k - 2)
    assert flights.peak[:, loads] == pytest.approx(expected.peak[:, loads], rel=1e-2)
    assert np.all(flights.peak[:, k + 1] <= 1.0)  # the rate of the angle of attack
    assert np.all(flights.peak[:, k + 1] > 0.05)
