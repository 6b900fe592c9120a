"""Campaigns: the same numbers on any number of workers, and nothing dropped."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import Any

import numpy as np
import pytest

from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.physics.path_constraints import path_constraints
from ampi.simulation.closed_loop import FlightStatus
from ampi.simulation.dispersions import Dispersions, Distribution
from ampi.simulation.flights import Flights
from ampi.simulation.monte_carlo import BATCH, fly, fly_modes
from ampi.simulation.statistics import judge
from tests.support.flights import assert_identical

pytestmark = pytest.mark.slow

N = 230


@pytest.fixture(scope="module")
def campaign(mission: Mission, guidance: Guidance) -> Flights:
    """230 flights on one process."""
    return fly(mission, guidance, n=N, seed=5, n_jobs=1)


# --- laws -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("n_jobs", [2, 3])
def test_the_numbers_do_not_depend_on_the_workers(
    mission: Mission, guidance: Guidance, campaign: Flights, n_jobs: int
) -> None:
    """And the progress counts every flight once."""
    assert N > 2 * BATCH
    seen: list[int] = []
    flights = fly(mission, guidance, n=N, seed=5, n_jobs=n_jobs, advance=seen.append)
    assert_identical(flights, campaign)
    assert seen == [BATCH, BATCH, N - 2 * BATCH]


def test_more_flights_leave_the_first_ones_as_they_are(
    mission: Mission, guidance: Guidance, campaign: Flights
) -> None:
    few = fly(mission, guidance, n=30, seed=5, n_jobs=1)
    assert np.array_equal(few.parameters, campaign.parameters[:30])
    assert np.array_equal(few.status, campaign.status[:30])
    assert few.final_states == pytest.approx(campaign.final_states[:30], rel=1e-9)


def test_what_is_derived_follows_from_what_is_recorded(
    mission: Mission, guidance: Guidance, campaign: Flights
) -> None:
    final, target = campaign.final_states, mission.target
    radius = mission.flight_model.planet.equatorial_radius

    def unit(longitude: np.ndarray, latitude: np.ndarray) -> np.ndarray:
        return np.stack(
            [
                np.cos(latitude) * np.cos(longitude),
                np.cos(latitude) * np.sin(longitude),
                np.sin(latitude),
            ]
        )

    here = unit(final[:, 1], final[:, 2])
    there = unit(np.array([target.longitude]), np.array([target.latitude]))
    chord = np.linalg.norm(here - there, axis=0)
    assert campaign.miss == pytest.approx(2.0 * radius * np.arcsin(0.5 * chord), rel=1e-7)
    # the frame of the ground track is a rotation of the miss, however far
    assert np.hypot(campaign.along, campaign.across) == pytest.approx(campaign.miss, rel=1e-9)
    assert np.array_equal(campaign.altitude_error, final[:, 0] - target.altitude)
    assert np.array_equal(campaign.speed_error, final[:, 3] - target.speed)
    k = 7
    state = campaign.states[:, :, k].T
    q, heat, load = path_constraints(mission.flight_model, state, campaign.times[k])
    limits = mission.limits
    for i, over in enumerate(
        (q / limits.dynamic_pressure, heat / limits.heat_flux, load / limits.load_factor)
    ):
        assert campaign.path[:, i, k] == pytest.approx(over, rel=1e-12)
    assert campaign.n == N
    assert (campaign.mode, campaign.seed, campaign.distribution) == (Mode.AMPI, 5, "normal")
    assert campaign.mission == "shefex3"


def of_another(mission: Mission, guidance: Guidance) -> Guidance:
    """The same table as if it were of that mission: it flies to its own target all the same."""
    table = copy(guidance)
    table.mission_sha256 = mission.digest
    return table


@pytest.mark.parametrize(("along", "across"), [(8e3, 0.0), (-8e3, 0.0), (0.0, 8e3), (3e3, -6e3)])
def test_along_points_down_range_and_across_to_the_right(
    mission: Mission, guidance: Guidance, along: float, across: float
) -> None:
    """The same flights judged against a target moved by −(along, across) in the track's frame."""
    azimuth = float(guidance.reference(mission.nominal_parameters).states[5, -1])
    ahead = np.array([np.cos(azimuth), np.sin(azimuth)])  # north, east
    right = np.array([-np.sin(azimuth), np.cos(azimuth)])
    target, radius = mission.target, mission.flight_model.planet.equatorial_radius
    north, east = -(along * ahead + across * right) / radius
    moved = target.model_copy(
        update={
            "latitude": target.latitude + north,
            "longitude": target.longitude + east / np.cos(target.latitude),
        }
    )
    other = mission.model_copy(update={"target": moved})
    flights = fly(other, of_another(other, guidance), n=5, n_jobs=1, record_every=1e3)
    assert np.abs(flights.along - along).max() < 300.0
    assert np.abs(flights.across - across).max() < 300.0


def test_a_campaign_does_not_depend_on_the_turn_of_its_target(
    mission: Mission, guidance: Guidance
) -> None:
    target = mission.target.model_copy(update={"longitude": mission.target.longitude + 2.0 * np.pi})
    other = mission.model_copy(update={"target": target})
    here, there = (
        fly(m, of_another(m, guidance), n=5, n_jobs=1, record_every=1e3) for m in (mission, other)
    )
    for name in ("miss", "along", "across"):
        assert getattr(there, name) == pytest.approx(getattr(here, name), abs=1e-6)


def test_modes_fly_the_same_draws(mission: Mission, guidance: Guidance) -> None:
    flown = {
        mode: fly(mission, guidance.in_mode(mode), n=12, seed=8, n_jobs=1, record_every=60.0)
        for mode in Mode
    }
    for mode, flights in flown.items():
        assert flights.mode is mode
        assert np.array_equal(flights.parameters, flown[Mode.AMPI].parameters)
    assert len({f.miss.tobytes() for f in flown.values()}) == len(Mode)
    assert not flown[Mode.NOMINAL].clipped.any()
    for modes in ("mpi", [Mode.MPI], ["mpi", "mpi"]):
        named = fly_modes(mission, guidance, modes, n=2, seed=8, n_jobs=1, record_every=60.0)
        assert list(named) == [Mode.MPI]
        assert named[Mode.MPI].miss == pytest.approx(flown[Mode.MPI].miss[:2], rel=1e-6)
    with pytest.raises(
        ValueError, match="mode: expected one of nominal, mpi, ampi, quadratic, got"
    ):
        fly_modes(mission, guidance, ["best"], n=2)


def test_flights_are_flown_at_the_cycle_that_is_asked_for(
    mission: Mission, guidance: Guidance
) -> None:
    every = fly(mission, guidance, n=3, n_jobs=1, cycle=2.0, record_every=0.1)
    assert every.cycle == 2.0
    assert np.all(np.diff(every.times) == 2.0)  # the record follows the cycle
    slopes = np.diff(every.bank_rate, axis=1) / 2.0
    limit = mission.limits.bank_acceleration
    assert np.nanmax(np.abs(slopes)) <= limit * (1 + 1e-9)
    assert every.reached.all()
    assert guidance.cycle == 0.5
    assert not np.array_equal(every.miss, fly(mission, guidance, n=3, n_jobs=1).miss)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n": 0}, "n: expected at least one flight, a whole number; got 0"),
        ({"n": 1.5}, r"n: expected at least one flight, a whole number; got 1\.5"),
        ({"n": True}, "n: expected at least one flight, a whole number; got True"),
        ({"seed": -1}, "seed: expected a whole number, 0 or greater, got -1"),
        ({"seed": 1.5}, r"seed: expected a whole number, 0 or greater, got 1\.5"),
        ({"n_jobs": 0}, "n_jobs: expected at least 1 worker process, got 0"),
        ({"cycle": 0.0}, "cycle: expected"),
        ({"record_every": -5}, "record_every: expected a positive number of seconds, got -5"),
        ({"record_every": float("nan")}, "record_every: expected a positive number .* got nan"),
        ({"record_every": "often"}, "record_every: expected a positive number .* got 'often'"),
        ({"mission": "shefex3"}, "mission: expected a mission, from ampi.load_mission.*'shefex3'"),
        ({"guidance": "small.h5"}, "guidance: expected guidance, from ampi.load_guidance.*small"),
        ({"dispersions": "normal"}, "dispersions: expected ampi.Dispersions, or None .*'normal'"),
        ({"dispersions": Dispersions((1.0,) * 3)}, "expected 2 numbers for speed, .*, got 3"),
    ],
)
def test_misuse_is_one_sentence_before_anything_flies(
    mission: Mission, guidance: Guidance, options: dict[str, Any], message: str
) -> None:
    flown: list[int] = []
    arguments = {"mission": mission, "guidance": guidance, "n": 3, "n_jobs": 1, **options}
    with pytest.raises(ValueError, match=message) as told:
        fly(**arguments, advance=flown.append)
    assert not flown
    assert "\n" not in str(told.value)


# --- flights that fail ----------------------------------------------------------------------------


def test_absurd_dispersions_are_recorded_not_dropped(mission: Mission, guidance: Guidance) -> None:
    """Every flight has a status; those that did not arrive are in no circle."""
    absurd = Dispersions((4000.0, 0.6), Distribution.UNIFORM)
    flights = fly(mission, guidance, absurd, n=120, seed=3, n_jobs=2)
    assert flights.n == len(flights.status) == 120
    assert flights.distribution == "uniform"
    assert set(flights.status.tolist()) <= {int(s) for s in FlightStatus}
    failed = ~flights.reached
    assert 0 < failed.sum() < 120
    assert np.all(flights.speed_error[flights.status == int(FlightStatus.TIME_LIMIT)] > 0.0)
    assert flights.speed_error[flights.reached] == pytest.approx(0.0, abs=0.05)
    verdict = judge(flights)
    assert sum(ring.count for ring in verdict.rings) == 120
    assert verdict.rings[-1].count >= failed.sum()
    assert verdict.reached.count == flights.reached.sum()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"miss": np.zeros(4)}, r"flights.parameters: expected an array of shape \(4, 6\)"),
        ({"status": np.full(5, 0.5)}, "flights.status: expected .* kind 'i', got"),
        ({"status": np.full(5, 9)}, "flights.status: expected members of FlightStatus"),
        ({"miss": np.full(5, np.nan)}, "flights.miss: expected finite numbers of every flight"),
        ({"peak": np.ones((5, 2))}, r"flights.peak: expected an array of shape \(5, 5\)"),
        ({"times": np.zeros(4)}, "expected times, and radii above 0, that increase strictly"),
        ({"altitude_tolerance": np.nan}, "expected positive tolerances"),
    ],
)
def test_flights_that_disagree_with_themselves_are_refused(
    make_flights: Callable[..., Flights], changes: dict[str, object], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        make_flights(5, **changes)
