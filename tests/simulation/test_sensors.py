"""What flights are told: errors of the size and direction of the truth, of each flight its own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from ampi.simulation.sensors import Sensors
from ampi.simulation.truth import Truth
from tests.support.truths import nominal_truth

Array = NDArray[np.float64]

RADIUS, CYCLE, N = 6378137.0, 0.5, 100
STATE = np.array([5e4, 0.4, 1.1, 3e3, -0.1, -1.5, 0.3])
# channel → its row, a size (SI), and SI per unit of the state told at STATE
ROWS: dict[str, tuple[int, float, float]] = {
    "altitude": (0, 100.0, 1.0),
    "east": (1, 200.0, RADIUS * np.cos(1.1)),
    "north": (2, 300.0, RADIUS),
    "speed": (3, 0.5, 1.0),
    "flight_path_angle": (4, 1e-3, 1.0),
    "azimuth": (5, 2e-3, 1.0),
    "bank_angle": (6, 3e-3, 1.0),
}
AXES = ("along", "up", "right")


def truth(n: int = N, **numbers: ArrayLike) -> Truth:
    return nominal_truth(np.zeros((n, 0)), **numbers)


def told(given: Truth, samples: int = 100, states: Array | None = None) -> Array:
    """Navigation (samples, 8, n) of flights that stay at STATE, or of `states` (samples, 7)."""
    sensors, n = Sensors(given, RADIUS, CYCLE), len(given)
    states = np.tile(STATE, (samples, 1)) if states is None else states
    found = [sensors.navigation(np.repeat(x[:, None], n, axis=1), np.full(n, 0.02)) for x in states]
    return np.array(found)


def felt(given: Truth, force: Array, samples: int = 100) -> Array:
    """Specific force (samples, 3, n)."""
    sensors, n, found = Sensors(given, RADIUS, CYCLE), len(given), []
    for _ in range(samples):
        sensors.navigation(np.repeat(STATE[:, None], n, axis=1), np.zeros(n))
        found.append(sensors.acceleration(np.repeat(force[:, None], n, axis=1)))
    return np.array(found)


# --- navigation -----------------------------------------------------------------------------------


def test_without_errors_the_truth_is_told_to_the_bit() -> None:
    expected = np.array([*STATE, 0.02])[:, None]
    assert np.array_equal(told(truth()), np.broadcast_to(expected, (100, 8, N)))


@pytest.mark.parametrize("channel", list(ROWS))
def test_a_bias_is_added_to_its_channel_alone(channel: str) -> None:
    row, size, per_unit = ROWS[channel]
    sizes = np.linspace(-size, size, N)
    errors = told(truth(**{f"navigation_{channel}_bias": sizes}), 3)[:, :7] - STATE[:, None]
    assert errors[:, row] * per_unit == pytest.approx(np.tile(sizes, (3, 1)), rel=1e-6, abs=1e-6)
    assert np.all(np.delete(errors, row, axis=1) == 0.0)


@pytest.mark.parametrize("channel", list(ROWS))
def test_noise_has_no_mean_its_deviation_and_no_memory_on_its_channel_alone(channel: str) -> None:
    row, size, per_unit = ROWS[channel]
    navigation = told(truth(**{f"navigation_{channel}_noise": size}), 300)
    errors = (navigation[:, row] - STATE[row]) * per_unit / size
    count = errors.size
    assert abs(errors.mean()) < 4.0 / np.sqrt(count)
    assert errors.std() == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * count))
    assert abs((errors[1:] * errors[:-1]).mean()) < 4.0 / np.sqrt(count)  # sample to sample
    assert abs((errors[:, 1:] * errors[:, :-1]).mean()) < 4.0 / np.sqrt(count)  # flight to flight
    assert np.mean(errors**4) == pytest.approx(3.0, abs=4.0 * np.sqrt(96.0 / count))  # normal
    others = np.delete(navigation[:, :7] - STATE[:, None], row, axis=1)
    assert np.all(others == 0.0)


def test_the_noise_of_the_channels_is_independent() -> None:
    numbers = {f"navigation_{name}_noise": size for name, (_, size, _) in ROWS.items()}
    errors = told(truth(**numbers), 300)[:, :7] - STATE[:, None]
    correlations = np.corrcoef(errors.transpose(1, 0, 2).reshape(7, -1))
    assert np.abs(correlations - np.eye(7)).max() < 4.5 / np.sqrt(errors[:, 0].size)


def test_the_bank_rate_is_exact() -> None:
    numbers = {f"navigation_{name}_noise": size for name, (_, size, _) in ROWS.items()}
    assert np.all(told(truth(**numbers))[:, 7] == 0.02)


@pytest.mark.parametrize("latitude", [-1.2, 0.0, 0.8, 1.4])
def test_north_and_east_are_metres_on_the_ground(latitude: float) -> None:
    """By geography in space: the chord to the place told, on the local north and east."""
    state = STATE.copy()
    state[2] = latitude
    given = truth(1, navigation_north_bias=700.0, navigation_east_bias=-400.0)
    longitude_told, latitude_told = told(given, states=state[None])[0, 1:3, 0]

    def place(longitude: float, latitude: float) -> Array:
        cos = np.cos(latitude)
        return RADIUS * np.array(
            [cos * np.cos(longitude), cos * np.sin(longitude), np.sin(latitude)]
        )

    chord = place(longitude_told, latitude_told) - place(state[1], latitude)
    sin_lon, cos_lon = np.sin(state[1]), np.cos(state[1])
    east = np.array([-sin_lon, cos_lon, 0.0])
    north = np.cross(place(state[1], latitude) / RADIUS, east)
    assert chord @ north == pytest.approx(700.0, abs=0.5)
    assert chord @ east == pytest.approx(-400.0, abs=0.5)


@pytest.mark.parametrize("share", [0.02, 0.3, 1.0])
def test_a_sample_is_missing_as_often_as_it_is_said_to_be_and_then_all_of_it(share: float) -> None:
    navigation = told(truth(navigation_dropout=share), 300)
    missing = np.isnan(navigation)
    assert np.array_equal(missing.all(axis=1), missing.any(axis=1))
    frequency, count = missing[:, 0].mean(), missing[:, 0].size
    assert frequency == pytest.approx(share, abs=4.0 * np.sqrt(share * (1.0 - share) / count))
    rest = navigation.transpose(0, 2, 1)[~missing[:, 0]]
    assert np.all(rest == [*STATE, 0.02])


# --- latency --------------------------------------------------------------------------------------


@pytest.mark.parametrize("latency", [0.0, 0.2, 0.5, 1.7])
def test_what_is_told_late_is_the_state_of_that_time(latency: float) -> None:
    """Along lines, which the interpolation between samples keeps; before the first sample, that."""
    times = CYCLE * np.arange(20)
    states = STATE + times[:, None] * np.array([-300.0, 1e-3, 2e-3, -20.0, 1e-3, 2e-3, 0.01])
    navigation = told(truth(2, navigation_latency=[latency, 0.0]), states=states)
    then = np.maximum(times - latency, 0.0)
    expected = np.stack([np.interp(then, times, row) for row in states.T], axis=1)
    assert navigation[:, :7, 0] == pytest.approx(expected, rel=1e-12)
    assert np.array_equal(navigation[:, :7, 1], states)
    assert np.all(navigation[:, 7] == 0.02)  # a gyroscope beside it


def test_the_entry_is_measured_without_being_a_sample_of_what_comes_late() -> None:
    """There the bank angle is not known yet, and no sample has been before."""
    given = truth(1, navigation_latency=0.3, navigation_altitude_bias=50.0)
    sensors = Sensors(given, RADIUS, CYCLE)
    entry = STATE[:, None].copy()
    entry[6] = 0.0
    assert sensors.at_entry(entry, np.zeros(1))[0, 0] == STATE[0] + 50.0
    assert sensors.navigation(STATE[:, None], np.zeros(1))[6, 0] == STATE[6]


# --- accelerometer --------------------------------------------------------------------------------

FORCE = np.array([-40.0, 25.0, 5.0])


def test_without_errors_the_force_is_felt_to_the_bit() -> None:
    assert np.all(felt(truth(), FORCE) == FORCE[:, None])


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_its_bias_is_along_its_axis(axis: int) -> None:
    sizes = np.linspace(-0.1, 0.1, N)
    errors = felt(truth(**{f"accelerometer_{AXES[axis]}_bias": sizes}), FORCE, 2) - FORCE[:, None]
    assert errors[:, axis] == pytest.approx(np.tile(sizes, (2, 1)), abs=1e-12)
    assert np.all(np.delete(errors, axis, axis=1) == 0.0)


def test_its_scale_is_relative_and_common() -> None:
    scales = np.linspace(-0.02, 0.02, N)
    got = felt(truth(accelerometer_scale=scales), FORCE, 2)
    assert got == pytest.approx(np.tile(FORCE[:, None] * (1.0 + scales), (2, 1, 1)), rel=1e-12)


def test_its_noise_is_of_each_component_and_not_that_of_navigation() -> None:
    given = truth(accelerometer_noise=0.05, navigation_altitude_noise=1.0)
    errors = (felt(given, FORCE, 300) - FORCE[:, None]) / 0.05
    altitude = told(given, 300)[:, 0] - STATE[0]
    rows = [*errors.transpose(1, 0, 2).reshape(3, -1), altitude.ravel()]
    count = altitude.size
    assert np.abs(np.mean(rows, axis=1)).max() < 4.0 / np.sqrt(count)
    assert np.std(rows, axis=1) == pytest.approx(np.ones(4), abs=4.0 / np.sqrt(2.0 * count))
    assert np.abs(np.corrcoef(rows) - np.eye(4)).max() < 4.5 / np.sqrt(count)


# --- a flight's own -------------------------------------------------------------------------------


def test_noise_depends_on_no_other_flight_and_on_no_order() -> None:
    numbers: dict[str, Any] = {f"navigation_{name}_noise": row[1] for name, row in ROWS.items()}
    given = truth(5, navigation_dropout=0.2, accelerometer_noise=0.1, **numbers)
    samples = 300  # more than one block of them
    together, force = told(given, samples), felt(given, FORCE, samples)
    for flights in ([3], [4, 0, 2]):
        some = given.take(flights)
        assert np.array_equal(told(some, samples), together[..., flights], equal_nan=True)
        assert np.array_equal(felt(some, FORCE, samples), force[..., flights])


def test_a_flight_has_the_noise_of_its_seed() -> None:
    given = nominal_truth(np.zeros((3, 0)), seeds=[7, 8, 7], navigation_altitude_noise=1.0)
    altitude = told(given)[:, 0]
    assert np.array_equal(altitude[:, 0], altitude[:, 2])
    assert not np.any(altitude[:, 0] == altitude[:, 1])


def test_what_others_may_suffer_changes_no_bit_of_a_flight_that_does_not() -> None:
    given = truth(
        2,
        navigation_altitude_noise=[0.0, 1.0],
        navigation_dropout=[0.0, 0.5],
        navigation_latency=[0.0, 0.7],
        navigation_north_bias=[0.0, 9.0],
    )
    assert np.array_equal(told(given)[..., 0], told(truth(1))[..., 0])
