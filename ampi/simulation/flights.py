"""A Monte-Carlo campaign as data: what was true, what was flown, what came of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.reference import Mode
from ampi.physics.state import N_STATES
from ampi.shown import PLOTS, Tabulated, asked_for
from ampi.simulation.estimates.failures import Reach, classify, skipped
from ampi.simulation.plant import FlightStatus
from ampi.simulation.profiles import ALTITUDES
from ampi.simulation.tolerances import ENDS, Tolerances
from ampi.simulation.truth import Truth
from ampi.simulation.uncertainties import BY_NAME

Array = NDArray[np.float64]

DENSITY, WIND = "density", "wind"  # profiles over altitude that a world may have
SKIP = 0.8  # of the entry altitude [X]: who rises above it again has left the air that steers


@dataclass(frozen=True, eq=False)
class Flights(Tabulated):
    """Flights of one scheme in one world: n flights, k recorded points (NaN after a flight's end)."""

    mission: str
    mission_sha256: str
    guidance_sha256: str  # of table, limits, law and correction
    law: str  # that tracks
    correction: str  # by what plans are corrected in flight: none, bank or bank_and_angle
    mode: Mode  # of the reference
    world: str
    world_sha256: str
    world_toml: str
    drawn: str  # what is not nominal in that world, a line each
    profiles: (
        str  # which profiles over altitude the world has: "", "density", "wind", "density wind"
    )
    seed: int
    pool: str  # of draws: reported or tuning
    cycle: float  # s, of guidance
    engine: str  # that computed them: native or numpy
    numbers: Array  # (n, u): every uncertainty of the catalogue as it is true, SI
    density: Array  # (n, a): factor on the mission's density over altitude; 1 if the world has none
    wind: Array  # (n, 2, a), m/s: east and north; 0 if the world has none
    seeds: NDArray[np.uint64]  # (n,), of the sensors' noise
    parameters: Array  # (n, d), as they are; SI, rad
    clipped: NDArray[np.bool_]  # (n,), outside the hypercube
    hole: NDArray[np.bool_]  # (n,), their reference is borrowed from beside an unsolved case
    status: NDArray[np.int64]  # (n,), FlightStatus
    final_states: Array  # (n, 7), where the speed reached its target
    final_time: Array  # (n,), s
    corrections: NDArray[np.int64]  # (n, outcomes): how often each CorrectionOutcome has come
    miss: Array  # (n,), m: great-circle distance to the target
    along: Array  # (n,), m: miss along the nominal ground track, positive beyond the target
    across: Array  # (n,), m: miss across it, positive to the right
    altitude_error: Array  # (n,), m
    speed_error: Array  # (n,), m/s
    saturation: Array  # (n,), share of the cycles with bank angle or bank rate at its limit
    activity: Array  # (n,), rad: ∫ |σ̇| dt
    rebound: Array  # (n,), m: highest altitude after the first descent; NaN if it never rose
    distance: Array  # (n,), m: of the target at entry
    least_range: Array  # (n,), m, by propagation; NaN: unknown, of flights that passed
    greatest_range: Array  # (n,), m
    times: Array  # (k,), s
    states: Array  # (n, 7, k)
    reference_states: Array  # (n, 7, k)
    bank_rate: Array  # (n, k), rad/s
    angle_of_attack: Array  # (n, k), rad: change against the schedule
    limits: tuple[str, ...]  # (l,), names of the limits that a flight is to keep
    path: Array  # (n, l, k): their use, over the limit
    peak: Array  # (n, l): its greatest values, read at every plant step
    position_tolerance: float  # m, of the mission; infinite where its position is free
    altitude_tolerance: float  # m
    speed_tolerance: float  # m/s
    entry_altitude: float  # m, nominal
    radii: Array  # (r,), m: within which the verdict counts flights

    def __post_init__(self) -> None:
        n, d, k = len(self.miss), self.parameters.shape[-1], len(self.times)
        limits, a = len(self.limits), len(ALTITUDES)
        of_flights = ("clipped", "hole", "status", "seeds", "final_time", "miss", "along", "across")
        counted = ("saturation", "activity", "rebound", "distance", "least_range", "greatest_range")
        shapes: dict[str, tuple[int, ...]] = {
            "parameters": (n, d),
            "numbers": (n, len(BY_NAME)),
            "density": (n, a),
            "wind": (n, 2, a),
            **dict.fromkeys((*of_flights, *counted, "altitude_error", "speed_error"), (n,)),
            "final_states": (n, N_STATES),
            "times": (k,),
            **dict.fromkeys(("states", "reference_states"), (n, N_STATES, k)),
            **dict.fromkeys(("bank_rate", "angle_of_attack"), (n, k)),
            "path": (n, limits, k),
            "peak": (n, limits),
            "radii": (len(self.radii),),
        }
        kinds = {"clipped": "b", "hole": "b", "status": "i", "seeds": "u"}
        for name, shape in shapes.items():
            array, kind = getattr(self, name), kinds.get(name, "f")
            if array.shape != shape or array.dtype.kind != kind:
                raise ValueError(
                    f"flights.{name}: expected an array of shape {shape} and kind {kind!r}, got "
                    f"{array.shape} and {array.dtype.kind!r}"
                )
        self._check_values()

    def _check_values(self) -> None:
        if not np.all(np.isin(self.status, list(FlightStatus))):
            raise ValueError("flights.status: expected members of FlightStatus")
        ended = ("final_states", "final_time", "miss", "along", "across", "altitude_error")
        for name in (*ended, "speed_error", "peak"):
            if not np.all(np.isfinite(getattr(self, name)[self.reached])):
                raise ValueError(
                    f"flights.{name}: expected finite numbers of every flight that reached its speed"
                )
        if not np.all(np.diff(self.times) > 0.0) or not np.all(np.diff(self.radii, prepend=0) > 0):
            raise ValueError("flights: expected times, and radii above 0, that increase strictly")
        tolerances = (self.position_tolerance, self.altitude_tolerance, self.speed_tolerance)
        if not all(tolerance > 0.0 for tolerance in tolerances):
            raise ValueError("flights: expected positive tolerances")

    @property
    def plot(self) -> Any:
        """Its figures: `flights.plot.footprint()` (`ampi.report.notebook.plots.FlightsPlots`)."""
        return asked_for(PLOTS, "plot").FlightsPlots(self)

    @property
    def n(self) -> int:
        """Number of flights."""
        return len(self.miss)

    @property
    def truth(self) -> Truth:
        """What was true of the flights: with it they can be flown again."""
        return self.truth_of(slice(None))

    def truth_of(self, flights: Any) -> Truth:
        """That of some of them, indices or a slice: of the others no profile is read from the file."""
        profiles, numbers = self.profiles.split(), np.ascontiguousarray(self.numbers[flights].T)
        wind = np.ascontiguousarray(self.wind[flights].swapaxes(0, 1)) if WIND in profiles else None
        return Truth(
            self.parameters[flights],
            dict(zip(BY_NAME, numbers, strict=True)),
            ALTITUDES,
            self.density[flights] if DENSITY in profiles else None,
            wind,
            self.seeds[flights],
        )

    @property
    def reached(self) -> NDArray[np.bool_]:
        """Flights that ended at the target speed; the others count as outside every circle."""
        return self.status == int(FlightStatus.REACHED_SPEED)

    @property
    def faults(self) -> dict[str, NDArray[np.bool_]]:
        """What flights have not passed by: reason → (n,). One may have several; NaN is no pass."""
        tolerances = Tolerances(
            self.position_tolerance, self.altitude_tolerance, self.speed_tolerance
        )
        return tolerances.faults(vars(self), self.limits)

    @property
    def passed(self) -> NDArray[np.bool_]:
        """(n,): reached the target speed within every tolerance of the mission, and kept every limit."""
        return ~np.any(list(self.faults.values()), axis=0)

    @cached_property
    def failures(self) -> NDArray[np.int64]:
        """(n,): the one `FailureClass` of each flight."""
        altitude = SKIP * self.entry_altitude
        return classify(
            self.status,
            self.passed,
            ~np.any([self.faults[name] for name in ENDS], axis=0),
            skipped=skipped(self.rebound, self.status, altitude, self.entry_altitude),
            reach=Reach(self.distance, self.least_range, self.greatest_range),
        )
