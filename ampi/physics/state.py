"""The states of the equations of motion: their order, and what the equations know of it.

    x = (h, θ, φ, V, γ, ψ, σ)      m, rad, rad, m/s, rad, rad, rad

Two of the seven are quadratures: no state enters σ̇ = u, and the longitude enters no rate.
"""

from __future__ import annotations

N_STATES = 7
LONGITUDE = 1  # feeds back into no rate: the planet and its air are the same all around
BANK = 6  # its rate is the control, whatever the states
CORE = (0, 2, 3, 4, 5)  # what lies between the two in the equations of motion
N_CORE = len(CORE)
