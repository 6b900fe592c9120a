"""A loop of one's own with `Guidance.step` against the simulator: the same flight, the same bits."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from ampi.guidance import Guidance
from ampi.missions.family import MissionFamily
from ampi.missions.flight_sections import EntrySection
from ampi.missions.mission import Mission
from ampi.onboard.command import Command
from ampi.onboard.health import Health
from ampi.onboard.reference import Mode
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.state import ENTRY_STATES
from ampi.simulation.closed_loop import FlightBatch, fly_batch
from ampi.simulation.plant import FlightStatus
from ampi.simulation.truth import Truth
from tests.support.truths import nominal_truth

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]
MODES = [mode for mode in Mode if mode is not Mode.HERMITE]  # no sensitivities in these tables
MEASURED = [3, 4]  # the grid disperses speed and flight-path angle alone
ENTRIES = {  # offsets from the nominal entry state
    "inside": [0.0, 0.0, 0.0, 23.0, 0.003, 0.0],
    "on the boundary": [0.0, 0.0, 0.0, 70.0, -0.5 * np.pi / 180.0, 0.0],
    "outside": [180.0, 2e-3, -1e-3, -90.0, 0.004, -3e-3],
}


def from_entries(mission: Mission, entries: Array) -> MissionFamily:
    """The mission from each of `entries` (n, 6), whether or not the grid disperses them."""
    sections = (
        EntrySection.model_construct(**dict(zip(ENTRY_STATES, row, strict=True)))
        for row in np.atleast_2d(entries).tolist()
    )
    return MissionFamily.of([mission.model_copy(update={"entry": s}) for s in sections])


def step(mission: Mission, x: Array, rates: tuple[float, float], time: float, h: float) -> Array:
    """One classical Runge-Kutta step under a bank rate linear in time."""

    def f(at: float, y: Array) -> Array:
        bank_rate = rates[0] + (rates[1] - rates[0]) * (at - time) / h
        return np.array(equations_of_motion(mission.flight_model, y, bank_rate, at), dtype=float)

    stages = [f(time, x)]
    for c in (0.5, 0.5, 1.0):
        stages.append(f(time + c * h, x + c * h * stages[-1]))
    return x + h * np.array([1.0, 2.0, 2.0, 1.0]) @ np.array(stages) / 6.0


def flown(
    mission: Mission, guidance: Guidance, entry: Array
) -> tuple[Array, list[Array], list[Command]]:
    """Final state, states at the cycle begins, and the commands."""
    guidance.begin(entry[MEASURED])
    bank, rate = guidance.flown.first[6:8, 0].tolist()
    x, time = np.array([*entry, bank]), 0.0
    states, commands = [], []
    while True:
        command = guidance.step(time, [*x, rate])
        states.append(x)
        commands.append(command)
        ahead = step(mission, x, (rate, command.bank_rate), time, guidance.cycle)
        if ahead[3] <= mission.target.speed:
            break
        x, rate, time = ahead, command.bank_rate, time + guidance.cycle

    def part(h: float) -> Array:
        here = rate + (command.bank_rate - rate) * h / guidance.cycle
        return step(mission, x, (rate, here), time, h)

    h = brentq(lambda s: part(s)[3] - mission.target.speed, 1e-9, guidance.cycle, xtol=1e-13)
    return part(h), states, commands


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("entry", list(ENTRIES))
def test_one_flight_by_commands_is_the_flight_of_the_batch(
    mission: Mission, loaded: Guidance, entry: str, mode: Mode
) -> None:
    guidance = loaded.in_mode(mode)
    state = mission.entry_state + np.array(ENTRIES[entry])
    final, states, commands = flown(mission, guidance, state)
    family = from_entries(mission, state)
    batch = fly_batch(
        family, guidance, nominal_truth(state[None, MEASURED]), record_every=guidance.cycle
    )
    assert batch.status.tolist() == [int(FlightStatus.REACHED_SPEED)]
    scale = np.array([1e5, 1.0, 1.0, 5e3, 1.0, 1.0, 1.0])
    assert batch.states.shape == (1, 7, len(states))
    difference = np.abs(batch.states[0] - np.array(states).T) / scale[:, None]
    assert difference.max() < 1e-9
    given = np.array([c.bank_rate for c in commands])
    assert np.abs(batch.bank_rate[0, 1:] - given[:-1]).max() < 1e-9
    assert np.abs(batch.final_states[0] - final).max() < 1e-3
    assert (np.abs(batch.final_states[0] - final) / scale).max() < 1e-8
    # the entry interface differs from the grid's own in one entry alone, and nominal never clips
    outside = entry == "outside" and mode is not Mode.NOMINAL
    assert bool(batch.clipped[0]) is outside
    told = {c.health for c in commands} - {Health.AFTER_FINAL_TIME}
    assert told == {Health.BOUNDARY_REFERENCE if outside else Health.GOOD}


def test_the_commands_of_a_flight_keep_the_limits(mission: Mission, loaded: Guidance) -> None:
    limits = mission.limits
    entry = mission.entry_state + np.array(ENTRIES["outside"])
    _, states, commands = flown(mission, loaded, entry)
    rates = np.array([c.bank_rate for c in commands])
    assert np.abs(rates).max() <= limits.bank_rate * (1 + 1e-12)
    assert np.abs(np.diff(rates)).max() <= limits.bank_acceleration * 0.5 * (1 + 1e-9)
    assert max(abs(x[6]) for x in states) <= limits.bank_angle * (1 + 1e-12)
    # a command says where the bank angle will be, and there it is
    promised = np.array([c.bank_angle for c in commands[:-1]])
    assert promised == pytest.approx(np.array([x[6] for x in states[1:]]), abs=1e-12)


# --- to the bit -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def company(mission: Mission) -> tuple[MissionFamily, Truth]:
    """Flights inside and outside of the grid, with noise, dropouts, a lag and a wind."""
    n = 9
    entries = np.repeat([mission.entry_state + np.array(e) for e in ENTRIES.values()], 3, axis=0)
    sizes = np.random.default_rng(5).uniform(0.0, 1.0, (5, n))
    truth = nominal_truth(
        entries[:, MEASURED],
        wind=np.full((2, n, 131), 20.0) * np.linspace(-1.0, 1.0, n)[:, None],
        navigation_altitude_noise=100.0 * sizes[0],
        navigation_azimuth_noise=2e-3 * sizes[1],
        navigation_bank_angle_noise=0.02 * sizes[2],
        navigation_dropout=0.3 * sizes[3],
        actuator_lag=0.5 * sizes[4],
    )
    return from_entries(mission, entries), truth


def recorded(
    family: MissionFamily, guidance: Guidance, truth: Truth, monkeypatch: pytest.MonkeyPatch
) -> tuple[FlightBatch, list[tuple[float, Array, Command]]]:
    """A simulation, and all that its flight software was told and has answered."""
    told: list[tuple[float, Array, Command]] = []
    original = Guidance.step

    def step(self: Guidance, time: float, navigation: Array, sensed: Array | None) -> Command:
        before = navigation.copy()
        command = original(self, time, navigation, sensed)
        assert np.array_equal(navigation, before, equal_nan=True)  # nothing told is written to
        told.append((time, before, command))
        return command

    with monkeypatch.context() as patched:
        patched.setattr(Guidance, "step", step)
        batch = fly_batch(family, guidance, truth)
    return batch, told


@pytest.mark.parametrize("mode", [Mode.AMPI, Mode.QUADRATIC])
def test_step_by_step_a_flight_alone_has_the_bits_of_the_batch(
    mission: Mission,
    loaded: Guidance,
    company: tuple[MissionFamily, Truth],
    mode: Mode,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    family, truth = company
    guidance = loaded.in_mode(mode)
    _, told = recorded(family, guidance, truth, monkeypatch)
    assert len(told) > 1000
    health = np.array([command.health for _, _, command in told])
    assert set(np.unique(health)) >= {Health.GOOD, Health.BOUNDARY_REFERENCE, Health.BAD_NAVIGATION}
    for i in range(len(family)):
        guidance.begin(truth.parameters[i])
        for time, navigation, together in told:
            alone = guidance.step(time, navigation[:, i])
            assert alone.bank_rate == together.bank_rate[i]
            assert alone.bank_angle == together.bank_angle[i]
            assert alone.angle_of_attack == together.angle_of_attack[i]
            assert (alone.steering, alone.health) == (together.steering[i], together.health[i])


def test_a_simulated_flight_has_the_same_bits_alone_in_company_and_in_any_order(
    loaded: Guidance, company: tuple[MissionFamily, Truth]
) -> None:
    family, truth = company
    together = fly_batch(family, loaded, truth)
    order = np.arange(len(family))[::-1]
    reverse = fly_batch(family.take(order), loaded, truth.take(order))
    alone = [fly_batch(family.take([i]), loaded, truth.take([i])) for i in (0, 4, 8)]
    for name in ("final_states", "final_time", "peak", "activity", "saturation", "rebound"):
        expected = getattr(together, name)
        assert np.array_equal(getattr(reverse, name)[::-1], expected, equal_nan=True), name
        for i, batch in zip((0, 4, 8), alone, strict=True):
            assert np.array_equal(getattr(batch, name)[0], expected[i], equal_nan=True), name
    for i, batch in zip((0, 4, 8), alone, strict=True):
        k = batch.states.shape[-1]
        assert np.array_equal(batch.states[0], together.states[i, :, :k], equal_nan=True)


def test_before_the_first_sample_that_comes_late_the_bank_angle_is_the_first(
    mission: Mission, loaded: Guidance, monkeypatch: pytest.MonkeyPatch
) -> None:
    p = mission.nominal_parameters[None]
    truth = nominal_truth(p, navigation_latency=0.7)
    _, told = recorded(mission.family(p), loaded, truth, monkeypatch)
    assert told[0][1][6, 0] == told[1][1][6, 0] == loaded.flown.first[6, 0] != 0.0
