"""Dynamic pressure, stagnation heat flux and load factor, Sagliano et al. 2016, Eq. (4):

    q = ½ ρ V²,   Q̇ = k_q √ρ V^n,   n_z = |L cos α + D sin α| / g₀              (4)

with n = 3 there; the exponent (3.15 in other papers) belongs to the vehicle, and so do a polynomial in
α that may multiply the heat flux (Betts 2010, Section 6.1) and the choice of the load factor: the normal
one above, or the total n = √(L² + D²) / g₀ of Liu 2015, Eq. (11). V is the speed through the air.

A no-fly zone is a circle on the sphere, at any latitude and across any meridian, 1 on its edge:

    g = 2 − hav d / hav ρ ≤ 1,   hav x = sin²(x/2),                                 (5)

with d the angle to its centre and ρ = radius / R₀. Liu 2015, Eq. (71), has d² = Δθ² + Δφ² in its place,
a circle in the chart: at latitude φ it is narrower on the ground by cos φ, and a zone of 100 km at 76°
would let pass what is 24 km from its centre.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ampi.physics.equations_of_motion import FlightModel
from ampi.physics.planet import haversine
from ampi.physics.vehicle import AirLoads


def path_constraints(
    model: FlightModel, state: Any, time: Any, air: AirLoads | None = None
) -> tuple[Any, Any, Any]:
    """(q in Pa, Q̇ in W/m², n_z in g) at `state` (h, θ, φ, V, γ, ψ, σ; SI, rad) and `time` (s).

    `air` are the model's air loads there, if they are known.
    """
    air = air or model.air_loads(state, time)
    pressure = 0.5 * air.density * air.speed * air.speed
    heat_flux = (
        model.vehicle.heat_flux_constant
        * np.sqrt(air.density)
        * air.speed**model.vehicle.heat_flux_speed_exponent
    )
    coefficients = model.vehicle.heat_flux_angle_coefficients
    if coefficients is not None:
        degrees = air.angle_of_attack * (180.0 / np.pi)
        heat_flux = heat_flux * sum(c * degrees**k for k, c in enumerate(coefficients))
    if model.vehicle.load_factor == "total":
        total = np.sqrt(air.lift * air.lift + air.drag * air.drag)
        return pressure, heat_flux, total / model.planet.load_factor_gravity
    normal = air.lift * np.cos(air.angle_of_attack) + air.drag * np.sin(air.angle_of_attack)
    # Entry vehicles fly at positive lift; where they do not, |·| is written as √(·²) so that the
    # expression can be differentiated on either side of zero.
    load_factor = np.sqrt(normal * normal) / model.planet.load_factor_gravity
    return pressure, heat_flux, load_factor


def no_fly_zone(longitude: Any, latitude: Any, zone: tuple[float, float, float]) -> Any:
    """g of Eq. (5) at a point (rad); `zone` is longitude and latitude of its centre, and ρ (rad)."""
    away = haversine(longitude, latitude, zone[0], zone[1])
    return 2.0 - away / np.sin(0.5 * zone[2]) ** 2
