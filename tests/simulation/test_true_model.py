"""The vehicle and the air as they are: each factor where the formula has it, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.vehicle import air_loads_at_angle
from ampi.simulation.profiles import ALTITUDES
from ampi.simulation.true_model import Profiles, TrueAtmosphere, true_model
from tests.support.truths import nominal_truth

Array = NDArray[np.float64]

N, TIME = 5, 70.0  # s, on the slope of the schedule of the angle of attack
laws = settings(deadline=None, max_examples=100)


@pytest.fixture(scope="module")
def family(mission: Mission) -> MissionFamily[Mission]:
    return mission.family(np.tile(mission.nominal_parameters, (N, 1)))


@pytest.fixture(scope="module")
def parameters(mission: Mission) -> Array:
    return np.tile(mission.nominal_parameters, (N, 1))


@pytest.fixture(scope="module")
def states() -> Array:
    """(7, n), hypersonic and supersonic."""
    rng = np.random.default_rng(1)
    low = np.array([2e4, -0.3, 1.1, 7e2, -0.3, -1.6, -1.0])
    high = np.array([8e4, 0.3, 1.3, 4.7e3, 0.1, -1.4, 1.0])
    return rng.uniform(low, high, (N, 7)).T


def loads(family: MissionFamily, states: Array, truth_of: dict[str, object]) -> tuple[Array, Array]:
    """Lift and drag acceleration, (n,) each."""
    truth = nominal_truth(np.zeros((N, 0)), **truth_of)  # type: ignore[arg-type]
    found = true_model(family, truth).air_loads(states, TIME)
    return found.lift, found.drag


# --- profiles -------------------------------------------------------------------------------------


@laws
@given(n=st.integers(1, 5), k=st.integers(2, 30), seed=st.integers(0, 2**32 - 1))
def test_a_profile_is_numpys_interpolation_of_each_flight(n: int, k: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = rng.standard_normal((n, k, 2))
    altitude = rng.uniform(-2e3, (k + 1) * 1e3, n)
    got = Profiles(1e3, values)(altitude)
    assert got.shape == (2, n)
    for i in range(n):
        expected = [np.interp(altitude[i], 1e3 * np.arange(k), values[i, :, f]) for f in (0, 1)]
        assert got[:, i] == pytest.approx(np.array(expected), abs=1e-12)


def test_at_its_points_a_profile_is_its_numbers() -> None:
    values = np.random.default_rng(0).standard_normal((3, 6, 1))
    for k in range(6):
        got = Profiles(1e3, values)(np.full(3, 1e3 * k))[0]
        assert got == pytest.approx(values[:, k, 0], abs=1e-15)


# --- nominal --------------------------------------------------------------------------------------


def test_a_nominal_truth_is_the_mission_to_the_bit(
    family: MissionFamily, parameters: Array, states: Array
) -> None:
    model = true_model(family, nominal_truth(parameters))
    assert (model.wind, model.angle_of_attack_offset) == (None, None)
    got = equations_of_motion(model, states, 0.01, TIME)[:6]
    expected = equations_of_motion(family.flight_model(), states, 0.01, TIME)[:6]
    assert np.array_equal(np.stack(got), np.stack(expected))


def test_neutral_numbers_beside_others_change_no_bit(
    family: MissionFamily, parameters: Array, states: Array
) -> None:
    """A flight whose factors are 1 and whose errors are 0, among flights that have some."""
    changed, nothing = np.array([0.0, 1.0, 1.0, 1.0, 1.0]), np.ones((N, len(ALTITUDES)))
    truth = nominal_truth(
        parameters,
        density_factor=1.0 + 0.2 * changed,
        lift_factor=1.0 + 0.1 * changed,
        drag_factor=1.0 - 0.1 * changed,
        mass_factor=1.0 + 0.02 * changed,
        angle_of_attack_error=0.01 * changed,
        density=nothing,
    )
    got = np.stack(equations_of_motion(true_model(family, truth), states, 0.0, TIME)[:6])
    expected = np.stack(equations_of_motion(family.flight_model(), states, 0.0, TIME)[:6])
    assert np.array_equal(got[:, 0], expected[:, 0])
    assert np.all(got[3, 1:] != expected[3, 1:])


# --- factors --------------------------------------------------------------------------------------

FACTORS = np.array([0.7, 0.9, 1.0, 1.1, 1.3])


@pytest.mark.parametrize(
    ("name", "on_lift", "on_drag"),
    [
        ("density_factor", FACTORS, FACTORS),
        ("lift_factor", FACTORS, np.ones(N)),
        ("drag_factor", np.ones(N), FACTORS),
        ("mass_factor", 1.0 / FACTORS, 1.0 / FACTORS),
    ],
)
def test_a_factor_is_on_the_accelerations_that_the_formula_says(
    family: MissionFamily, states: Array, name: str, on_lift: Array, on_drag: Array
) -> None:
    lift, drag = loads(family, states, {})
    got_lift, got_drag = loads(family, states, {name: FACTORS})
    assert got_lift == pytest.approx(lift * on_lift, rel=1e-13)
    assert got_drag == pytest.approx(drag * on_drag, rel=1e-13)


def test_the_factors_multiply(family: MissionFamily, states: Array) -> None:
    lift, drag = loads(family, states, {})
    factors = {"density_factor": 1.2, "lift_factor": 0.9, "drag_factor": 1.1, "mass_factor": 0.98}
    got_lift, got_drag = loads(family, states, factors)  # type: ignore[arg-type]
    assert got_lift == pytest.approx(lift * 1.2 * 0.9 / 0.98, rel=1e-13)
    assert got_drag == pytest.approx(drag * 1.2 * 1.1 / 0.98, rel=1e-13)


def test_a_profile_of_density_is_on_the_air_of_its_altitude(
    family: MissionFamily, states: Array
) -> None:
    density = np.random.default_rng(2).uniform(0.5, 1.5, (N, len(ALTITUDES)))
    lift, drag = loads(family, states, {})
    got_lift, got_drag = loads(family, states, {"density": density, "density_factor": 1.1})
    factor = 1.1 * np.array([np.interp(states[0, i], ALTITUDES, density[i]) for i in range(N)])
    assert got_lift == pytest.approx(lift * factor, rel=1e-12)
    assert got_drag == pytest.approx(drag * factor, rel=1e-12)


def test_the_speed_of_sound_stays_the_missions(family: MissionFamily, parameters: Array) -> None:
    model = true_model(family, nominal_truth(parameters, density_factor=1.3))
    assert isinstance(model.atmosphere, TrueAtmosphere)
    altitude = np.linspace(2e4, 8e4, N)
    expected = family.flight_model().atmosphere.speed_of_sound(altitude)
    assert np.array_equal(model.atmosphere.speed_of_sound(altitude), expected)


def test_an_error_of_the_angle_of_attack_is_flown_beside_the_schedule(
    family: MissionFamily, states: Array
) -> None:
    """As by another schedule: the vehicle's with that angle added."""
    errors = np.radians([-2.0, -1.0, 0.0, 1.0, 2.0])
    got_lift, got_drag = loads(family, states, {"angle_of_attack_error": errors})
    model = family.flight_model()
    angle = model.vehicle.angle_of_attack(TIME, states[3]) + errors
    expected = air_loads_at_angle(model.vehicle, model.atmosphere, states[0], states[3], angle)
    assert got_lift == pytest.approx(expected.lift, rel=1e-14)
    assert got_drag == pytest.approx(expected.drag, rel=1e-14)
    lift, drag = loads(family, states, {})
    for ratio in (got_lift / lift, got_drag / drag):  # below the stall more angle is more of both
        assert ratio[2] == 1.0
        assert np.all(np.diff(ratio) > 0.0)


# --- wind -----------------------------------------------------------------------------------------


def test_wind_is_the_truths_at_the_altitude_of_each_flight(
    family: MissionFamily, parameters: Array, states: Array
) -> None:
    wind = np.random.default_rng(3).uniform(-60.0, 60.0, (2, N, len(ALTITUDES)))
    model = true_model(family, nominal_truth(parameters, wind=wind))
    assert model.wind is not None
    east, north = model.wind.components(states[0])
    for got, component in ((east, wind[0]), (north, wind[1])):
        expected = [np.interp(states[0, i], ALTITUDES, component[i]) for i in range(N)]
        assert got == pytest.approx(np.array(expected), abs=1e-9)


def test_head_wind_is_felt_as_more_drag(
    family: MissionFamily, parameters: Array, states: Array
) -> None:
    """D grows with the square of the speed through the air."""
    level = states.copy()
    level[4:7] = [[0.0], [np.pi / 2.0], [0.0]]  # due east, wings level
    wind = np.zeros((2, N, len(ALTITUDES)))
    wind[0] = -50.0
    windy = true_model(family, nominal_truth(parameters, wind=wind)).air_loads(level, TIME)
    still = family.flight_model().air_loads(level, TIME)
    expected = (1.0 + 50.0 / level[3]) ** 2
    assert windy.drag / still.drag == pytest.approx(expected, rel=0.02)  # but for the Mach number
    assert windy.drag.min() > 0.0
