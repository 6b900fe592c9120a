"""A small table and small campaigns, made here: straight lines from entry to target."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ampi.correction.corrector import CorrectionOutcome
from ampi.loading import segments_of
from ampi.missions.loading import load_mission
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.onboard.reference import Mode
from ampi.onboard.table import GuidanceTable
from ampi.physics.planet import destination
from ampi.simulation.flights import Flights
from ampi.simulation.plant import FlightStatus
from ampi.simulation.uncertainties import BY_NAME
from tests.support.flights import nominal_truth, unremarkable

N, K, FINAL_TIME = 60, 30, 600.0
TRACK = 4.8  # rad, azimuth of the nominal track
SCATTER = {Mode.NOMINAL: 3e4, Mode.MPI: 6e3, Mode.AMPI: 2e3}  # m


@pytest.fixture(scope="session")
def mission() -> Mission:
    """SHEFEX-3 as shipped."""
    return load_mission("shefex3")


def straight(mission: Mission, fraction: np.ndarray) -> np.ndarray:
    """States (7, …) on the way from the entry to the target."""
    target = mission.target
    end = np.array([target.altitude, target.longitude, target.latitude, target.speed, -0.1, -1.5])
    start = mission.entry_state
    six = [a + (b - a) * fraction for a, b in zip(start, end, strict=True)]
    return np.stack([*six, 0.5 * np.sin(6.0 * fraction)])


@pytest.fixture(scope="session")
def table(mission: Mission) -> GuidanceTable:
    """Three altitudes by two azimuths on the mission's own mesh."""
    mesh = mission.pseudospectral_mesh
    axes = tuple(
        axis if i == 0 else axis[1:] if i == 5 else axis[1:2]
        for i, axis in enumerate(mission.grid_axes)
    )
    shape = tuple(len(axis) for axis in axes)
    values = np.zeros((*shape, 15, mesh.n_nodes))
    values[..., :7, :] = straight(mission, mesh.times(FINAL_TIME) / FINAL_TIME)
    for index in np.ndindex(shape):
        values[(*index, 2)] += 1e-4 * sum(index) * np.linspace(1.0, 0.1, mesh.n_nodes)
    fraction = np.linspace(0.0, 1.0, 41)
    return GuidanceTable(
        axes=axes,
        values=values,
        final_time=FINAL_TIME + np.arange(np.prod(shape), dtype=float).reshape(shape),
        segments=segments_of(mesh),
        conversion=np.ascontiguousarray(mesh.conversion(fraction * FINAL_TIME, FINAL_TIME).T),
        high_density_time=(np.zeros(41), fraction),
        centre=(1, 0, 0, 0, 0, 0),
    )


def campaign(mission: Mission, mode: Mode) -> Flights:
    """60 flights of one mode: three fail, three leave the hypercube, four exceed a limit."""
    draws = np.random.default_rng(7).standard_normal((N, 6))  # the same for every mode
    rng = np.random.default_rng(list(Mode).index(mode))
    times = np.linspace(0.0, FINAL_TIME, K)
    reference = np.broadcast_to(straight(mission, times / FINAL_TIME)[None], (N, 7, K))
    along, across = SCATTER[mode] * rng.standard_normal((2, N))
    states = reference + 1e-3 * draws[:, :1, None]
    end = rng.integers(K - 3, K + 1, N)[:, None] <= np.arange(K)
    status = np.full(N, int(FlightStatus.REACHED_SPEED))
    status[:3] = (FlightStatus.GROUND, FlightStatus.TIME_LIMIT, FlightStatus.NOT_FINITE)
    limits = PathLimits.of(mission).names
    path = 0.8 * rng.random((N, len(limits), K))
    path[:4, 2, 5] = 1.2
    peak = path.max(axis=2)
    final = states[:, :, -1] + 0.0
    target, radius = mission.target, mission.flight_model.planet.equatorial_radius
    final[:, 1], final[:, 2] = destination(
        target.longitude,
        target.latitude,
        TRACK + np.arctan2(across, along),
        np.hypot(across, along) / radius,
    )
    for lost in (final, along, across):
        lost[2] = np.nan
    return Flights(
        **nominal_truth(N),
        **unremarkable(N),
        mission=mission.name,
        mission_sha256="0" * 64,
        guidance_sha256="1" * 64,
        law="linear_quadratic",
        correction="none",
        mode=mode,
        seed=11,
        engine="numpy",
        cycle=0.5,
        parameters=mission.entry_state + 1e-3 * draws,
        clipped=np.arange(N) < (0 if mode is Mode.NOMINAL else 3),
        hole=np.zeros(N, dtype=bool),
        status=status,
        final_states=final,
        final_time=np.full(N, FINAL_TIME + 1.0),
        corrections=np.zeros((N, len(CorrectionOutcome)), dtype=np.int64),
        miss=np.hypot(along, across),
        along=along,
        across=across,
        altitude_error=0.01 * across,
        speed_error=np.zeros(N),
        times=times,
        states=np.where(end[:, None], np.nan, states),
        reference_states=np.where(end[:, None], np.nan, reference),
        bank_rate=np.where(end, np.nan, 0.01),
        angle_of_attack=np.where(end, np.nan, 0.0),
        saturation=rng.uniform(0.0, 0.1, N),
        activity=rng.uniform(1.0, 2.0, N),
        limits=limits,
        path=np.where(end[:, None], np.nan, path),
        peak=peak,
        position_tolerance=mission.target.position_tolerance,
        altitude_tolerance=mission.target.altitude_tolerance,
        speed_tolerance=mission.target.speed_tolerance,
        radii=np.array(mission.target.judged_radii),
    )


@pytest.fixture(scope="session")
def campaigns(mission: Mission) -> dict[str, Flights]:
    """Nominal tracking, MPI and AMPI."""
    return {mode.value: campaign(mission, mode) for mode in SCATTER}


def in_a_wrong_world(flights: Flights, law: str) -> Flights:
    """The same draws in a world whose lift is off, which throws flights along the track."""
    lift = 1.0 + 0.05 * np.random.default_rng(3).standard_normal(N)
    numbers = flights.numbers.copy()
    numbers[:, list(BY_NAME).index("lift_factor")] = lift
    along = flights.along + 4e5 * (lift - 1.0)
    return replace(
        flights,
        law=law,
        world="everything",
        world_sha256="f" * 64,
        drawn="lift_factor: normal, 3σ 0.15",
        numbers=numbers,
        along=along,
        miss=np.hypot(along, flights.across),
    )


@pytest.fixture(scope="session")
def many(campaigns: dict[str, Flights]) -> dict[str, Flights]:
    """Two laws in the model's world and in a wrong one, which was flown last."""
    found = {}
    for law in ("linear_quadratic", "drag_sliding_mode"):
        for mode in ("ampi", "nominal"):
            found[f"{law} at home, {mode}"] = replace(campaigns[mode], law=law)
    for law in ("linear_quadratic", "drag_sliding_mode"):
        for mode in ("ampi", "nominal"):
            found[f"{law} abroad, {mode}"] = in_a_wrong_world(campaigns[mode], law)
    return found
