"""n flights of one clock: each as if it were alone, whatever the others are told."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.onboard.command import Command
from ampi.onboard.health import Health, Steering
from ampi.tracking.bank_limiter import BankLimits

Array = NDArray[np.float64]

laws = settings(deadline=None, max_examples=40)
N = 6
SCALE = np.array([1e5, 1.0, 1.0, 3e3, 0.2, 2.0, 0.5, 0.05])
NONSENSE = np.array([np.nan, np.inf, -1e30, 7.0, 1e5, 0.0])
FIELDS = ("bank_rate", "bank_angle", "angle_of_attack", "steering", "health")


def fields(command: Command, flight: int | None = None) -> list[Any]:
    values = [getattr(command, name) for name in FIELDS]
    return values if flight is None else [value[flight] for value in values]


def limited(synthetic: Guidance) -> Guidance:
    """With the bank limit as a parameter: flights have limits of their own, some near 180°."""
    axes = (np.array([0.7, 1.6, 3.1]), *synthetic.table.axes[1:])
    table = replace(synthetic.table, axes=axes)
    return Guidance(table, BankLimits(1.0, 0.1, 0.07), cycle=0.5, limit_axes={"angle": 0})


@laws
@given(seed=st.integers(0, 2**32 - 1), has_limit_axes=st.booleans())
def test_flights_do_not_see_each_other(
    synthetic: Guidance, seed: int, has_limit_axes: bool
) -> None:
    """Sane and insane navigation, turns, silences and ends, of all or of some."""
    rng = np.random.default_rng(seed)
    guidance = limited(synthetic) if has_limit_axes else synthetic
    alone = guidance.at_cycle(0.5)
    parameters = rng.uniform(-1.3, 1.3, (N, 6))
    if has_limit_axes:
        parameters[:, 0] = rng.uniform(0.5, 3.3, N)
    times = np.cumsum(rng.choice([0.5, 0.5, 0.5, 0.0, 7.0, 30.0], 25))
    times[rng.random(25) < 0.1] = np.nan
    told = []
    for _ in times:
        navigation = SCALE[:, None] * rng.standard_normal((8, N))
        wrong = rng.random((8, N)) < 0.04
        navigation[wrong] = rng.choice(NONSENSE, wrong.sum())
        told.append(navigation)
    guidance.begin(parameters)
    together = [guidance.step(t, x) for t, x in zip(times, told, strict=True)]
    for i in range(N):
        alone.begin(parameters[i])
        for time, navigation, expected in zip(times, told, together, strict=True):
            got = alone.step(time, navigation[:, i])
            assert fields(got) == fields(expected, i)
            column = np.array([got.bank_rate, got.bank_angle, got.angle_of_attack])
            assert np.all(np.isfinite(column))


def test_a_batch_of_one_is_told_and_answered_as_a_batch(synthetic: Guidance) -> None:
    synthetic.begin([0.1] * 6)
    one = synthetic.step(10.0, SCALE)
    synthetic.begin([[0.1] * 6])
    batch = synthetic.step(10.0, SCALE[:, None])
    assert fields(batch, 0) == fields(one)
    assert isinstance(one.bank_rate, float)
    assert isinstance(one.health, Health)
    assert isinstance(one.steering, Steering)
    assert batch.bank_rate.shape == batch.health.shape == (1,)


def test_by_what_it_steers_is_told(synthetic: Guidance) -> None:
    synthetic.begin(np.full((3, 6), 0.1))
    navigation = np.repeat(synthetic.flown.at(np.full(3, 12.5))[:8, :1], 3, axis=1)
    navigation[3, 1] = np.nan
    navigation[7, 2] = np.nan  # of the bank rate alone the last command knows
    command = synthetic.step(10.0, navigation)
    assert command.steering.tolist() == [Steering.TRACKED, Steering.REFERENCE, Steering.TRACKED]
    assert command.health.tolist() == [Health.GOOD, Health.BAD_NAVIGATION, Health.BAD_NAVIGATION]
    held = synthetic.step(10.5 + synthetic.flown.final_time.max(), navigation)
    assert held.steering.tolist() == [Steering.TRACKED, Steering.REFERENCE, Steering.TRACKED]
    assert set(held.health.tolist()) == {Health.BAD_TIME}  # too long a silence: doubted once
    held = synthetic.step(11.0 + synthetic.flown.final_time.max(), navigation)
    assert held.steering.tolist() == [Steering.HELD] * 3
    assert held.health.tolist() == [Health.AFTER_FINAL_TIME] * 3


def test_each_flight_is_held_at_its_own_end(synthetic: Guidance) -> None:
    rng = np.random.default_rng(4)
    synthetic.begin(rng.uniform(-1.0, 1.0, (20, 6)))
    final = synthetic.flown.final_time
    for time in np.linspace(94.0, 106.0, 40):
        command = synthetic.step(time, np.repeat(0.1 * SCALE[:, None], 20, axis=1))
        assert np.array_equal(command.steering == Steering.HELD, time >= final)
    assert np.ptp(final) > 1.0


def test_a_navigation_of_another_number_of_flights_is_none(synthetic: Guidance) -> None:
    synthetic.begin(np.full((3, 6), 0.1))
    for navigation in (SCALE, np.ones((8, 2)), np.ones((7, 3)), None):
        command = synthetic.step(10.0, navigation)  # type: ignore[arg-type]
        assert command.bank_rate.shape == (3,)
        assert np.all(np.isfinite(command.bank_rate))
        assert command.steering.tolist() == [Steering.REFERENCE] * 3
        synthetic.reset()


def test_the_bank_angle_is_believed_where_another_state_is_not(synthetic: Guidance) -> None:
    synthetic.begin([0.1] * 6)
    navigation = 0.1 * SCALE
    navigation[[2, 6]] = np.nan, 0.6
    for time in (10.0, 10.5):
        command = synthetic.step(time, navigation)
        turned = 0.25 * (navigation[7] + command.bank_rate)
        assert command.bank_angle == pytest.approx(0.6 + turned, abs=1e-12)


@pytest.mark.parametrize(
    "parameters",
    [None, "here", [1.0], np.zeros(7), [[1.0, [2.0]]], np.zeros((0, 6)), np.zeros((1, 2, 3)), 0.3],
)
def test_a_flight_of_which_no_parameters_are_known_begins_all_the_same(
    synthetic: Guidance, parameters: object
) -> None:
    for guidance in (synthetic, limited(synthetic)):
        guidance.begin(parameters)  # type: ignore[arg-type]
        command = guidance.step(0.0, 0.1 * SCALE)
        assert command.health is Health.BAD_PARAMETERS
        assert np.isfinite(command.bank_rate)


def test_parameters_of_the_wrong_length_are_of_as_many_flights(synthetic: Guidance) -> None:
    synthetic.begin(np.zeros((4, 2)))
    command = synthetic.step(0.0, np.repeat(0.1 * SCALE[:, None], 4, axis=1))
    assert command.health.tolist() == [Health.BAD_PARAMETERS] * 4


def test_what_has_been_commanded_stays_as_it_was(synthetic: Guidance) -> None:
    """Commands are the caller's: the next flight, and who writes to one, change no other."""
    navigation = np.repeat(0.1 * SCALE[:, None], 2, axis=1)
    synthetic.begin(np.full((2, 6), 0.1))
    commands = [synthetic.step(0.5 * k, navigation) for k in range(3)]
    kept = [[value.copy() for value in fields(command)] for command in commands]
    commands[2].health[:] = commands[2].steering[:] = 99
    after = synthetic.step(1.5, navigation)
    assert after.health.tolist() == [Health.GOOD] * 2
    assert after.steering.tolist() == [Steering.TRACKED] * 2
    synthetic.begin(np.full((2, 6), 5.0))
    synthetic.step(0.0, np.full((8, 2), np.nan))
    for command, before in zip(commands[:2], kept, strict=False):
        assert all(np.array_equal(a, b) for a, b in zip(fields(command), before, strict=True))


def test_a_flight_that_its_time_begins_remembers_nothing_of_the_last(synthetic: Guidance) -> None:
    """After a new reference a time that does not go on begins a flight, as `begin` does."""
    lost = np.full(8, np.nan)
    synthetic.begin([0.1] * 6)
    expected = synthetic.step(0.0, lost)
    for time in (40.0, 40.5):
        synthetic.step(time, 0.1 * SCALE)
    synthetic.follow(synthetic.reference([0.1] * 6))
    assert fields(synthetic.step(0.0, lost)) == fields(expected)


def test_a_reference_followed_in_flight_keeps_what_has_been_commanded(synthetic: Guidance) -> None:
    synthetic.begin([0.1] * 6)
    for time in (40.0, 40.5):
        before = synthetic.step(time, 0.1 * SCALE)
    synthetic.follow(synthetic.reference([0.1] * 6))
    after = synthetic.step(41.0, np.full(8, np.nan))
    assert abs(after.bank_rate - before.bank_rate) <= 0.07 * 0.5 * (1.0 + 1e-9)
    assert after.bank_angle == pytest.approx(
        before.bank_angle + 0.25 * (before.bank_rate + after.bank_rate), abs=1e-12
    )
