"""Flights of a world on a table that is re-selected in flight; by the estimate, or by one who knows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.onboard_model import flight_model_of
from ampi.reselection.known_air import Found
from ampi.reselection.settings import ReselectionSettings
from ampi.reselection_loading import load_reselecting
from ampi.simulation.closed_loop import FlightBatch, fly_batch
from ampi.simulation.truth import Truth
from ampi.simulation.world import World

Array = NDArray[np.float64]

CYCLE = 0.1  # s
FLOWN_THROUGH = (25e3, 55e3)  # m, over which the mean of a density profile is the density


class TrueAir:
    """The truth as a table knows it: constant factors, and a share of the wind where the vehicle is."""

    def __init__(self, mission: Mission, truth: Truth, settings: ReselectionSettings) -> None:
        numbers, model = truth.numbers, flight_model_of(mission)
        angle = model.angle_of_attack.end_angle
        nominal = np.array(model.aerodynamics.coefficients(angle, None))[:, None]
        error = numbers["angle_of_attack_error"]
        lift, drag = np.array(model.aerodynamics.coefficients(angle + error, None)) / nominal
        drag, lift = drag * numbers["drag_factor"], lift * numbers["lift_factor"]
        density = numbers["density_factor"] / numbers["mass_factor"]
        if truth.density is not None:
            low, high = FLOWN_THROUGH
            there = (truth.altitudes > low) & (truth.altitudes < high)
            density = density * np.ascontiguousarray(truth.density[:, there]).mean(axis=1)
        self.density, self.lift, self._truth = density * drag, lift / drag, truth
        self._wind, self._share = np.zeros((2, len(truth))), settings.wind

    def begin(self, n: int) -> None:
        """As many as the truth has."""
        self._wind = np.zeros((2, n))

    def update(self, time: float, navigated: Array, sensed: Array) -> None:
        """The wind at the told altitude."""
        altitudes, wind = self._truth.altitudes, self._truth.wind
        if wind is not None:
            for flight, altitude in enumerate(navigated[0]):
                for row in range(2):
                    told = np.interp(altitude, altitudes, wind[row, flight])
                    self._wind[row, flight] = self._share * told

    def found(self) -> Found:
        """The truth."""
        return Found(self.density, self.lift, *self._wind)


@dataclass(frozen=True, eq=False)
class ReselectedFlights:
    """n flights, and how often each of the k outcomes of a re-selection has come."""

    batch: FlightBatch
    outcomes: NDArray[np.int64]  # (n, k), of `Reselection`
    factors: Array  # (n, 2): the true ones of density and lift


def fly_reselecting(
    mission: Mission,
    path: str | Path,
    world: World,
    n: int,
    *,
    seed: int = 1,
    pool: str = "reported",
    first: int = 0,
    mode: Mode | str = Mode.AMPI,
    known: bool = False,
    cycle: float = CYCLE,
    settings: ReselectionSettings | None = None,
) -> ReselectedFlights:
    """Fly draws first … first + n − 1 of a world of `mission` by a database with more axes.

    The draws are those that a campaign of the mission flies.

    Parameters
    ----------
    path
        Database with axes of density and lift.
    known
        Whether factors and wind are told as they are, instead of estimated.
    cycle
        Of guidance (s).

    Raises
    ------
    WorldError, DatasetError, ValueError
        If the world, the database, or both together are no such thing.
    """
    truth = world.checked(mission).draw(mission, n, seed=seed, pool=pool, first=first)
    own = ReselectionSettings() if settings is None else settings
    true_air = TrueAir(mission, truth, own)
    road = load_reselecting(
        path,
        mission,
        mode=mode,
        cycle=cycle,
        settings=own,
        air=true_air if known else None,
    )
    # a loop asks of a guidance no more than this one has
    batch = fly_batch(mission.family(truth.parameters), cast(Guidance, road), truth)
    factors = np.stack([true_air.density, true_air.lift], axis=1)
    return ReselectedFlights(batch, road.counts.T.copy(), factors)
