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
from ampi.simulation import monte_carlo
from ampi.simulation.flights import Flights
from ampi.simulation.monte_carlo import Scheme, fly, fly_schemes
from ampi.simulation.plant import FlightStatus
from ampi.simulation.statistics import judge
from tests.support.flights import assert_identical
from tests.support.worlds import world

pytestmark = pytest.mark.slow

N, BATCH = 23, 10
FEW: dict[str, Any] = {"n_jobs": 1, "cycle": 0.5, "record_every": 60.0}
UNIFORM = 'name = "w"\ntitle = "W"\n[entry]\ndistribution = "uniform"\nscale = {}\n'

MODES = [Mode.NOMINAL, Mode.MPI, Mode.AMPI, Mode.QUADRATIC]


@pytest.fixture(scope="module", autouse=True)
def _small_batches() -> Any:
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(monte_carlo, "BATCH", BATCH)
        yield


@pytest.fixture(scope="module")
def campaign(short: Mission, short_guidance: Guidance) -> Flights:
    """23 flights in one process."""
    return fly(short, short_guidance, n=N, seed=5, n_jobs=1, cycle=0.5)


# --- laws -----------------------------------------------------------------------------------------


def test_the_numbers_do_not_depend_on_the_workers(
    short: Mission, short_guidance: Guidance, campaign: Flights
) -> None:
    """And the progress counts every flight once."""
    seen: list[int] = []
    options: dict[str, Any] = {"n_jobs": 3, "cycle": 0.5, "advance": seen.append}
    flights = fly(short, short_guidance, n=N, seed=5, **options)
    assert_identical(flights, campaign)
    assert seen == [BATCH, BATCH, N - 2 * BATCH]


def test_more_flights_leave_the_first_ones_as_they_are(
    short: Mission, short_guidance: Guidance, campaign: Flights
) -> None:
    few = fly(short, short_guidance, n=7, seed=5, n_jobs=1, cycle=0.5)
    for name in ("parameters", "seeds", "status", "final_states", "peak"):
        assert np.array_equal(getattr(few, name), getattr(campaign, name)[:7])


def test_tuning_and_reported_draws_are_others(short: Mission, short_guidance: Guidance) -> None:
    """As are those of another seed: no flight of one is in the other."""
    options: list[dict[str, Any]] = [{}, {"pool": "tuning"}, {"seed": 2017}]
    drawn = [fly(short, short_guidance, n=5, **FEW, **one) for one in options]
    assert [flights.pool for flights in drawn] == ["reported", "tuning", "reported"]
    rows = np.concatenate([flights.parameters for flights in drawn])
    assert len(np.unique(rows, axis=0)) == len(rows)


def test_what_is_derived_follows_from_what_is_recorded(short: Mission, campaign: Flights) -> None:
    final, target = campaign.final_states, short.target
    radius = short.flight_model.planet.equatorial_radius

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
    k = 7  # in the world `entry` the truth is the model
    state = campaign.states[:, :, k].T
    q, heat, load = path_constraints(short.flight_model, state, campaign.times[k])
    limits = short.limits
    for i, over in enumerate(
        (q / limits.dynamic_pressure, heat / limits.heat_flux, load / limits.load_factor)
    ):
        assert campaign.path[:, i, k] == pytest.approx(over, rel=1e-12)
    assert campaign.n == N
    assert (campaign.mode, campaign.seed, campaign.pool) == (Mode.AMPI, 5, "reported")
    assert (campaign.mission, campaign.world, campaign.profiles) == ("shefex3", "entry", "")
    assert campaign.drawn.split("\n")[0] == "entry.speed: normal, 3σ 70 m/s"


def test_what_is_recorded_is_of_the_truth(short: Mission, short_guidance: Guidance) -> None:
    """The recorded use of a limit is one of those that the peak is the greatest of, to the bit."""
    thick = world("[density]\nfactor = 1.3\nnoise = 0.05\n[wind]\neast_m_per_s = 80.0\n")
    flights = fly(short, short_guidance, thick, n=4, **{**FEW, "record_every": 0.5})
    assert flights.profiles == "density wind"
    recorded = np.nanmax(flights.path, axis=2)
    assert np.all(recorded <= flights.peak)
    # each cycle is a plant step, and the flight ends after the peak of the heat flux
    assert np.array_equal(recorded[:, 1], flights.peak[:, 1])
    assert np.isnan(flights.path[..., -1]).any()
    drawn, kept = thick.draw(short, 4, 2016), flights.truth
    assert np.array_equal(kept.density, drawn.density)
    assert np.array_equal(kept.wind, drawn.wind)
    assert {name: values.tolist() for name, values in kept.numbers.items()} == {
        name: values.tolist() for name, values in drawn.numbers.items()
    }


def of_another(mission: Mission, guidance: Guidance) -> Guidance:
    """The same table as if it were of that mission: it flies to its own target all the same."""
    table = copy(guidance)
    table.mission_sha256 = mission.digest
    return table


@pytest.mark.parametrize(("along", "across"), [(8e3, 0.0), (0.0, 8e3), (-3e3, -6e3)])
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
    flights = fly(other, of_another(other, guidance), n=5, **FEW)
    assert np.abs(flights.along - along).max() < 300.0
    assert np.abs(flights.across - across).max() < 300.0


def test_a_campaign_does_not_depend_on_the_turn_of_its_target(
    mission: Mission, guidance: Guidance
) -> None:
    target = mission.target.model_copy(update={"longitude": mission.target.longitude + 2.0 * np.pi})
    other = mission.model_copy(update={"target": target})
    here, there = (fly(m, of_another(m, guidance), n=5, **FEW) for m in (mission, other))
    for name in ("miss", "along", "across"):
        assert getattr(there, name) == pytest.approx(getattr(here, name), abs=1e-6)


def test_schemes_fly_the_same_draws(short: Mission, short_guidance: Guidance) -> None:
    """Each as it flies alone; a world that draws more leaves what both draw as it is."""
    lift = world('[aerodynamics]\nlift_factor = { distribution = "normal", three_sigma = 0.1 }\n')
    schemes = {mode.value: Scheme(short_guidance.in_mode(mode)) for mode in MODES}
    schemes["lift"] = Scheme(short_guidance, lift)
    flown = fly_schemes(short, schemes, 4, seed=8, **FEW)
    assert list(flown) == list(schemes)
    for flights in flown.values():
        assert np.array_equal(flights.parameters, flown["ampi"].parameters)
    assert [flown[mode.value].mode for mode in MODES] == MODES
    assert len({flights.miss.tobytes() for flights in flown.values()}) == len(schemes)
    assert not flown["nominal"].clipped.any()
    assert_identical(fly(short, short_guidance, lift, 4, seed=8, **FEW), flown["lift"])
    with pytest.raises(ValueError, match="schemes: expected at least one, got none"):
        fly_schemes(short, {}, 4)
    with pytest.raises(ValueError, match=r"schemes: expected an ampi\.Scheme by each name, got 'e"):
        fly_schemes(short, {"a": "entry"}, 4)  # type: ignore[dict-item]


def test_flights_are_flown_at_the_cycle_that_is_asked_for(
    short: Mission, short_guidance: Guidance
) -> None:
    every = fly(short, short_guidance, n=3, **{**FEW, "cycle": 2.0, "record_every": 0.1})
    assert every.cycle == 2.0
    assert np.all(np.diff(every.times) == 2.0)  # the record follows the cycle
    slopes = np.diff(every.bank_rate, axis=1) / 2.0
    limit = short.limits.bank_acceleration
    assert np.nanmax(np.abs(slopes)) <= limit * (1 + 1e-9)
    assert every.reached.all()
    assert short_guidance.cycle == 0.5
    assert not np.array_equal(every.miss, fly(short, short_guidance, n=3, **FEW).miss)


# --- flights that fail ----------------------------------------------------------------------------


def test_absurd_entries_are_recorded_not_dropped(
    mission: Mission, guidance: Guidance, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every flight has a status; those that did not arrive are in no circle."""
    monkeypatch.setattr(monte_carlo, "BATCH", 30)
    absurd = world(head=UNIFORM.format(50.0))
    flights = fly(mission, guidance, absurd, n=30, seed=3, n_jobs=1, cycle=1.0)
    assert flights.n == len(flights.status) == 30
    assert set(flights.status.tolist()) <= {int(s) for s in FlightStatus}
    failed = ~flights.reached
    assert 0 < failed.sum() < 30
    assert np.all(flights.speed_error[flights.status == int(FlightStatus.TIME_LIMIT)] > 0.0)
    assert flights.speed_error[flights.reached] == pytest.approx(0.0, abs=0.05)
    verdict = judge(flights)
    assert sum(ring.count for ring in verdict.rings) == 30
    assert verdict.rings[-1].count >= failed.sum()
    assert verdict.reached.count == flights.reached.sum()
    assert verdict.classes is not None
    assert sum(share.count for share in verdict.classes.values()) == 30
    assert verdict.classes["OUT_OF_REACH"].count > 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"miss": np.zeros(4)}, r"flights.parameters: expected an array of shape \(4, 6\)"),
        ({"status": np.full(5, 0.5)}, "flights.status: expected .* kind 'i', got"),
        ({"status": np.full(5, 9)}, "flights.status: expected members of FlightStatus"),
        ({"miss": np.full(5, np.nan)}, "flights.miss: expected finite numbers of every flight"),
        ({"peak": np.ones((5, 2))}, r"flights.peak: expected an array of shape \(5, 5\)"),
        ({"numbers": np.ones((5, 2))}, r"flights.numbers: expected an array of shape \(5, \d+\)"),
        ({"wind": np.ones((5, 2))}, r"flights.wind: expected an array of shape \(5, 2, 131\)"),
        ({"times": np.zeros(4)}, "expected times, and radii above 0, that increase strictly"),
        ({"altitude_tolerance": np.nan}, "expected positive tolerances"),
    ],
)
def test_flights_that_disagree_with_themselves_are_refused(
    make_flights: Callable[..., Flights], changes: dict[str, object], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        make_flights(5, **changes)
