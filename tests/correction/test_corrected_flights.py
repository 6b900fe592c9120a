"""Whole flights by both engines: the same plans, estimates, outcomes and commands, and the landing.

The vehicle is the model itself with factors, wind and an error of the angle of attack that guidance is
not told, moved every two seconds; both engines are told the same. Where numpy takes its sines from the C
library the engines agree to the bit, which is not asked for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi._native.engine import is_available
from ampi.correction.corrector import CorrectionOutcome
from ampi.correction.onboard_correction import NO_AXIS, Correction
from ampi.correction.state import CorrectionState
from ampi.guidance import NATIVE, NUMPY, Guidance
from ampi.guidance_cycle import GuidanceCycle
from ampi.loading import load_guidance
from ampi.onboard.command import Command
from ampi.onboard.flight_model import ALTITUDE, BANK, LATITUDE, LONGITUDE, SPEED, Factors
from ampi.onboard.health import Health, Steering
from tests.support.databases import small_database
from tests.support.missions import small_mission

Array = NDArray[np.float64]

needs_c = pytest.mark.skipif(not is_available(), reason="without its compiled engine")
N, CYCLE = 5, 2.0
LOST, SLEEPING, MOVED = 1, 2, 3  # flights: navigation is lost, the accelerometer, the target moves
LOST_FROM, LOST_UNTIL, MOVED_AT = 200.0, 230.0, 300.0
AGREED = 1e-9


@dataclass(frozen=True)
class Cycle:
    """What was told at one instant, and what was commanded."""

    time: float
    navigation: Array  # (8, n)
    sensed: Array  # (3, n)
    command: Command
    known: CorrectionState


@dataclass(frozen=True)
class Flown:
    """Flights to the target's speed."""

    cycles: list[Cycle]
    final: Array  # (7, n)
    time: Array  # (n,)


def truth() -> Factors:
    """One that is hard to reach, and others."""
    return Factors(
        density=np.array([1.06, 0.95, 1.03, 0.97, 1.0]),
        lift=np.array([0.97, 1.03, 1.0, 1.02, 0.85]),
        wind_east=np.array([20.0, -10.0, 0.0, 15.0, 0.0]),
        wind_north=np.array([0.0, 10.0, -20.0, 5.0, 0.0]),
        angle_of_attack=np.array([0.003, 0.0, -0.003, 0.0, 0.0]),
    )


def told(state: Array, rate: Array, sensed: Array, time: float) -> tuple[Array, Array]:
    """Navigation and accelerometer with what goes wrong."""
    navigation, felt = np.concatenate([state, rate[None]]), sensed.copy()
    if LOST_FROM <= time < LOST_UNTIL:
        navigation[:, LOST], felt[:, SLEEPING] = np.nan, np.nan
    return navigation, felt


def flown(guidance: Guidance, correction: Correction, entry: Array) -> Flown:
    """All to the speed of their targets, steered by `guidance`."""
    model, own, state = correction.model, truth(), entry.copy()
    rate, angle, cycles = np.zeros(N), np.zeros(N), []
    flying, final, ended = np.ones(N, dtype=bool), np.full_like(entry, np.nan), np.full(N, np.nan)

    def rates(x: Array, bank_rate: Array, time: float) -> Array:
        return model.rates(x, bank_rate, time, here)

    while flying.any():
        time = CYCLE * len(cycles)
        here = own._replace(angle_of_attack=own.angle_of_attack + angle)
        sensed = np.stack(model.sensed(state, time, here))
        navigation, felt = told(state, rate, sensed, time)
        if time == MOVED_AT:
            guidance.aim(target_of(correction))
        command = guidance.step(time, navigation, felt)
        cycles.append(Cycle(time, navigation, felt, command, guidance.correction_state))
        k1 = rates(state, command.bank_rate, time)
        k2 = rates(state + 0.5 * CYCLE * k1, command.bank_rate, time + 0.5 * CYCLE)
        k3 = rates(state + 0.5 * CYCLE * k2, command.bank_rate, time + 0.5 * CYCLE)
        k4 = rates(state + CYCLE * k3, command.bank_rate, time + CYCLE)
        change = CYCLE / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        slow = flying & (state[SPEED] + change[SPEED] <= correction.target[3])
        share = (correction.target[3] - state[SPEED]) / change[SPEED]
        final[:, slow] = (state + share * change)[:, slow]
        ended[slow] = (time + share * CYCLE)[slow]
        flying &= ~slow
        state = np.where(flying, state + change, state)  # who has landed waits there
        rate, angle = command.bank_rate.copy(), command.angle_of_attack.copy()
    return Flown(cycles, final, ended)


def target_of(correction: Correction) -> Array:
    """One target is moved by 20 km; of the others nothing is said."""
    targets = np.full((4, N), np.nan)
    targets[:, MOVED] = correction.target
    targets[2, MOVED] += 20.0 / 6371.0
    return targets


@pytest.fixture(scope="module")
def guidance(tmp_path_factory: pytest.TempPathFactory, correction: Correction) -> Guidance:
    """Corrections are rare, for the sake of the tests' time."""
    rare = replace(correction.corrector, period=40.0, last_minute=30.0, last_period=4.0, step=8.0)
    loaded = load_guidance(small_database(tmp_path_factory)).at_cycle(CYCLE)
    return loaded.corrected(replace(correction, corrector=rare))


@pytest.fixture(scope="module")
def flight(guidance: Guidance, correction: Correction) -> Flown:
    """By the engine that is there, in C if it can be."""
    mission = small_mission()
    guidance.begin(np.repeat(mission.nominal_parameters[None], N, axis=0))
    entry = np.repeat(mission.entry_state[:, None], N, axis=1)
    entry = np.concatenate([entry, guidance.flown.first[[BANK]]])
    return flown(guidance, correction, entry)


@pytest.fixture(scope="module")
def repeated(guidance: Guidance, correction: Correction, flight: Flown) -> list[Cycle]:
    """The same told to the corrector in numpy."""
    own = guidance.on_engine(NUMPY)
    own.begin(np.repeat(small_mission().nominal_parameters[None], N, axis=0))
    found = []
    for cycle in flight.cycles:
        if cycle.time == MOVED_AT:
            own.aim(target_of(correction))
        command = own.step(cycle.time, cycle.navigation, cycle.sensed)
        found.append(replace(cycle, command=command, known=own.correction_state))
    return found


def counted(flight: Flown, outcome: CorrectionOutcome) -> Array:
    return np.asarray(flight.cycles[-1].known.counts[outcome])


def assert_alike(one: Any, other: Any, name: str, time: float) -> None:
    """Whole numbers are equal, others to 1e-9 of a unit, or of themselves."""
    tolerance = 0.0 if np.issubdtype(np.asarray(one).dtype, np.integer) else AGREED
    np.testing.assert_allclose(
        one, other, rtol=tolerance, atol=tolerance, err_msg=f"{name} at {time} s"
    )


@needs_c
def test_numpy_and_c_have_the_same_plans_outcomes_and_commands(
    guidance: Guidance, flight: Flown, repeated: list[Cycle]
) -> None:
    assert guidance.engine == NATIVE
    for in_c, own in zip(flight.cycles, repeated, strict=True):
        for name, value in vars(in_c.command).items():
            assert_alike(getattr(own.command, name), value, name, own.time)
        for name in ("outcome", "counts", "missed", "to_go", "iterations", "propagations"):
            assert_alike(getattr(own.known, name), getattr(in_c.known, name), name, own.time)
        for name in ("fast", "slow", "values"):
            one, other = (getattr(cycle.known.plans, name) for cycle in (own, in_c))
            assert_alike(one, other, f"plans: {name}", own.time)
        for name in ("mean", "covariance", "altitude"):
            one, other = (getattr(cycle.known.estimate, name) for cycle in (own, in_c))
            assert_alike(one, other, f"estimate: {name}", own.time)
        for name, count in in_c.known.learnt.items():
            assert_alike(own.known.learnt[name], count, name, own.time)


def test_flights_land_on_targets_in_reach_whatever_goes_wrong_on_the_way(
    correction: Correction, flight: Flown
) -> None:
    targets = np.repeat(np.array(correction.target)[:, None], N, axis=1)
    moved = target_of(correction)
    targets = np.where(np.isnan(moved), targets, moved)
    radius, end = correction.model.equatorial_radius, flight.final
    east = radius * np.cos(targets[2]) * (end[LONGITUDE] - targets[1])
    miss = np.hypot(east, radius * (end[LATITUDE] - targets[2]))
    assert (miss[:4] < 500.0).all()
    assert (np.abs(end[ALTITUDE] - targets[0])[:4] < 500.0).all()


def test_what_is_out_of_reach_is_told_and_flown_to_the_end(flight: Flown) -> None:
    last = flight.cycles[-1].known
    assert counted(flight, CorrectionOutcome.OUT_OF_REACH)[4] > 0
    assert np.isfinite(flight.time).all()
    assert np.hypot(*last.missed[:2, 4]) > 200.0


def test_the_law_tracks_until_a_plan_is_laid_and_the_plan_is_flown_to_the_end(
    correction: Correction, flight: Flown
) -> None:
    for cycle in flight.cycles:
        steering = set(cycle.command.steering.tolist())
        begun = cycle.time >= correction.corrector.start
        assert steering == {int(Steering.PLANNED if begun else Steering.TRACKED)}


def test_without_navigation_no_plan_is_changed_and_the_last_one_is_flown_on(flight: Flown) -> None:
    lost = [cycle for cycle in flight.cycles if LOST_FROM <= cycle.time < LOST_UNTIL]
    before = next(c for c in reversed(flight.cycles) if c.time < LOST_FROM)
    assert counted(flight, CorrectionOutcome.NO_STATE).tolist() == [0, 8, 0, 0, 0]
    for cycle in lost:
        values = cycle.known.plans.values[:, LOST]
        np.testing.assert_array_equal(values, before.known.plans.values[:, LOST])
        assert cycle.command.health[LOST] == Health.BAD_NAVIGATION
        assert cycle.known.outcome[LOST] == CorrectionOutcome.NO_STATE
    # dead reckoned: the commands go on as before
    rates = np.array([cycle.command.bank_rate[LOST] for cycle in lost])
    assert np.abs(np.diff(rates)).max() < 0.02


def test_what_is_not_sensed_is_counted_and_the_estimate_stands(flight: Flown) -> None:
    last = flight.cycles[-1].known
    unusable = last.learnt["unusable"]
    assert unusable[SLEEPING] == (LOST_UNTIL - LOST_FROM) / CYCLE == unusable[LOST]
    assert not unusable[[0, 3, 4]].any()


def test_a_target_that_moves_is_corrected_for_at_once(flight: Flown) -> None:
    before, after = (
        next(c for c in flight.cycles if c.time == time).known.plans.values
        for time in (MOVED_AT - CYCLE, MOVED_AT)
    )
    changed = np.abs(after - before).max(axis=0) > 1e-3
    assert changed.tolist() == [False, False, False, True, False]


@pytest.mark.parametrize("engine", [NUMPY, pytest.param(NATIVE, marks=needs_c)])
def test_a_flight_begun_anew_remembers_its_target_alone(
    guidance: Guidance, correction: Correction, flight: Flown, engine: str
) -> None:
    own = guidance.on_engine(engine)
    own.begin(np.repeat(small_mission().nominal_parameters[None], N, axis=0))
    begun = [cycle for cycle in flight.cycles if cycle.time <= correction.corrector.start]
    for cycle in begun:
        own.step(cycle.time, cycle.navigation, cycle.sensed)
    own.aim(target_of(correction))
    own.reset()
    again = own.correction_state
    assert not again.counts.any() and not again.estimate.mean.any() and not again.plans.values.any()
    for cycle in begun:
        own.step(cycle.time, cycle.navigation, cycle.sensed)
    beside = np.abs(own.correction_state.plans.values - begun[-1].known.plans.values).max(axis=0)
    assert (beside < 1e-9).tolist() == [True, True, True, False, True]


def test_a_target_among_the_parameters_is_the_one_that_is_flown_to(
    guidance: Guidance, correction: Correction
) -> None:
    elsewhere = replace(correction, target_axes=(NO_AXIS, NO_AXIS, NO_AXIS, 0))
    own = guidance.on_engine(NUMPY).corrected(elsewhere)
    parameters = np.repeat(small_mission().nominal_parameters[None], 3, axis=0)
    parameters[1:, 0] = 700.0, np.nan
    own.begin(parameters)
    cycle = own._cycle
    assert isinstance(cycle, GuidanceCycle) and cycle.corrected is not None
    nominal = correction.target[3]
    expected = [small_mission().nominal_parameters[0], 700.0, nominal]
    assert cycle.corrected.target[3].tolist() == expected


def test_what_does_not_correct_says_so(guidance: Guidance) -> None:
    message = "^aim: expected a guidance that corrects its plan, got one that tracks its reference"
    with pytest.raises(ValueError, match=message):
        guidance.corrected(None).aim(np.zeros(4))
