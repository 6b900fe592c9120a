"""Every term of the objective and every kind of limit: slopes and curvature by differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.missions import Mission
from ampi.missions.flight_sections import NoFlyZoneSection
from ampi.missions.loading import parse_mission
from ampi.physics.path_constraints import path_constraints
from ampi.physics.planet import great_circle_distance
from ampi.physics.vehicle import air_loads
from ampi.scp.condensed.condensing import CondensedDynamics
from ampi.scp.condensed.iterate import ONE, Flight, Iterate, Point, RestorationSettings
from ampi.scp.condensed.quadratic_model import (
    CurvatureSettings,
    Multipliers,
    lagrangian_hessian,
    quadratic_subproblem,
)
from ampi.scp.guess import ConstantBank, constant_bank_guess
from ampi.scp.problem.scaled_problem import OptimalControlProblem

Array = NDArray[np.float64]
STEP = 1e-4
TERMS = {
    "bank_rate_effort": 1e-2,
    "bank_rate_variation": 0.3,
    "flight_time": 0.5,
    "heat_load": 2.0,
    "ground_range": -0.2,
    "descent_rate": 1e-3,
}


@pytest.fixture(scope="module")
def everything(mission: Mission) -> Mission:
    """SHEFEX-3, its angle of attack drifting to the end, with all terms and limits at once."""
    text = mission.toml
    for old, new in (
        ("start = 58.0", "start = 0.0"),
        ("end = 88.0", "end = 2000.0"),
        ("start_angle_deg = 42.0", "start_angle_deg = 20.0"),
        ("end_angle_deg = 17.5", "end_angle_deg = 15.0"),
    ):
        text = text.replace(old, new)
    drifting = parse_mission(text)
    objective = drifting.objective.model_copy(update=TERMS | {"desired_altitude_rate": -100.0})
    floor = {"drag_floor": 0.5, "drag_floor_speed": 3000.0}
    target = {"flight_path_angle": (-0.3, -0.1), "azimuth": (-1.0, -1.0)}
    zone = NoFlyZoneSection(longitude_deg=-30.0, latitude_deg=69.0, radius_km=600.0)
    return drifting.model_copy(
        update={
            "objective": objective,
            "limits": drifting.limits.model_copy(update=floor),
            "target": drifting.target.model_copy(update=target),
            "no_fly_zone": (zone,),
        }
    )


@pytest.fixture(scope="module")
def flying(everything: Mission) -> Flight:
    settings = RestorationSettings(tolerance=1e-12, corrections=20)
    return Flight.of(OptimalControlProblem.of(everything), settings)


@pytest.fixture(scope="module")
def point(flying: Flight, everything: Mission) -> Point:
    """Off the constant bank angle, so that no absolute value sits at its kink."""
    guess = constant_bank_guess(everything, ConstantBank(np.radians(-30.0)))
    assert guess is not None
    rate = 0.02 * np.cos(np.arange(len(guess.bank_rate)))
    found = flying.first_point(replace(guess, bank_rate=rate * flying.problem.angles[0].rate_limit))
    assert found is not None
    return found


@pytest.fixture(scope="module")
def condensed(flying: Flight, point: Point) -> CondensedDynamics:
    return flying.linearise(point.iterate)


def flown(flight: Flight, point: Point, condensed: CondensedDynamics, z: Array) -> Point:
    """The flight restored at the controls of z."""
    here = point.iterate
    states = here.states + condensed.change(z[None], ONE)[:, 0].T
    there = Iterate(states, here.controls + z[:-2], here.final_time + 100.0 * z[-2])
    restored = flight.restore(there, None)
    assert restored is not None
    return restored


def directions(n_z: int) -> list[Array]:
    unit, rng = np.eye(n_z), np.random.default_rng(7)
    return [unit[-2], unit[-1], unit[n_z // 3], *(0.1 * rng.normal(size=n_z) for _ in range(2))]


def test_the_cost_is_the_sum_of_its_terms(
    flying: Flight, point: Point, everything: Mission
) -> None:
    here, t = point.iterate, flying.transcription
    x = (here.states * np.array(flying.problem.scaling.states)).T
    times = t.times(here.final_time)
    heat = path_constraints(everything.flight_model, x, times)[1]
    radius = everything.flight_model.planet.equatorial_radius
    rate = np.abs(here.controls) * everything.limits.bank_rate / np.radians(1.0)
    over_ground = x[3] * np.cos(x[4]) * radius / (radius + x[0])
    running = (
        TERMS["bank_rate_effort"] * rate**2
        + TERMS["bank_rate_variation"] * rate
        + TERMS["heat_load"] * 1e-6 * heat[1:]
        + TERMS["ground_range"] * 1e-3 * over_ground[1:]
        + TERMS["descent_rate"] * np.abs(x[3] * np.sin(x[4]) + 100.0)[1:]
    )
    exact = np.sum(t.weights * t.half_lengths(here.final_time) * running)
    exact += TERMS["flight_time"] * here.final_time
    assert point.cost * flying.problem.objective.cost_scale == pytest.approx(exact, rel=1e-12)


def test_the_limits_are_what_they_are_called(
    flying: Flight, point: Point, everything: Mission
) -> None:
    x = (point.iterate.states * np.array(flying.problem.scaling.states)).T
    times, model = flying.transcription.times(point.iterate.final_time), everything.flight_model
    drag = air_loads(model.vehicle, model.atmosphere, x[0], x[3], times).drag
    floor = 0.5 * model.planet.load_factor_gravity
    slow = x[3] <= 3000.0
    assert flying.problem.functions.names[3:] == ("drag_floor", "no_fly_zone 1")
    assert np.array_equal(point.path[:, 3] <= 1.0, ~slow | (drag >= floor))
    radius = model.planet.equatorial_radius
    away = great_circle_distance(x[1], x[2], np.radians(-30.0), np.radians(69.0), radius)
    inside = away < 600e3
    assert np.array_equal(point.path[:, 4] > 1.0, inside)
    assert inside.any()


def test_first_derivatives(flying: Flight, point: Point, condensed: CondensedDynamics) -> None:
    multipliers = Multipliers.first(flying.problem, point)
    settings = CurvatureSettings(screening=-np.inf)
    model = quadratic_subproblem(flying, point, condensed, multipliers, met=None, settings=settings)
    node, kind = model.path_node, model.path_kind
    for d in directions(len(model.gradient)):
        ahead = flown(flying, point, condensed, STEP * d)
        behind = flown(flying, point, condensed, -STEP * d)
        slope = (ahead.smooth_cost - behind.smooth_cost) / (2.0 * STEP)
        assert slope == pytest.approx(model.gradient @ d, rel=1e-6, abs=1e-6)
        pairs = (
            (ahead.target_error, behind.target_error, model.target_map @ d),
            (ahead.path[node, kind], behind.path[node, kind], model.path_rows @ d),
        )
        for after, before, linear in pairs:
            differenced = (after - before) / (2.0 * STEP)
            assert np.abs(differenced - linear).max() < 1e-5 * max(1.0, np.abs(linear).max())
        # what stands inside |·|, its quadrature weight included
        inside = (
            ahead.absolute.weight * ahead.absolute.value
            - behind.absolute.weight * behind.absolute.value
        )
        linear = point.absolute.weight * (model.absolute_rows @ d)
        assert np.abs(inside / (2.0 * STEP) - linear).max() < 1e-6 * np.abs(linear).max()


def test_curvature_of_the_lagrangian(
    flying: Flight, point: Point, condensed: CondensedDynamics
) -> None:
    # Second differences of J + λᵀe + Σ νᵀg + Σ β σ, |c| weighed by κ, along restored flights.
    rng, n = np.random.default_rng(2), len(point.path)
    kappa = rng.uniform(-1.0, 1.0, len(point.absolute.value))
    multipliers = Multipliers(
        target=rng.normal(size=6),
        limits=rng.uniform(size=point.path.shape) * (np.arange(5) != 3),  # but the switched one
        angles=0.1 * rng.normal(size=(1, n)),
        absolute=kappa * point.absolute.weight,
    )

    def lagrangian(at: Point) -> float:
        return float(
            at.smooth_cost
            + kappa @ (at.absolute.weight * at.absolute.value)
            + multipliers.target @ at.target_error
            + np.sum(multipliers.limits * at.path)
            + multipliers.angles[0] @ at.iterate.states[:, 6]
        )

    hessian = lagrangian_hessian(flying, point, condensed, multipliers)
    assert hessian == pytest.approx(hessian.T, abs=1e-10 * np.abs(hessian).max())
    here, step = lagrangian(point), 3e-3
    for d in directions(len(hessian)):
        values = [lagrangian(flown(flying, point, condensed, k * step * d)) for k in (-2, -1, 1, 2)]
        near, far = values[1] + values[2] - 2.0 * here, values[0] + values[3] - 2.0 * here
        curvature = (16.0 * near - far) / (12.0 * step**2)
        assert curvature == pytest.approx(d @ hessian @ d, rel=2e-4)
