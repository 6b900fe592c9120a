"""Rows of the drag-tracking laws against the physics, by finite differences and by the planet's arc."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.missions.family import MissionFamily
from ampi.missions.loading import load_mission
from ampi.missions.mission import Mission
from ampi.onboard.row_layout import DRAG_TRACKING, RowKind
from ampi.physics.vehicle import air_loads, air_loads_at_angle
from ampi.tracker_design.drag_rows import drag_rows

Array = NDArray[np.float64]

NAMES = [row.name for row in DRAG_TRACKING.rows if row.kind is RowKind.LOAD]


def flights(mission: Mission, n: int = 6) -> tuple[Array, Array]:
    """Three trajectories of n points, descending and slowing down, and their times."""
    rng = np.random.default_rng(5)
    start = np.array([7e4, -0.3, 1.2, 4500.0, -0.1, -1.5, -0.6])
    end = np.array([2.5e4, -0.8, 1.1, 700.0, -0.02, -1.2, 0.5])
    share = np.linspace(0.0, 1.0, n)
    path = start[:, None] + (end - start)[:, None] * share
    states = path * (1.0 + 0.01 * rng.standard_normal((3, 7, 1)))
    return states, np.tile(np.linspace(30.0, 600.0, n), (3, 1))


@pytest.mark.parametrize("name", ["shefex3", "cavh_wang2020"])  # of angles over time and over speed
def test_rows_are_the_physics_at_the_nodes(name: str) -> None:
    mission = load_mission(name)
    states, times = flights(mission)
    rows = drag_rows(MissionFamily.of([mission] * 3), states, times)
    assert rows.shape == (3, len(NAMES), 6)
    got = dict(zip(NAMES, rows.transpose(1, 0, 2), strict=True))
    model = mission.flight_model
    vehicle, atmosphere, h, v = model.vehicle, model.atmosphere, states[:, 0], states[:, 3]

    def log_drag(dh: float = 0.0, da: float = 0.0) -> Array:
        angle = vehicle.angle_of_attack(times, v) + da
        return np.log(air_loads_at_angle(vehicle, atmosphere, h + dh, v, angle).drag)

    air = air_loads(vehicle, atmosphere, h, v, times)
    assert got["log_drag"] == pytest.approx(np.log(air.drag), rel=1e-14)
    assert got["lift_to_drag"] == pytest.approx(air.lift / air.drag, rel=1e-14)
    scale_height = -20.0 / (log_drag(dh=10.0) - log_drag(dh=-10.0))
    assert got["drag_scale_height"] == pytest.approx(scale_height, rel=1e-5)
    slope = (log_drag(da=1e-5) - log_drag(da=-1e-5)) / 2e-5
    assert got["drag_slope"] == pytest.approx(slope, rel=1e-6)


def test_the_range_to_go_is_the_arc_to_the_last_node() -> None:
    mission = load_mission("shefex3")
    states, times = flights(mission)
    to_go = drag_rows(MissionFamily.of([mission] * 3), states, times)[:, NAMES.index("range_to_go")]
    longitude, latitude = states[:, 1], states[:, 2]
    place = np.stack(
        [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ]
    )
    cosine = (place * place[..., -1:]).sum(axis=0)
    arc = mission.flight_model.planet.equatorial_radius * np.arccos(np.minimum(cosine, 1.0))
    assert to_go == pytest.approx(arc, rel=1e-6, abs=1.0)
    assert not to_go[:, -1].any()


def test_each_case_has_the_numbers_of_its_mission_and_depends_on_no_other() -> None:
    mission = load_mission("shefex3_density")
    nominal = mission.nominal_parameters
    heavy = nominal.copy()
    place = [p.key for p in mission.parameters].index("density_factor")
    heavy[place] *= 1.1
    states, times = flights(mission)
    both = drag_rows(mission.family([nominal, heavy]), states[[0, 0]], times[:2])
    assert both[1, 0] - both[0, 0] == pytest.approx(np.full(6, np.log(1.1)), rel=1e-9)
    alone = drag_rows(mission.family([heavy]), states[[0]], times[:1])
    assert np.array_equal(alone[0], both[1])


def test_a_case_without_solution_stays_not_a_number_and_harms_none() -> None:
    mission = load_mission("shefex3")
    states, times = flights(mission)
    family = MissionFamily.of([mission] * 3)
    whole = drag_rows(family, states, times)
    states[1], times[1] = np.nan, np.nan
    rows = drag_rows(family, states, times)
    assert np.isnan(rows[1]).all()
    assert np.array_equal(rows[[0, 2]], whole[[0, 2]])
