"""What the methods of the literature begin with: a formulation and a first iterate.

- `straight_line`: Zhou 2021, Section 4.1, over time;
- `flown`: Wang 2020, Step 1, over time, a flight at a constant bank angle;
- `over_energy`: Liu 2015, Remark 6, over energy (`energy_guess`), with the price on the side.

A start is None where its guess cannot be flown.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ampi.missions.final_states import final_states
from ampi.missions.mission import Mission
from ampi.physics.angles import on_turn_of
from ampi.physics.state import (
    ALTITUDE,
    ANGLE_OF_ATTACK,
    AZIMUTH,
    LATITUDE,
    LONGITUDE,
    SPEED,
)
from ampi.pseudospectral.mesh import Mesh, Phase
from ampi.scp.guess import ConstantBank, constant_bank_guess, default_guess
from ampi.scp.literature.coast import guessed_angle, until_drag, until_level
from ampi.scp.literature.collocation import line_mesh, trapezoid
from ampi.scp.literature.energy_domain import EnergyDomain
from ampi.scp.literature.energy_guess import lifted_lines
from ampi.scp.literature.formulation import Formulation
from ampi.scp.literature.subproblem_builder import MeshIterate
from ampi.scp.literature.time_domain import TimeDomain

DEGREE = float(np.pi / 180.0)
HANDOVER_DRAG = 0.05  # [X] g₀: above it the energy domain is singular, and no bank angle matters
# [X] w of `energy_domain`, Eq. (3), in objectives of the guess per rad. Below a half of it nodes of the
# CAV-H lie inside the circle; with twice as much the minimum heat load takes more iterations
SIDE_SHARE = 0.01
HALF_WAVE = 22.0 * DEGREE  # [X] Θ of Eq. (3): a weave of ±11° lengthens the path by 0.6 %


@dataclass(frozen=True, eq=False)
class Start:
    """A formulation and the iterate that the method begins with."""

    formulation: Formulation
    iterate: MeshIterate


def straight_line(points: int, flight_time: float) -> Callable[[Mission], Start | None]:
    """Zhou 2021, Section 4.1: the descent flown until level, then straight lines to the target."""

    def start(mission: Mission) -> Start | None:
        coast = until_level(mission)
        if coast is None:
            return None
        form = TimeDomain.from_mission(mission, coast)
        target, tau = mission.target, np.linspace(0.0, 1.0, points)
        first = coast.states[:, -1]
        last = first.copy()
        last[[LONGITUDE, LATITUDE]] = target.longitude, target.latitude
        last[[ALTITUDE, SPEED]] = target.altitude, target.speed
        last[ANGLE_OF_ATTACK:] = guessed_angle(mission, last)
        for held in final_states(mission):
            last[held.state] = held.middle
        last[[LONGITUDE, AZIMUTH]] = on_turn_of(
            last[[LONGITUDE, AZIMUTH]], first[[LONGITUDE, AZIMUTH]]
        )
        states = (first + (last - first) * tau[:, None]) / form.state_scale
        controls = np.zeros((points, form.n_controls))
        iterate = MeshIterate(line_mesh(tau), states, controls, flight_time)
        return Start(form, iterate)

    return start


def flown(mesh: Mesh) -> Callable[[Mission], Start | None]:
    """Wang 2020, Step 1: the equations of motion flown with a control profile, a constant bank."""

    def start(mission: Mission) -> Start | None:
        guess = default_guess(mission)
        if not isinstance(guess, ConstantBank):
            return None
        form = TimeDomain.from_mission(mission)
        nodal = constant_bank_guess(mission.with_mesh(mesh), guess)
        if nodal is None:
            return None
        states = nodal.states / form.state_scale
        controls = np.zeros((len(states), form.n_controls))
        return Start(form, MeshIterate(mesh, states, controls, nodal.final_time))

    return start


def over_energy(points: int) -> Callable[[Mission], Start | None]:
    """The guess over energy: Liu 2015, Remark 6, within the altitude bounds (`energy_guess`)."""

    def start(mission: Mission) -> Start | None:
        form, level = _energy_domain(mission), until_level(mission)
        if form is None or level is None:
            return None
        tau = np.linspace(0.0, 1.0, points)
        states = lifted_lines(form, level, tau * form.energy_range) / form.state_scale
        iterate = MeshIterate(line_mesh(tau), states, np.zeros((points, 2)), form.energy_range)
        side = SIDE_SHARE * (_objective(form, iterate) or typical_cost(mission))
        return Start(replace(form, side_weight=side), iterate)

    return start


def _objective(form: EnergyDomain, at: MeshIterate) -> float:
    """Size of the mission's objective along a guess; without control, Eq. (3) adds nothing to it."""
    integrals = (
        trapezoid(at.mesh).weights(at.final)
        @ form.linearise(at.mesh, at.states, at.controls, at.final).integrands
    )
    return float(np.abs(integrals) @ np.abs([term.weight for term in form.terms]))


def _energy_domain(mission: Mission) -> EnergyDomain | None:
    """With a side weight of one; `over_energy` knows better once it has a guess."""
    planet = mission.flight_model.planet
    gravity = planet.gravitational_parameter / planet.equatorial_radius**2
    coast = until_drag(mission, HANDOVER_DRAG * gravity, 0.0)
    if coast is None:
        return None
    return EnergyDomain(mission, coast, 1.0, HALF_WAVE)


def uniform(segments: int, degree: int) -> Mesh:
    """hp mesh of equal segments."""
    return Mesh((Phase((degree,) * segments),))


def typical_cost(mission: Mission) -> float:
    """The size of a mission's objective, from the size of its terms in a glide of half an hour."""
    o = mission.objective
    return (
        (abs(o.bank_rate_effort) + abs(o.angle_of_attack_effort)) * 100.0  # (deg/s)² s
        + abs(o.bank_rate_variation) * 100.0  # deg
        + abs(o.flight_time) * 1000.0  # s
        + abs(o.heat_load) * 500.0  # MJ/m²
        + abs(o.ground_range) * 1e4  # km
        + abs(o.descent_rate) * 1e4  # m
        + abs(o.cross_range) * 1e3  # km
        + abs(o.final_speed) * 1e3  # m/s
    )
