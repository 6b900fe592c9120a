"""How far a flight could have gone: its least and its greatest range, by propagation of the truth.

The vehicle flies from its entry to the target speed with the bank angle held: wings level for the
greatest range, at its limit to either side for the least. A target nearer or farther than that is out of
physical reach by bank angle alone, whatever guidance does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ampi.guidance import NATIVE, NUMPY
from ampi.physics.planet import great_circle_distance
from ampi.physics.state import LATITUDE, LONGITUDE
from ampi.simulation.native_loop import fly_held
from ampi.simulation.plant import FlightStatus, InFlight, Plant

Array = NDArray[np.float64]

STEP = (
    2.0  # s: its error is metres, tens of them through noise over altitude; a range is kilometres
)
BANKS = (0.0, 1.0, -1.0)  # of the limit


def ranges(plant: Plant, engine: str = NUMPY) -> tuple[Array, Array]:
    """Least and greatest range (m), (n,) each, of the vehicles of a plant from entry over the ground.

    NaN where it is unknown: of a flight that cannot begin, the greatest of one that wings level meets
    the ground or its time limit, the least of one that does so banked to either side; and of vehicles
    without a schedule of the angle of attack, for none says which angle to hold.
    """
    if plant.is_steered:
        return np.full(len(plant.family), np.nan), np.full(len(plant.family), np.nan)
    n = len(plant.family)
    everyone = plant.take(np.tile(np.arange(n), len(BANKS)))
    flown = _flown(everyone, engine).reshape(len(BANKS), n)
    least, greatest = np.fmin.reduce(flown), np.fmax.reduce(flown)
    least[np.isnan(flown[1:]).all(axis=0)] = np.nan
    greatest[np.isnan(flown[0])] = np.nan
    return least, greatest


def _flown(plant: Plant, engine: str) -> Array:
    """Range (m) of all flights to the target speed, on each of `BANKS` in turn; NaN of who fails."""
    everyone = len(plant.family)
    bank = np.repeat(BANKS, everyone // len(BANKS)) * plant.limits.bank_angle
    finite = np.all(np.isfinite(plant.truth.parameters), axis=1)
    flights, held, time = InFlight.at_entry(plant, bank, finite), np.zeros((2, everyone)), 0.0
    if engine == NATIVE:
        fly_held(plant, flights, STEP)
    while flights.flying.any():
        flights.advance(plant, held, held, time, STEP)
        time += STEP
    entry, end = plant.family.entry_states.T, flights.final.T
    radius = plant.family.flight_model().planet.equatorial_radius
    flown = great_circle_distance(
        entry[LONGITUDE], entry[LATITUDE], end[LONGITUDE], end[LATITUDE], radius
    )
    return np.where(flights.status == int(FlightStatus.REACHED_SPEED), flown, np.nan)
