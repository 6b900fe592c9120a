"""Least and greatest range against DOP853, and the flights whose target lies outside."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.physics.planet import bearing, destination, great_circle_distance
from ampi.physics.state import LATITUDE, LONGITUDE, SPEED
from ampi.simulation.estimates.failures import FailureClass
from ampi.simulation.flights import Flights
from ampi.simulation.monte_carlo import fly
from ampi.simulation.plant import Plant
from ampi.simulation.reach import BANKS, ranges
from ampi.simulation.world_loading import load_world
from tests.support.worlds import world

pytestmark = pytest.mark.slow

LONGEST = 1300.0  # s
LIFT = """[aerodynamics]
lift_factor = { distribution = "normal", three_sigma = 0.2 }
[wind]
east_m_per_s = 30.0
"""


def plant(mission: Mission, world: Any, n: int, longest: float = LONGEST) -> Plant:
    truth = world.draw(mission, n, 3)
    return Plant(mission.family(truth.parameters), truth, np.full(n, longest))


def witness(one: Plant, bank: float) -> float:
    """Range (m) of one vehicle with the bank angle held, by DOP853."""
    entry, held = np.append(one.family.entry_states[0], bank), np.zeros((2, 1))

    def slow(time: float, x: np.ndarray) -> float:
        return float(x[SPEED] - one.target_speed[0])

    slow.terminal = True  # type: ignore[attr-defined]
    path = solve_ivp(
        lambda time, x: one.rates(x[:, None], held, time)[:, 0],
        (0.0, LONGEST),
        entry,
        method="DOP853",
        rtol=1e-6,
        atol=1e-8,
        max_step=4.0,  # the schedule of the angle of attack has kinks
        events=slow,
    )
    assert path.status == 1
    ends = (x[[LONGITUDE, LATITUDE]] for x in (entry, path.y[:, -1]))
    radius = one.family.flight_model().planet.equatorial_radius
    return float(great_circle_distance(*next(ends), *next(ends), radius))


@pytest.mark.parametrize(
    ("name", "flights", "within"), [("entry", 2, 5.0), ("lift", 1, 5.0), ("everything", 1, 50.0)]
)
def test_ranges_are_those_of_a_finer_integrator(
    mission: Mission, name: str, flights: int, within: float
) -> None:
    """Metres; tens of them through noise over altitude, whose kinks a step of 2 s passes over."""
    vehicles = plant(mission, world(LIFT) if name == "lift" else load_world(name), flights)
    least, greatest = ranges(vehicles)
    for i in range(flights):
        one = vehicles.take([i])
        limit = float(np.ravel(one.limits.bank_angle)[0])
        found = [witness(one, share * limit) for share in BANKS]
        assert least[i] == pytest.approx(min(found), abs=within)
        assert greatest[i] == pytest.approx(max(found), abs=within)
        assert max(found) == found[0]  # wings level


def test_more_lift_and_less_drag_go_farther(mission: Mission) -> None:
    """And each flight has its own range, whatever company it has."""
    laws = [
        world(f"[aerodynamics]\nlift_factor = {k}\ndrag_factor = {2.0 - k}\n") for k in (0.9, 1.1)
    ]
    less, more = (ranges(plant(mission, law, 3)) for law in laws)
    assert np.all(more[1] > less[1] + 100e3)
    alone = ranges(plant(mission, laws[0], 3).take([1]))
    assert [float(values[0]) for values in alone] == [float(values[1]) for values in less]


def test_the_nominal_target_lies_well_inside(mission: Mission) -> None:
    least, greatest = ranges(
        plant(mission, world(head='name = "w"\ntitle = ""\n[entry]\ndistribution = "none"\n'), 1)
    )
    distance = distance_of(mission)
    assert least[0] < 0.5 * distance
    assert greatest[0] > 1.1 * distance


def test_a_range_that_is_not_flown_to_its_end_is_unknown(mission: Mission) -> None:
    """Banked flights end before the wings-level one: its time limit must not pass for its range."""
    entry = load_world("entry")
    assert np.isfinite(ranges(plant(mission, entry, 2))).all()
    least, greatest = ranges(plant(mission, entry, 2, longest=500.0))
    assert np.isfinite(least).all()
    assert np.isnan(greatest).all()
    assert np.isnan(ranges(plant(mission, entry, 2, longest=100.0))).all()


# --- in a campaign --------------------------------------------------------------------------------


def distance_of(mission: Mission) -> float:
    target, radius = mission.target, mission.flight_model.planet.equatorial_radius
    entry = mission.entry_state[[LONGITUDE, LATITUDE]]
    return float(great_circle_distance(*entry, target.longitude, target.latitude, radius))


@pytest.fixture(scope="module")
def judged(mission: Mission, guidance: Guidance) -> Callable[[float], Flights]:
    """Flights judged against the target at so many times its distance, in the same direction."""

    def flights(times: float) -> Flights:
        target, entry = mission.target, mission.entry_state[[LONGITUDE, LATITUDE]]
        angle = times * distance_of(mission) / mission.flight_model.planet.equatorial_radius
        towards = bearing(*entry, target.longitude, target.latitude)
        longitude, latitude = (float(x) for x in destination(*entry, towards, angle))
        moved = target.model_copy(update={"longitude": longitude, "latitude": latitude})
        other, table = mission.model_copy(update={"target": moved}), copy(guidance)
        table.mission_sha256 = other.digest
        return fly(other, table, n=3, n_jobs=1, cycle=1.0)

    return flights


@pytest.mark.parametrize(
    ("times", "kind"),
    [
        (1.0, FailureClass.NONE),
        (1.1, FailureClass.MISSED),
        (1.35, FailureClass.OUT_OF_REACH),
        (0.35, FailureClass.OUT_OF_REACH),
    ],
)
def test_a_target_beyond_all_ranges_is_told_apart_from_a_miss(
    mission: Mission, judged: Callable[[float], Flights], times: float, kind: FailureClass
) -> None:
    flights = judged(times)
    assert flights.failures.tolist() == [int(kind)] * 3
    assert flights.distance == pytest.approx(times * distance_of(mission), rel=1e-9)
    known = ~flights.passed
    assert np.array_equal(np.isfinite(flights.least_range), known)
    assert np.array_equal(np.isfinite(flights.greatest_range), known)
