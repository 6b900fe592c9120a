"""Dynamic pressure, stagnation heat flux and load factor, Sagliano et al. 2016, Eq. (4):

    q = ½ ρ V²,   Q̇ = k_q √ρ V^n,   n_z = |L cos α + D sin α| / g₀              (4)

with n = 3 there; the exponent (3.15 in other papers) belongs to the vehicle, and so does the choice
of the load factor: the normal one above, or the total n = √(L² + D²) / g₀ of Liu 2015, Eq. (11).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ampi.physics.equations_of_motion import FlightModel
from ampi.physics.vehicle import air_loads

PATH_CONSTRAINTS = ("dynamic_pressure", "heat_flux", "load_factor")


def path_constraints(model: FlightModel, state: Any, time: Any) -> tuple[Any, Any, Any]:
    """(q in Pa, Q̇ in W/m², n_z in g) at `state` (h, θ, φ, V, γ, ψ, σ; SI, rad) and `time` (s)."""
    altitude, speed = state[0], state[3]
    air = air_loads(model.vehicle, model.atmosphere, altitude, speed, time)
    pressure = 0.5 * air.density * speed * speed
    heat_flux = (
        model.vehicle.heat_flux_constant
        * np.sqrt(air.density)
        * speed**model.vehicle.heat_flux_speed_exponent
    )
    if model.vehicle.load_factor == "total":
        total = np.sqrt(air.lift * air.lift + air.drag * air.drag)
        return pressure, heat_flux, total / model.planet.load_factor_gravity
    normal = air.lift * np.cos(air.angle_of_attack) + air.drag * np.sin(air.angle_of_attack)
    # Entry vehicles fly at positive lift; where they do not, |·| is written as √(·²) so that the
    # expression can be differentiated on either side of zero.
    load_factor = np.sqrt(normal * normal) / model.planet.load_factor_gravity
    return pressure, heat_flux, load_factor
