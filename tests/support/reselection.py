"""A table whose states are quadratic in three parameters: of density, of lift, and of an entry speed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.onboard.row_layout import LINEAR_TRACKING
from ampi.onboard.segments import Segments
from ampi.onboard.table import GuidanceTable
from ampi.reselection.known_air import Found
from ampi.reselection.reselecting import ParameterPlan, Reselecting
from ampi.reselection.settings import ReselectionSettings
from ampi.tracking.bank_limiter import BankLimits

Array = NDArray[np.float64]

AXES = (
    np.array([4900.0, 5000.0, 5100.0]),
    np.array([0.85, 1.0, 1.2]),
    np.array([0.95, 1.0, 1.1]),
)
NODES = np.linspace(-1.0, 1.0, 5)
BEGIN = np.array([9e4, 0.0, 1.2, 5000.0, -0.1, -1.5, 0.5])
RATE = np.array([-600.0, -0.002, -0.0005, -40.0, 5e-4, -1e-3, 2e-3])  # /s
PLAN = ParameterPlan(told=(0, None, None), n_told=1, density=1, lift=2)
RADIUS = 6.378e6


class Told:
    """Air that is known: what the test says."""

    def __init__(self, density: float = 1.0, lift: float = 1.0, wind: float = 0.0) -> None:
        self.density, self.lift, self.wind = density, lift, wind

    def begin(self, n: int) -> None:
        self.n = n

    def update(self, time: float, navigated: Array, sensed: Array) -> None: ...

    def found(self) -> Found:
        ones = np.ones(self.n)
        return Found(self.density * ones, self.lift * ones, self.wind * ones, 0.0 * ones)


def state_at(time: float, speed: float, density: float, lift: float) -> Array:
    """State (7,) of the optimum of these parameters, quadratic in each."""
    moved = np.array([400.0, 1e-3, 2e-3, 1.0, 4e-3, 3e-3, 0.1])
    share = time / 100.0
    found = BEGIN + RATE * time + moved * ((density - 1.0) + (lift - 1.0) ** 2) * share
    found = found + moved * (lift - 1.0) * (0.3 - share)
    found[3] += (speed - 5000.0) * (1.0 - 0.5 * share)
    found[0] += 30.0 * (speed - 5000.0) * share
    return found


def quadratic_table() -> GuidanceTable:
    shape = tuple(len(axis) for axis in AXES)
    values = np.zeros((*shape, len(LINEAR_TRACKING), len(NODES)))
    rng = np.random.default_rng(3)
    values[..., LINEAR_TRACKING.bank_rate, :] = 0.01 * rng.standard_normal((*shape, len(NODES)))
    for place in np.ndindex(*shape):
        p = [float(axis[i]) for axis, i in zip(AXES, place, strict=True)]
        for k, node in enumerate(NODES):
            time = 50.0 * (1.0 + float(node))
            values[place][LINEAR_TRACKING.states, k] = state_at(time, *p)
    values[..., LINEAR_TRACKING.gains, :] = np.array([0, 0, 0, 0, 0.5, 0.1, 0.3])[:, None]
    points = np.linspace(-1.0, 1.0, 41)
    conversion = np.ones((5, 41))
    for i in range(5):
        for k in set(range(5)) - {i}:
            conversion[i] *= (points - NODES[k]) / (NODES[i] - NODES[k])
    return GuidanceTable(
        axes=AXES,
        values=values,
        final_time=np.full(shape, 100.0),
        segments=Segments.of([NODES], [(0.0, 0.0)], [(0.0, 0.5)]),
        conversion=conversion,
        high_density_time=(np.zeros(41), 0.5 * (1.0 + points)),
        centre=(1, 1, 1),
    )


def reselecting(table: GuidanceTable, air: Told, **settings: float) -> Reselecting:
    limits = BankLimits(np.radians(60.0), np.radians(5.0), np.radians(4.0))
    guidance = Guidance(table, limits, "quadratic", cycle=0.5)
    own = ReselectionSettings(**settings)
    return Reselecting(guidance, air, PLAN, radius=RADIUS, settings=own)
