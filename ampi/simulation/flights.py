"""A Monte-Carlo campaign as data: what was drawn, what was flown, what came of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.missions.path_limits import KEPT
from ampi.onboard.reference import Mode
from ampi.physics.state import N_STATES
from ampi.simulation.closed_loop import FlightStatus
from ampi.simulation.dispersions import Dispersions, Distribution

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Flights:
    """A campaign in one guidance mode: n flights, k recorded points (NaN after a flight's end)."""

    mission: str
    mission_sha256: str
    mode: Mode
    seed: int
    cycle: float  # s, of guidance
    distribution: Distribution
    half_widths: Array  # (d,), of the dispersions; SI, rad
    centre: Array  # (d,), of the dispersions, as offset from the nominal p
    parameters: Array  # (n, d), as drawn; SI, rad
    clipped: NDArray[np.bool_]  # (n,), outside the hypercube
    hole: NDArray[np.bool_]  # (n,), their reference is borrowed from beside an unsolved case
    status: NDArray[np.int64]  # (n,), FlightStatus
    final_states: Array  # (n, 7), where the speed reached its target
    final_time: Array  # (n,), s
    miss: Array  # (n,), m: great-circle distance to the target
    along: Array  # (n,), m: miss along the nominal ground track, positive beyond the target
    across: Array  # (n,), m: miss across it, positive to the right
    altitude_error: Array  # (n,), m
    speed_error: Array  # (n,), m/s
    times: Array  # (k,), s
    states: Array  # (n, 7, k)
    reference_states: Array  # (n, 7, k)
    bank_rate: Array  # (n, k), rad/s
    limits: tuple[str, ...]  # (l,), names of the limits that a flight is to keep
    path: Array  # (n, l, k): their use, over the limit
    peak: Array  # (n, l): its greatest values, read at every guidance cycle
    position_tolerance: float  # m, of the mission; infinite where its position is free
    altitude_tolerance: float  # m
    speed_tolerance: float  # m/s
    radii: Array  # (r,), m: within which the verdict counts flights

    def __post_init__(self) -> None:
        n, d, k = len(self.miss), self.parameters.shape[-1], len(self.times)
        limits = len(self.limits)
        shapes: dict[str, tuple[int, ...]] = {
            "parameters": (n, d),
            **dict.fromkeys(("half_widths", "centre"), (d,)),
            **dict.fromkeys(
                ("clipped", "hole", "status", "final_time", "miss", "along", "across"), (n,)
            ),
            **dict.fromkeys(("altitude_error", "speed_error"), (n,)),
            "final_states": (n, N_STATES),
            "times": (k,),
            **dict.fromkeys(("states", "reference_states"), (n, N_STATES, k)),
            "bank_rate": (n, k),
            "path": (n, limits, k),
            "peak": (n, limits),
            "radii": (len(self.radii),),
        }
        kinds = {"clipped": "b", "hole": "b", "status": "i"}
        for name, shape in shapes.items():
            array, kind = getattr(self, name), kinds.get(name, "f")
            if array.shape != shape or array.dtype.kind != kind:
                raise ValueError(
                    f"flights.{name}: expected an array of shape {shape} and kind {kind!r}, got "
                    f"{array.shape} and {array.dtype.kind!r}"
                )
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
    def n(self) -> int:
        """Number of flights."""
        return len(self.miss)

    @property
    def dispersions(self) -> Dispersions:
        """What the parameters were drawn from."""
        return Dispersions(tuple(self.half_widths), self.distribution, tuple(self.centre))

    @property
    def reached(self) -> NDArray[np.bool_]:
        """Flights that ended at the target speed; the others count as outside every circle."""
        return self.status == int(FlightStatus.REACHED_SPEED)

    @property
    def faults(self) -> dict[str, NDArray[np.bool_]]:
        """What flights have not passed by: reason → (n,). One may have several; NaN is no pass."""
        return {
            "target_speed_not_reached": ~self.reached,
            "position": ~(self.miss <= self.position_tolerance),
            "altitude": ~(np.abs(self.altitude_error) <= self.altitude_tolerance),
            "speed": ~(np.abs(self.speed_error) <= self.speed_tolerance),
            **{name: ~(self.peak[:, i] <= 1.0 + KEPT) for i, name in enumerate(self.limits)},
        }

    @property
    def passed(self) -> NDArray[np.bool_]:
        """(n,): reached the target speed within every tolerance of the mission, and kept every limit."""
        return ~np.any(list(self.faults.values()), axis=0)
