"""SHEFEX-3 and its nominal optimum, with the one-case guidance table that flies it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.loading import segments_of
from ampi.missions.family import MissionFamily
from ampi.missions.loading import load_mission
from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.onboard.row_layout import LINEAR_TRACKING
from ampi.onboard.table import GuidanceTable
from ampi.scp.solve import solve
from ampi.tracker_design.riccati_gains import GainSettings, vertex_gains
from ampi.tracking.bank_limiter import BankLimits
from ampi.trajectory import Status, Trajectory
from database.file.writer import high_density_times

Array = NDArray[np.float64]


@pytest.fixture(scope="session")
def mission() -> Mission:
    return load_mission("shefex3")


@pytest.fixture(scope="session")
def nominal(mission: Mission) -> Trajectory:
    trajectory = solve(mission)
    assert trajectory.status is Status.SOLVED
    return trajectory


@pytest.fixture(scope="session")
def gains(mission: Mission, nominal: Trajectory) -> Array:
    """(7, n)."""
    return vertex_gains(
        MissionFamily.of([mission]),
        nominal.mesh,
        nominal.states[None],
        np.array([nominal.final_time]),
        GainSettings(),
    )[0]


@pytest.fixture(scope="session")
def tracked(mission: Mission, nominal: Trajectory, gains: Array) -> Guidance:
    """The nominal optimum, tracked."""
    fixed, free = high_density_times(nominal.mesh, nominal.final_time)
    times = fixed + free * nominal.final_time
    rows = np.vstack([nominal.states, nominal.bank_rate, gains])
    table = GuidanceTable(
        axes=tuple(np.array([x]) for x in mission.entry_state),
        values=rows.reshape(1, 1, 1, 1, 1, 1, *rows.shape),
        final_time=np.full((1,) * 6, nominal.final_time),
        segments=segments_of(nominal.mesh),
        conversion=np.ascontiguousarray(nominal.mesh.conversion(times, nominal.final_time).T),
        high_density_time=(fixed, free),
        centre=(0,) * 6,
    )
    limits = mission.limits
    return Guidance(
        table,
        BankLimits(limits.bank_angle, limits.bank_rate, limits.bank_acceleration),
        Mode.NOMINAL,
    )


@pytest.fixture(scope="session")
def untracked(tracked: Guidance) -> Guidance:
    """The same reference flown in open loop: no gains."""
    values = tracked.table.values.copy()
    values[..., LINEAR_TRACKING.gains, :] = 0.0
    return Guidance(replace(tracked.table, values=values), tracked.limits, Mode.NOMINAL)
