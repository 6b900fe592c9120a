"""Collocation on board, and the flights that solve it, against the mesh and an integrator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.loading import segments_of
from ampi.missions.loading import load_mission
from ampi.missions.mission import Mission
from ampi.onboard.collocation import Collocation
from ampi.onboard.flight_model import BANK, SPEED
from ampi.onboard.predicted_flight import LONGEST, SETTLED, at_speed, flown_nodes
from ampi.onboard_model import flight_model_of
from ampi.propagation.bank_profile import fly_to_speed
from ampi.pseudospectral.mesh import Mesh, Phase
from ampi.scp.guess import ConstantBank, constant_bank_guess

Array = NDArray[np.float64]

MESH = Mesh((Phase((3,), 20.0), Phase((4, 6), None, (0.0, 0.3, 1.0))))


def test_slopes_and_midpoints_are_exact_for_the_polynomials_of_a_segment() -> None:
    final_time, collocation = np.array([90.0, 130.0]), Collocation.of(segments_of(MESH))
    times = collocation.times(final_time)
    np.testing.assert_allclose(times, [MESH.times(t) for t in final_time], rtol=1e-14, atol=1e-12)
    for rule, degree in zip(collocation.rules, (3, 4, 6), strict=True):
        half, middles = rule.half(final_time)[:, None], rule.middle_times(final_time)
        nodal = times[:, rule.nodes]
        np.testing.assert_allclose(middles, 0.5 * (nodal[:, 1:] + nodal[:, :-1]), rtol=1e-13)
        origin = nodal.mean()
        values = ((nodal - origin) / 50.0) ** degree
        slope = degree * ((nodal - origin) / 50.0) ** (degree - 1) / 50.0
        between = degree * ((middles - origin) / 50.0) ** (degree - 1) / 50.0
        np.testing.assert_allclose(values @ rule.slopes.T / half, slope[:, 1:], atol=1e-12)
        np.testing.assert_allclose(values @ rule.middle_slopes.T / half, between, atol=1e-12)
        np.testing.assert_allclose(
            values @ rule.middle.T, ((middles - origin) / 50.0) ** degree, atol=1e-12
        )


def with_more_nodes(mission: Mission) -> Mission:
    """On a mesh that is fine enough for any flight, not only for the mission's optima."""
    phases = mission.pseudospectral_mesh.phases
    more = (replace(p, degrees=tuple(degree + 8 for degree in p.degrees)) for p in phases)
    return mission.with_mesh(Mesh(tuple(more)))


def banked_flights(mission: Mission) -> tuple[Array, Array, Array]:
    """Nodal states (7, n, nodes), final times (n,) and entries (6, n) beside those of the states."""
    guesses = [constant_bank_guess(mission, ConstantBank(bank)) for bank in (0.35, 0.6)]
    assert None not in guesses
    states = np.stack([g.states.T for g in guesses if g is not None], axis=1)
    final_time = np.array([g.final_time for g in guesses if g is not None])
    states[BANK] += 0.05 * np.sin(
        np.linspace(0.0, 6.0, states.shape[2])
    )  # a profile, not a constant
    aside = np.array([[100.0, 1e-3, -1e-3, 4.0, 2e-4, 1e-3], [-200.0, 0.0, 1e-3, -2.0, 0.0, -2e-3]])
    return states, final_time, states[:BANK, :, 0] + aside.T


# every form of air, aerodynamics and schedule
@pytest.mark.parametrize("name", ["shefex3_january", "cavh_wang2020", "rlv_liu2024"])
def test_flights_end_where_an_integrator_of_the_physics_takes_them(name: str) -> None:
    mission = with_more_nodes(load_mission(name))
    model, collocation = (
        flight_model_of(mission),
        Collocation.of(segments_of(mission.pseudospectral_mesh)),
    )
    states, final_time, entry = banked_flights(mission)
    speed = states[SPEED, :, -1] - [5.0, -20.0]  # one flies on, the other ends before its reference
    flown, moved = flown_nodes(model, collocation, states, entry, final_time)
    rate = np.zeros(2)
    end, time = at_speed(model, flown[:, :, -1], final_time, rate, speed)
    truth = fly_to_speed(
        mission.flight_model,
        mission.pseudospectral_mesh,
        states[BANK],
        entry.T,
        final_time,
        speed,
        LONGEST,
    )
    assert np.all(moved < SETTLED)
    shift = np.abs(states[:BANK, :, -1].T - truth)
    assert np.all(np.abs(time - final_time) < LONGEST)
    np.testing.assert_allclose(end[SPEED], speed, rtol=1e-12)
    # a hundredth of what profile and entry have moved, and mostly a thousandth
    error = np.abs(end[:BANK].T - truth)
    assert np.all(error[:, [0, 1, 2]] < 0.01 * shift[:, [0, 1, 2]].max(axis=0))


def test_a_flight_that_is_no_number_touches_no_other() -> None:
    mission = load_mission("shefex3")
    model, collocation = (
        flight_model_of(mission),
        Collocation.of(segments_of(mission.pseudospectral_mesh)),
    )
    states, final_time, entry = banked_flights(mission)
    expected, _ = flown_nodes(model, collocation, states, entry, final_time)
    entry[0, 0] = np.nan
    with np.errstate(all="ignore"):
        found, moved = flown_nodes(model, collocation, states, entry, final_time)
    assert not moved[0] < SETTLED and moved[1] < SETTLED
    np.testing.assert_allclose(found[:, 1], expected[:, 1], rtol=1e-12)


def test_a_speed_that_is_not_reached_is_no_number() -> None:
    mission = load_mission("shefex3")
    model = flight_model_of(mission)
    states, final_time, _ = banked_flights(mission)
    for speed in (50.0, 5000.0):  # minutes below, and before
        with np.errstate(all="ignore"):
            end, time = at_speed(
                model, states[:, :, -1], final_time, np.zeros(2), np.full(2, speed)
            )
        assert np.all(np.isnan(end)) and np.all(np.isnan(time))
