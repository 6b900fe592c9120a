"""Three flight models that between them use every atmosphere, aerodynamics and schedule."""

from __future__ import annotations

import numpy as np
import pytest

from ampi.missions import load_mission
from ampi.physics.aerodynamics import PolynomialDragPolar, TabulatedAerodynamics
from ampi.physics.atmosphere import ExponentialAtmosphere, StandardAtmosphere1976
from ampi.physics.equations_of_motion import FlightModel
from ampi.physics.planet import WGS84, Planet
from ampi.physics.vehicle import AngleOfAttackSchedule, Vehicle

# Phillips (2003); rows: angle of attack 10°, 15°, 20°.
CAVH_MACH = (3.5, 5.0, 8.0, 10.0, 15.0, 20.0, 23.0)
CAVH_LIFT = (
    (0.450, 0.425, 0.400, 0.380, 0.370, 0.360, 0.350),
    (0.740, 0.700, 0.670, 0.630, 0.600, 0.570, 0.557),
    (1.050, 1.000, 0.950, 0.900, 0.850, 0.800, 0.780),
)
CAVH_DRAG = (
    (0.2045, 0.170, 0.129, 0.109, 0.109, 0.109, 0.109),
    (0.296, 0.263, 0.224, 0.197, 0.195, 0.192, 0.192),
    (0.477, 0.423, 0.354, 0.310, 0.305, 0.300, 0.300),
)


@pytest.fixture(scope="session")
def cavh_table() -> TabulatedAerodynamics:
    """The CAV-H table of shared/missions.md."""
    return TabulatedAerodynamics(
        angle_of_attack=tuple(np.radians([10.0, 15.0, 20.0]).tolist()),
        mach=CAVH_MACH,
        lift=CAVH_LIFT,
        drag=CAVH_DRAG,
    )


def _cavh(table: TabulatedAerodynamics) -> FlightModel:
    """CAV-H in US76, angle of attack over speed, heat flux with exponent 3.15."""
    vehicle = Vehicle(
        mass=907.2,
        reference_area=0.4839,
        aerodynamics=table,
        angle_of_attack=AngleOfAttackSchedule(
            variable="speed",
            start=5000.0,
            end=6500.0,
            start_angle=np.radians(11.0),
            end_angle=np.radians(19.0),
        ),
        heat_flux_constant=5.24e-5,
        heat_flux_speed_exponent=3.15,
    )
    return FlightModel(WGS84, StandardAtmosphere1976(), vehicle)


def _rlv() -> FlightModel:
    """Lu's polynomials on a sphere that does not rotate, exponential atmosphere."""
    planet = Planet(
        equatorial_radius=6_378_137.0,
        gravitational_parameter=9.81 * 6_378_137.0**2,
        j2=0.0,
        rotation_rate=0.0,
        load_factor_gravity=9.81,
    )
    vehicle = Vehicle(
        mass=104_305.0,
        reference_area=391.22,
        aerodynamics=PolynomialDragPolar(
            lift=(-0.041065, 0.016292, 0.0002602), drag=(0.080505, -0.03026, 0.86495)
        ),
        angle_of_attack=AngleOfAttackSchedule(
            variable="speed",
            start=2000.0,
            end=5000.0,
            start_angle=np.radians(15.0),
            end_angle=np.radians(40.0),
        ),
        heat_flux_constant=1.65e-4,
        heat_flux_speed_exponent=3.15,
    )
    atmosphere = ExponentialAtmosphere(
        surface_density=1.225, scale_height=7110.0, surface_gravity=9.80665
    )
    return FlightModel(planet, atmosphere, vehicle)


@pytest.fixture(scope="session", params=["shefex3", "cavh", "rlv"])
def model(request: pytest.FixtureRequest, cavh_table: TabulatedAerodynamics) -> FlightModel:
    """Each of the three models in turn."""
    if request.param == "shefex3":
        return load_mission("shefex3").flight_model
    return _cavh(cavh_table) if request.param == "cavh" else _rlv()
