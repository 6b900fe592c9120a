"""The flight code, compiled once, and tables small enough to try everything on."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.loading import segments_of
from ampi.onboard.row_layout import DRAG_TRACKING
from ampi.onboard.table import GuidanceTable
from ampi.pseudospectral.mesh import Mesh, Phase
from ampi.tracking.angle_limiter import AngleRange, ModulationLimits
from ampi.tracking.bank_limiter import BankLimits
from ampi.tracking.drag_shuttle import DragShuttle
from ampi.tracking.drag_sliding_mode import DragSlidingMode
from ampi.tracking.law import TrackingLaw
from ampi.tracking.linear_quadratic import LinearQuadratic
from tests.support.flight_code import COMPILER, compiled

Array = NDArray[np.float64]
LawMaker = Callable[..., Guidance]

MESH = Mesh((Phase((3,), 30.0), Phase((6, 4))))
MU, RADIUS = 3.986004418e14, 6.378137e6
LIMITS = BankLimits(1.2, 0.15, 0.08)
MODULATION, ANGLES = ModulationLimits(0.08, 0.09, 0.07), AngleRange(0.2, 0.75, 0.02)
LAWS: dict[str, TrackingLaw] = {
    "linear_quadratic": LinearQuadratic(),
    "drag_shuttle": DragShuttle(gravitational_parameter=MU, radius=RADIUS),
    "drag_sliding_mode": DragSlidingMode(gravitational_parameter=MU, radius=RADIUS),
    # those that change the angle of attack, too
    "linear_steered": LinearQuadratic(modulates=True),
    "shuttle_steered": DragShuttle(gravitational_parameter=MU, radius=RADIUS, modulates=True),
    "sliding_steered": DragSlidingMode(gravitational_parameter=MU, radius=RADIUS, modulates=True),
}


@pytest.fixture(scope="session")
def code(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    if COMPILER is None:
        pytest.skip("NO C COMPILER: the flight code is not tested here")
    return compiled(tmp_path_factory.mktemp("flight_code"))


def descent(law: TrackingLaw, share: Array, p: Array) -> Array:
    """Rows (r, …) of a made-up entry at a share of its time, for parameters p (3, …)."""
    bank = 0.9 * np.cos(5.0 * share + p[0]) - 0.2
    altitude = 1e5 - 7e4 * share + 400.0 * p[1] * share * (1.0 - share)
    speed = 7500.0 - 5500.0 * share**2 + 20.0 * p[2]
    rows = [
        altitude,
        0.05 * share + 0.01 * p[0],
        0.9 - 0.08 * share,
        speed,
        -0.03 - 0.2 * share,
        3.1 + 0.1 * share,
        bank,
        -0.02 * np.sin(5.0 * share + p[0]),
    ]
    if law.layout != DRAG_TRACKING:
        sizes = [1e4, 1.0, 1.0, 3e2, 0.2, 1.0, 0.5] * (1 + law.modulates)
        rows += [0.02 / size * np.cos(3.0 * share + k + p[1]) for k, size in enumerate(sizes)]
    else:
        rows += [
            -8.0 + 11.0 * share + 0.1 * p[2],
            0.5 + 0.1 * share,
            7000.0 + 0.0 * share,
            1.0 - 0.95 * share,
            5e5 * (1.0 - share),
        ]
    return np.stack(np.broadcast_arrays(*rows))


def entry_table(
    law: TrackingLaw,
    shape: tuple[int, ...] = (4, 3, 2),
    mesh: Mesh = MESH,
    points: int = 71,
    *,
    is_steered: bool = False,
) -> GuidanceTable:
    """`descent` over three axes, the first of longitudes, the last of bank limits.

    With `is_steered` of a vehicle without a schedule of the angle of attack.
    """
    axes = (
        np.linspace(-0.3, 0.4, shape[0]) ** 3 + 3.0,
        np.cumsum(np.linspace(1.0, 1.7, shape[1])),
        np.linspace(0.8, 1.2, shape[2]),
    )
    grid = np.stack(np.meshgrid(*axes, indexing="ij"))[..., None]
    final_time = 300.0 + 20.0 * grid[0, ..., 0] + np.sin(grid[1, ..., 0])
    fixed, free = mesh.node_time
    share = (fixed + free * final_time[..., None]) / final_time[..., None]
    fraction = np.linspace(0.0, 1.0, points)
    point_fixed = np.concatenate([np.linspace(0.0, 30.0, 11)[:-1], 30.0 * (1.0 - fraction)])
    point_free = np.concatenate([np.zeros(10), fraction])
    rows = np.moveaxis(descent(law, share, grid), 0, -2)
    if is_steered:
        angle = 0.7 - 0.4 * share + 0.05 * np.sin(9.0 * share)
        rows = np.concatenate([rows, angle[..., None, :]], axis=-2)
    return GuidanceTable(
        axes=axes,
        values=np.ascontiguousarray(rows),
        final_time=final_time,
        segments=segments_of(mesh),
        conversion=np.ascontiguousarray(mesh.conversion(point_fixed + point_free * 300.0, 300.0).T),
        high_density_time=(point_fixed, point_free),
        centre=tuple(n // 2 for n in shape),
        circular=(0,),
        layout=law.layout.with_angle_of_attack if is_steered else law.layout,
    )


@pytest.fixture(scope="session")
def entry() -> LawMaker:
    """Guidance of a law on `entry_table`, with settings of one's own."""

    def make(
        law: str = "linear_quadratic", is_steered: bool = False, **settings: object
    ) -> Guidance:
        table, own = entry_table(LAWS[law], is_steered=is_steered), LAWS[law]
        if is_steered:
            settings = {"angles": ANGLES, **settings}
        return Guidance(table, LIMITS, law=own, modulation=MODULATION, engine="numpy", **settings)

    return make
