"""States, control and loads: their names, units and order, written once.

    x = (h, θ, φ, V, γ, ψ, σ),   u = σ̇,   loads (q, Q̇, n_z)

Two of the seven states are quadratures: no state enters σ̇ = u, and the longitude enters no rate.

Where the angle of attack is a control, it is an eighth state, as the bank angle is the seventh:

    x = (h, θ, φ, V, γ, ψ, σ, α),   u = (σ̇, α̇).

So a state has as many controls as it has entries from `BANK` on, and each is the rate of its angle.
"""

from __future__ import annotations

STATES = (
    "altitude",
    "longitude",
    "latitude",
    "speed",
    "flight_path_angle",
    "azimuth",
    "bank_angle",
)
STATE_UNITS = ("m", "rad", "rad", "m/s", "rad", "rad", "rad")
N_STATES = len(STATES)
ALTITUDE, LONGITUDE, LATITUDE, SPEED, FLIGHT_PATH_ANGLE, AZIMUTH, BANK = range(N_STATES)
CIRCULAR_STATES = (LONGITUDE, AZIMUTH, BANK)  # the same modulo a turn
ENTRY_STATES = STATES[:BANK]  # what an entry interface fixes: the bank angle there is free
# BANK: its rate is the control, whatever the states. LONGITUDE feeds back into no rate: the planet and
# its air are the same all around. What lies between the two in the equations of motion:
CORE = (ALTITUDE, LATITUDE, SPEED, FLIGHT_PATH_ANGLE, AZIMUTH)
N_CORE = len(CORE)

CONTROLS = ("bank_rate",)
CONTROL_UNITS = ("rad/s",)

ANGLE_OF_ATTACK = N_STATES  # the eighth
STEERED_STATES = (*STATES, "angle_of_attack")  # where the angle of attack is a control
STEERED_UNITS = (*STATE_UNITS, "rad")
STEERING = (*CONTROLS, "angle_of_attack_rate")

LOADS = ("dynamic_pressure", "heat_flux", "load_factor")
