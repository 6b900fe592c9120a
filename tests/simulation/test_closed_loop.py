"""The closed loop's own integrator against DOP853, and the records of flights that end otherwise."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ampi.dataset import TrajectoryDataset
from ampi.guidance import Guidance
from ampi.loading import guidance_table
from ampi.missions.family import MissionFamily
from ampi.missions.flight_sections import EntrySection
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.onboard.reference import Mode
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.state import ENTRY_STATES
from ampi.simulation.closed_loop import FlightBatch, fly_batch
from ampi.simulation.plant import PLANT, FlightStatus, PlantSettings
from ampi.tracking.bank_limiter import BankLimits
from ampi.trajectory import Status
from tests.support.truths import nominal_truth
from tests.support.worlds import of_entries

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]
BANK = ("angle", "rate", "acceleration")
MEASURED = [3, 4]  # the grid disperses speed and flight-path angle alone


def from_entries(mission: Mission, entries: Array) -> MissionFamily:
    """The mission from each of `entries` (n, 6), whether or not the grid disperses them."""
    sections = (
        EntrySection.model_construct(**dict(zip(ENTRY_STATES, row, strict=True)))
        for row in np.atleast_2d(entries).tolist()
    )
    return MissionFamily.of([mission.model_copy(update={"entry": s}) for s in sections])


def fly(mission: Mission, guidance: Guidance, entries: Array, every: float = 5.0) -> FlightBatch:
    truth = nominal_truth(entries[:, MEASURED])
    return fly_batch(from_entries(mission, entries), guidance, truth, every)


@pytest.fixture(scope="module")
def entries(mission: Mission) -> Array:
    """Corners, inside and outside of the small grid; the last four off in every entry state."""
    entries = np.tile(mission.entry_state, (13, 1))
    entries[1:5, MEASURED] = of_entries("corners").draw(mission, 4, 1).parameters
    entries[5:9, MEASURED] = of_entries("uniform").draw(mission, 4, 2).parameters
    sizes = np.array([250.0, 8e-3, 8e-3, 70.0, 8e-3, 8e-3])
    entries[9:] += 1.1 * sizes * np.random.default_rng(3).choice([-1.0, 1.0], (4, 6))
    return entries


@pytest.fixture(scope="module")
def batch(mission: Mission, guidance: Guidance, entries: Array) -> FlightBatch:
    """Recorded at every cycle."""
    return fly(mission, guidance, entries, guidance.cycle)


# --- laws -----------------------------------------------------------------------------------------


def test_flights_of_a_batch_do_not_see_each_other(
    mission: Mission, guidance: Guidance, entries: Array, batch: FlightBatch
) -> None:
    reverse = fly(mission, guidance, entries[::-1].copy())
    assert np.array_equal(reverse.final_states[::-1], batch.final_states)
    alone = fly(mission, guidance, entries[5:6])
    assert np.array_equal(alone.final_states[0], batch.final_states[5])
    assert alone.final_time[0] == batch.final_time[5]


def test_every_flight_keeps_the_limits_of_its_actuator(
    mission: Mission, guidance: Guidance, batch: FlightBatch
) -> None:
    limits = guidance.limits
    rates = batch.bank_rate
    assert np.nanmax(np.abs(rates)) <= limits.rate * (1 + 1e-12)
    assert np.nanmax(np.abs(np.diff(rates, axis=1))) <= limits.acceleration * 0.5 * (1 + 1e-9)
    assert np.nanmax(np.abs(batch.states[:, 6])) <= limits.angle * (1 + 1e-12)


def test_the_bank_angle_is_the_integral_of_the_bank_rate(batch: FlightBatch) -> None:
    rates, banks = batch.bank_rate, batch.states[:, 6]
    change = 0.25 * (rates[:, 1:] + rates[:, :-1])
    assert np.nanmax(np.abs(np.diff(banks, axis=1) - change)) < 1e-12


def test_flights_end_at_the_target_speed_at_the_time_they_say(
    mission: Mission, batch: FlightBatch
) -> None:
    assert batch.status.tolist() == [int(FlightStatus.REACHED_SPEED)] * len(batch.status)
    assert batch.final_states[:, 3] == pytest.approx(
        np.full(len(batch.status), mission.target.speed), abs=1e-4
    )
    recorded = np.isfinite(batch.states[:, 3])
    last = recorded.sum(axis=1) - 1
    for i, k in enumerate(last):
        assert np.all(recorded[i, : k + 1])
        assert 0.0 < batch.final_time[i] - batch.times[k] <= 0.5 + 1e-6
        assert batch.states[i, 3, k] > mission.target.speed


def test_records_are_thinned_as_asked(
    mission: Mission, guidance: Guidance, entries: Array, batch: FlightBatch
) -> None:
    thin = fly(mission, guidance, entries, 7.0)
    assert np.array_equal(thin.times, batch.times[::14])
    assert np.array_equal(thin.states, batch.states[..., ::14], equal_nan=True)
    assert np.array_equal(thin.bank_rate, batch.bank_rate[:, ::14], equal_nan=True)
    assert np.array_equal(thin.reference_states, batch.reference_states[..., ::14], equal_nan=True)
    assert np.array_equal(thin.final_states, batch.final_states)


def test_peaks_are_read_at_every_cycle_however_thin_the_record(
    mission: Mission, guidance: Guidance, entries: Array, batch: FlightBatch
) -> None:
    states = batch.states.transpose(1, 0, 2)
    limits = PathLimits.of(mission)
    used = limits.use(mission.flight_model, states, batch.bank_rate, batch.times)
    expected = np.stack([np.nanmax(use, axis=1) for use in used], axis=1)
    assert batch.peak == pytest.approx(expected, rel=1e-12)
    thin = fly(mission, guidance, entries, 100.0)
    assert np.array_equal(thin.peak, batch.peak)


def test_a_flight_over_a_hole_says_so(mission: Mission, dataset: TrajectoryDataset) -> None:
    """One corner of the grid has no solution; a flight in its cell, and one in the cell across."""
    status = dataset.status.copy()
    status[0, 0] = int(Status.ERROR)
    table = guidance_table(replace(dataset, status=status), holes="fly")
    limits = BankLimits(*(getattr(mission.limits, f"bank_{n}") for n in BANK))
    nominal = mission.nominal_parameters
    corner = np.array([axis[0] for axis in dataset.axes])
    entries = np.tile(mission.entry_state, (2, 1))
    entries[:, MEASURED] = nominal + 0.1 * (corner - nominal) * [[1.0], [-1.0]]
    batch = fly(mission, Guidance(table, limits), entries)
    assert batch.hole.tolist() == [True, False]
    assert batch.clipped.tolist() == [False, False]


def test_clipped_tells_the_entries_outside_the_grid(batch: FlightBatch) -> None:
    assert batch.clipped.tolist() == [False] * 9 + [True] * 4


# --- witness --------------------------------------------------------------------------------------


@pytest.mark.parametrize("flight", [0, 3, 7, 11])
def test_rk4_agrees_with_dop853_under_the_flown_bank_rate(
    mission: Mission, batch: FlightBatch, flight: int
) -> None:
    """The rate is linear over a cycle, so the bank angle a known parabola; six states are left."""
    n = int(np.isfinite(batch.bank_rate[flight]).sum())
    times, rates = batch.times[:n], batch.bank_rate[flight, :n]
    banks = batch.states[flight, 6, :n]
    cycle = float(times[1])

    def bank_angle(t: float) -> float:
        k = min(int(t / cycle), n - 2)
        s = t - times[k]
        return float(banks[k] + rates[k] * s + (rates[k + 1] - rates[k]) * s * s / (2.0 * cycle))

    def f(t: float, x: Array) -> Array:
        seven = [*x, bank_angle(t)]
        return np.array(equations_of_motion(mission.flight_model, seven, 0.0, t)[:6], dtype=float)

    x = batch.states[flight, :6, 0]
    kinks = [58.0, 88.0]  # of the angle-of-attack schedule
    for begin, end in pairwise([0.0, *kinks, float(times[-1])]):
        solution = solve_ivp(
            f, (begin, end), x, method="DOP853", rtol=1e-9, atol=1e-9, max_step=1.0
        )
        assert solution.success
        x = solution.y[:, -1]
    radius = mission.flight_model.planet.equatorial_radius
    difference = x - batch.states[flight, :6, n - 1]
    assert abs(difference[0]) < 1.0  # m
    assert radius * np.hypot(difference[1] * np.cos(x[2]), difference[2]) < 1.0  # m
    assert abs(difference[3]) < 0.05  # m/s


# --- flights that end otherwise -------------------------------------------------------------------


def test_a_dive_ends_at_the_ground(mission: Mission, guidance: Guidance) -> None:
    """Ten thousand times as heavy, the air does not slow it down before the ground does."""
    heavy = parse_mission(mission.toml.replace("mass_kg = 500.0", "mass_kg = 5e6"))
    entry = mission.entry_state.copy()
    entry[4] = np.radians(-80.0)
    batch = fly(heavy, guidance, np.vstack([entry, entry]))
    assert batch.status.tolist() == [int(FlightStatus.GROUND)] * 2
    assert batch.final_states[:, 0] == pytest.approx(0.0, abs=1e-3)
    assert batch.final_states[0, 3] > 4000.0
    assert batch.final_time[0] == pytest.approx(
        100.1e3 / (4712.0 * np.sin(np.radians(80))), rel=0.05
    )
    assert batch.clipped.tolist() == [True, True]


def test_a_vehicle_that_leaves_the_planet_meets_the_time_limit(
    mission: Mission, guidance: Guidance
) -> None:
    entry = mission.entry_state.copy()
    entry[[3, 4]] = 11.5e3, np.radians(30.0)
    batch = fly(mission, guidance, np.vstack([mission.entry_state, entry]))
    assert batch.status.tolist() == [int(FlightStatus.REACHED_SPEED), int(FlightStatus.TIME_LIMIT)]
    longest = PLANT.longest * guidance.reference(entry[MEASURED]).final_time
    assert batch.final_time[1] == longest  # of its own reference, whoever flies beside it
    assert np.all(np.isfinite(batch.final_states[1]))
    assert np.all(np.isfinite(batch.states[1]))
    alone = fly(mission, guidance, entry[None])
    assert alone.final_time[0] == longest
    assert alone.final_states[0] == pytest.approx(batch.final_states[1], rel=1e-10)


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode is not Mode.HERMITE])
def test_an_entry_that_is_not_a_number_is_a_record(
    mission: Mission, guidance: Guidance, mode: Mode
) -> None:
    entry = mission.entry_state.copy()
    entry[3] = np.nan
    batch = fly(mission, guidance.in_mode(mode), np.vstack([entry, mission.entry_state]))
    assert batch.status.tolist() == [int(FlightStatus.NOT_FINITE), int(FlightStatus.REACHED_SPEED)]
    assert np.all(np.isnan(batch.final_states[0]))


@pytest.mark.parametrize(
    ("h", "v", "angle"),
    [
        (5e3, 9e3, -80.0),
        (100.0, 5e3, -85.0),
        (100.1e3, 500.0, -10.3),
        (3e4, 0.0, 0.0),
        (2.0, 600.0, -60.0),
        (200.0, 600.0, -60.0),
    ],
)
def test_reached_speed_means_it(
    mission: Mission, guidance: Guidance, h: float, v: float, angle: float
) -> None:
    entry = mission.entry_state.copy()
    entry[[0, 3, 4]] = h, v, np.radians(angle)
    batch = fly(mission, guidance, entry[None])
    if batch.status[0] == int(FlightStatus.REACHED_SPEED):
        assert batch.final_states[0, 3] == pytest.approx(mission.target.speed, abs=1e-4)
        assert batch.final_states[0, 0] >= 0.0
    elif batch.status[0] == int(FlightStatus.GROUND):
        assert batch.final_states[0, 3] > mission.target.speed
        assert batch.final_states[0, 0] == pytest.approx(0.0, abs=1e-3)
    else:
        assert batch.status[0] == int(FlightStatus.STARTED_SLOW)


def test_what_comes_first_in_a_step_ends_the_flight(mission: Mission, guidance: Guidance) -> None:
    """From 2 m it meets the ground before its speed, from 200 m its speed before the ground."""
    entries = np.tile(mission.entry_state, (2, 1))
    entries[:, 0], entries[:, 3], entries[:, 4] = (2.0, 200.0), 600.0, np.radians(-60.0)
    batch = fly(mission, guidance, entries)
    assert np.all(batch.final_time < 0.5)
    assert batch.status.tolist() == [int(FlightStatus.GROUND), int(FlightStatus.REACHED_SPEED)]


def test_the_command_is_zero_once_the_reference_has_ended(
    mission: Mission, guidance: Guidance
) -> None:
    """A flight to a lower speed than the table's outlasts its reference."""
    slower = mission.target.model_copy(update={"speed": 300.0})
    lasting = mission.model_copy(update={"target": slower})
    batch = fly(lasting, guidance, mission.entry_state[None], guidance.cycle)
    ended = guidance.reference(mission.entry_state[MEASURED]).final_time
    limits = guidance.limits
    stopped = ended + limits.rate / limits.acceleration + guidance.cycle
    assert batch.final_time[0] > stopped + 5.0
    after = batch.bank_rate[0, batch.times > stopped]
    assert np.all(after[np.isfinite(after)] == 0.0)
    before = batch.bank_rate[0, (batch.times > ended - 5.0) & (batch.times < ended)]
    assert np.all(before != 0.0)


def test_a_flight_that_has_ended_reads_no_peaks_from_those_that_go_on(
    mission: Mission, guidance: Guidance
) -> None:
    """The angle of attack grows at 58 s, and with it the load factor, but not of who has landed."""
    angles = mission.vehicle.angle_of_attack
    rising = {"start_angle": angles.end_angle, "end_angle": angles.start_angle}
    schedule = angles.model_copy(update=rising)
    vehicle = mission.vehicle.model_copy(update={"angle_of_attack": schedule, "mass": 5e6})
    other = mission.model_copy(update={"vehicle": vehicle})
    entries = np.tile(mission.entry_state, (2, 1))
    entries[0, 4] = np.radians(-80.0)
    both, alone = fly(other, guidance, entries), fly(other, guidance, entries[:1])
    assert both.status[0] == alone.status[0] == int(FlightStatus.GROUND)
    assert both.final_time[0] < angles.start < both.final_time[1]
    assert both.peak[0] == pytest.approx(alone.peak[0], rel=1e-9)


def test_peaks_hold_the_end_of_the_flight(mission: Mission, guidance: Guidance) -> None:
    """A dive is at its greatest pressure where it meets the ground, between two cycles."""
    heavy = parse_mission(mission.toml.replace("mass_kg = 500.0", "mass_kg = 5e6"))
    entry = mission.entry_state.copy()
    entry[4] = np.radians(-80.0)
    batch = fly(heavy, guidance, entry[None])
    end, limits = (batch.final_states[0], float(batch.final_time[0])), PathLimits.of(heavy)
    met = limits.path(heavy.flight_model, *end)
    assert batch.peak[0, : len(met)] == pytest.approx(met, rel=1e-12)


def test_a_flight_of_which_nothing_is_known_has_no_peak(
    mission: Mission, guidance: Guidance
) -> None:
    entries = np.tile(mission.entry_state, (2, 1))
    entries[0, 1] = np.nan
    batch = fly(mission, guidance, entries)
    assert np.all(np.isnan(batch.peak[0]))
    assert np.all(np.isfinite(batch.peak[1]))


@pytest.mark.parametrize("cycle", [0.1, 3.0])
def test_the_plant_does_not_depend_on_the_guidance_cycle(
    mission: Mission, guidance: Guidance, monkeypatch: pytest.MonkeyPatch, cycle: float
) -> None:
    """Its step stays small where the cycle is long: peaks are those of a step ten times as fine."""
    other = Guidance(guidance.table, guidance.limits, guidance.mode, cycle=cycle)
    entry = mission.entry_state[None]
    coarse = fly(mission, other, entry)
    monkeypatch.setattr("ampi.simulation.closed_loop.PLANT", PlantSettings(step=0.05))
    fine = fly(mission, other, entry)
    assert coarse.peak == pytest.approx(fine.peak, rel=5e-4)
    assert coarse.final_states == pytest.approx(fine.final_states, rel=1e-6)
    assert coarse.status[0] == int(FlightStatus.REACHED_SPEED)


def test_a_status_prints_its_name() -> None:
    assert f"{FlightStatus.GROUND} {FlightStatus.GROUND!s}" == "GROUND GROUND"


def test_an_absurd_entry_is_a_record_and_keeps_no_limit(
    mission: Mission, guidance: Guidance
) -> None:
    entries = np.stack([mission.entry_state, mission.entry_state])
    entries[0, 0] = np.inf
    batch = fly(mission, guidance, entries)
    assert batch.status[0] == int(FlightStatus.NOT_FINITE)
    assert np.all(np.isnan(batch.peak[0]))
    assert batch.status[1] == int(FlightStatus.REACHED_SPEED)
