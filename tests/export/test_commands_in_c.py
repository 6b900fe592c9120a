"""Every command of the flight code is that of `Guidance.step`, whatever it is given."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from ampi.onboard.health import Health, Steering
from tests.export.conftest import LawMaker
from tests.support.flight_blobs import blob_of, numpy_commands, recorded, some_parameters
from tests.support.flight_code import FlightCode


@pytest.mark.parametrize("cycle", [None, 0.5])
@pytest.mark.parametrize(
    ("law", "error"),
    [
        ("linear_quadratic", 0.0),
        ("drag_shuttle", 1e-11),
        ("drag_sliding_mode", 1e-11),
        ("linear_steered", 0.0),
        ("shuttle_steered", 1e-11),
        ("sliding_steered", 1e-11),
    ],
)
def test_every_command_is_that_of_the_numpy_guidance(
    code: ctypes.CDLL, entry: LawMaker, law: str, error: float, cycle: float | None
) -> None:
    is_steered = law.endswith("steered") and cycle is None
    guidance = entry(law, is_steered, cycle=cycle, limit_axes={"angle": 2})
    flight = FlightCode(code, blob_of(guidance))
    rng = np.random.default_rng(17)
    told = set()
    parameters = some_parameters(guidance, rng, 20)
    parameters[1:5, 2] = [1e300, -1.0, np.nan, 50.0]  # what is said to be the limit
    for i, p in enumerate(parameters):
        guidance.begin(p)
        flight.begin(p)
        times, navigation, sensed = recorded(guidance, p, rng, 120)
        felt = None if law.startswith("linear") or i % 7 == 0 else sensed
        numbers, flags = numpy_commands(guidance, times, navigation, felt)
        commands = flight.fly(times, navigation, felt)
        assert commands["steering"].tolist() == flags[:, 0].tolist()
        assert commands["health"].tolist() == flags[:, 1].tolist()
        np.testing.assert_allclose(commands["numbers"], numbers, rtol=0.0, atol=error)
        told |= set(flags[:, 1].tolist())
    assert told >= {int(h) for h in Health} - {int(Health.HOLE_REFERENCE), int(Health.NOT_BEGUN)}


@pytest.mark.parametrize("law", ["linear_quadratic", "drag_shuttle"])
def test_another_reference_in_flight_is_taken_up_and_the_clock_goes_on(
    code: ctypes.CDLL, entry: LawMaker, law: str
) -> None:
    guidance = entry(law, limit_axes={"angle": 2})
    flight = FlightCode(code, blob_of(guidance))
    rng = np.random.default_rng(3)
    first, second = some_parameters(guidance, rng, 4)[::2]
    times, navigation, sensed = recorded(guidance, first, rng, 60)
    guidance.begin(first)
    flight.begin(first)
    for part in (slice(0, 30), slice(30, 60)):
        given = (times[part], navigation[part], sensed[part])
        numbers, flags = numpy_commands(guidance, *given)
        commands = flight.fly(*given)
        assert commands["health"].tolist() == flags[:, 1].tolist()
        np.testing.assert_allclose(commands["numbers"], numbers, rtol=0.0, atol=1e-11)
        guidance.follow(guidance.reference(second).copy())
        flight.follow(second)


def test_the_row_of_the_look_up_is_told(code: ctypes.CDLL, entry: LawMaker) -> None:
    guidance = entry()
    flight = FlightCode(code, blob_of(guidance))
    p = np.array([axis[1] for axis in guidance.table.axes])
    guidance.begin(p)
    flight.begin(p)
    for time in (0.0, 29.9, 30.0, 111.0, 5000.0):
        guidance.step(time, np.zeros(8))
        flight.fly([time], np.zeros((1, 8)))
        assert flight.row(7).tolist() == guidance.tracked_states[:, 0].tolist()


def test_a_reference_of_another_table_is_not_taken_up(code: ctypes.CDLL, entry: LawMaker) -> None:
    guidance = entry()
    flight, other = FlightCode(code, blob_of(guidance)), FlightCode(code, blob_of(entry(cycle=0.1)))
    p = np.array([axis[1] for axis in guidance.table.axes])
    flight.begin(p)
    flight.follow(p + 0.1, other)  # of the other one
    FlightCode(code, blob_of(guidance)).follow(p)  # a flight that was not begun
    guidance.begin(p)
    navigation = np.array([*guidance.reference(p).rows[:8, 0]])
    assert (
        flight.fly([0.0], navigation[None])["numbers"][0, 0]
        == guidance.step(0.0, navigation).bank_rate
    )


def test_what_is_not_told_is_not_known(code: ctypes.CDLL, entry: LawMaker) -> None:
    """NULL pointers count as no numbers."""
    guidance = entry(limit_axes={"angle": 2})
    flight = FlightCode(code, blob_of(guidance))
    guidance.begin(np.full(3, np.nan))
    flight.begin(None)
    told = flight.fly([0.0], None)[0]
    expected = guidance.step(0.0, np.full(8, np.nan))
    assert (told["health"], told["steering"]) == (expected.health, expected.steering)
    assert told["numbers"].tolist() == [expected.bank_rate, expected.bank_angle, 0.0]


def test_without_its_table_a_flight_holds_its_last_command_within_its_limits(
    code: ctypes.CDLL, entry: LawMaker
) -> None:
    guidance = entry(cycle=0.5)
    flight, foreign = FlightCode(code, blob_of(guidance)), FlightCode(code, b"nothing")
    p = np.array([axis[1] for axis in guidance.table.axes])
    flight.begin(p)
    navigation = guidance.reference(p).rows[:8, 0].copy()
    navigation[7] = guidance.limits.rate
    navigation[3] += 80.0  # something to steer for
    last = flight.fly(0.5 * np.arange(8), np.repeat(navigation[None], 8, axis=0))["numbers"][-1]
    assert last[0] != 0.0
    flight.table = foreign.table
    change = guidance.limits.acceleration * 0.5
    for _ in range(12):
        told = flight.fly([99.0], np.full((1, 8), np.nan))[0]
        assert (told["health"], told["steering"]) == (Health.NOT_BEGUN, Steering.HELD)
        rate, bank, _ = told["numbers"]
        assert rate == pytest.approx(np.sign(last[0]) * max(abs(last[0]) - change, 0.0), abs=1e-15)
        assert bank == pytest.approx(last[1] + 0.25 * (last[0] + rate), abs=1e-14)
        last = told["numbers"]
    assert last[0] == 0.0


def test_a_flight_that_was_not_begun_commands_no_rate_and_says_so(
    code: ctypes.CDLL, entry: LawMaker
) -> None:
    blob = blob_of(entry())
    zeroed, closed = FlightCode(code, blob), FlightCode(code, blob[:-8])
    closed.begin(np.zeros(3))
    closed.follow(np.zeros(3))
    other = FlightCode(code, blob_of(entry(cycle=0.1)))
    other.begin(np.zeros(3))
    other.table = zeroed.table  # begun with another table
    for flight in (zeroed, closed, other):
        told = flight.fly([0.0], np.zeros((1, 8)))[0]
        assert told["health"] == Health.NOT_BEGUN
        assert told["steering"] == Steering.HELD
        assert told["numbers"].tolist() == [0.0, 0.0, 0.0]
