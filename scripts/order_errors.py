"""Tables of any grid over a box of entry states, and what interpolating them costs.

Points are in halves of the box, x in [−1, 1]^d. A row is what a reference is made of: states (7, n),
bank rate (n,) and final time, flattened.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sparse_grid import axis_of_level, combination

import ampi
from ampi.onboard.interpolation import Interpolator
from ampi.onboard.row_layout import LINEAR_TRACKING
from ampi.onboard.subspace import Order
from ampi.physics.planet import great_circle_distance
from ampi.physics.state import ALTITUDE, BANK, LATITUDE, LONGITUDE, N_STATES, SPEED
from ampi.propagation.adaptive_step import IntegrationError
from ampi.propagation.reintegration import reintegrate_many
from ampi.scp.sensitivities import sensitivities

Array = NDArray[np.float64]

AT_ONCE = 256  # cases of one Newton iteration
LEVELS = 65535.0  # of an int16 column
COLUMNS = (
    "position_m",
    "altitude_m",
    "speed_m_per_s",
    "bank_deg",
    "position_rms_m",
    "altitude_rms_m",
    "speed_rms_m_per_s",
    "bank_rms_deg",
)


class Optima:
    """The optima of a box, each solved once, from the nearest that is known."""

    def __init__(self, mission: ampi.Mission, advance: Callable[[int], None]) -> None:
        self.mission, self.advance = mission, advance
        self.nominal = mission.nominal_parameters
        self.half = np.array([0.5 * np.ptp(axis) for axis in mission.grid_axes])
        self._places = [tuple([0.0] * len(self.half))]
        self._known = {self._places[0]: ampi.solve(mission)}
        self._slopes: dict[tuple[float, ...], Array] = {}

    def rows(self, points: Array) -> Array:
        """(k, 8 n + 1) at points (k, d)."""
        keys = [tuple(np.round(x, 12).tolist()) for x in points]
        new = sorted(set(keys) - set(self._known), key=lambda x: (np.square(x).sum(), x))
        for start in range(0, len(new), AT_ONCE):
            self._solve(new[start : start + AT_ONCE])
        return np.array([_row(self._known[key]) for key in keys])

    def slopes(self, points: Array) -> Array:
        """∂row/∂x (k, d, 8 n + 1)."""
        self.rows(points)
        keys = [tuple(np.round(x, 12).tolist()) for x in points]
        new = [key for key in dict.fromkeys(keys) if key not in self._slopes]
        for start in range(0, len(new), AT_ONCE):
            own = new[start : start + AT_ONCE]
            optima = [self._known[key] for key in own]
            found = sensitivities(self.mission, self.parameters(np.array(own)), optima)
            shape = found.final_time.shape
            parts = (found.states.reshape(*shape, -1), found.bank_rate, found.final_time[..., None])
            slopes = np.concatenate(parts, axis=-1) * self.half[:, None]
            self._slopes |= dict(zip(own, slopes, strict=True))
            self.advance(len(own))
        return np.array([self._slopes[key] for key in keys])

    def parameters(self, points: Array) -> Array:
        """p (k, d) in SI and rad."""
        return np.asarray(self.nominal + self.half * points)

    def _solve(self, new: list[tuple[float, ...]]) -> None:
        points, places = np.array(new), np.array(self._places)
        squares = ((points[:, None] - places) ** 2).sum(axis=-1)
        guesses = [self._known[self._places[k]] for k in np.argmin(squares, axis=1)]
        family = self.mission.family(self.parameters(points))
        found = ampi.solve_family(family, guesses)
        for case, (key, optimum) in enumerate(zip(new, found, strict=True)):
            own = optimum or ampi.solve(family.member(case), guess=guesses[case])
            if not own.status.ok:
                raise SystemExit(f"no optimum at {key} of the box: {own.status.sentence}")
            self._known[key] = own
        self._places += new
        self.advance(len(new))


def _row(optimum: ampi.Trajectory) -> Array:
    return np.concatenate(
        [optimum.states.ravel(), np.ravel(optimum.bank_rate), [optimum.final_time]]
    )


@dataclass(frozen=True, eq=False)
class Table:
    """What is stored, and how it is interpolated."""

    name: str  # the order's
    size: str  # of the grid
    cases: int
    slopes: int  # derivatives stored with each
    at: Callable[[Array], Array]  # rows (k, 8 n + 1) at points (k, d)
    at_int16: Callable[[Array], Array]  # of the table in int16

    def bytes(self, nodes: int, width: int) -> int:
        """Of all rows that fly, gains included, at `width` bytes a number."""
        return width * self.cases * (1 + self.slopes) * (len(LINEAR_TRACKING) * nodes + 1)


def full_table(optima: Optima, points: int, order: Order) -> Table:
    """A full grid of so many points an axis."""
    d = len(optima.half)
    axis = np.linspace(-1.0, 1.0, points)
    grid = np.array(list(product(axis, repeat=d)))
    values = optima.rows(grid)
    slopes = optima.slopes(grid) if order is Order.HERMITE else None
    if slopes is not None and not np.isfinite(slopes).all():
        raise SystemExit(f"an optimum of {points}^{d} has no sensitivities")

    def interpolated(values: Array, slopes: Array | None) -> Callable[[Array], Array]:
        shape = (points,) * d
        shaped = None if slopes is None else slopes.reshape(*shape, d, -1)
        evaluate = Interpolator([axis] * d, values.reshape(*shape, -1), [order] * d, shaped)
        return lambda x: np.array([evaluate(p).copy() for p in x.tolist()])

    coarse = None if slopes is None else as_int16(slopes)
    return Table(
        order.value,
        f"{points}^{d}",
        len(grid),
        0 if slopes is None else d,
        interpolated(values, slopes),
        interpolated(as_int16(values), coarse),
    )


def sparse_table(optima: Optima, level: int, order: Order) -> Table:
    """A sparse grid, its full parts interpolated by an order."""
    d = len(optima.half)
    parts = combination(d, level)
    axes = [[axis_of_level(own) for own in levels] for _, levels in parts]
    grids = [np.array(list(product(*own))) for own in axes]
    union = np.unique(np.concatenate(grids), axis=0)
    places = {tuple(x): k for k, x in enumerate(union.tolist())}
    values = optima.rows(union)

    def combined(values: Array) -> Callable[[Array], Array]:
        evaluate = []
        for (coefficient, _), own, grid in zip(parts, axes, grids, strict=True):
            rows = values[[places[tuple(x)] for x in grid.tolist()]]
            shaped = rows.reshape(*(len(axis) for axis in own), -1)
            evaluate.append((coefficient, Interpolator(own, shaped, [order] * d)))
        return lambda x: np.array([sum(c * one(p) for c, one in evaluate) for p in x.tolist()])

    return Table(
        f"sparse {order.value}",
        f"level {level}",
        len(union),
        0,
        combined(values),
        combined(as_int16(values)),
    )


def as_int16(rows: Array) -> Array:
    """Rows as they come back from int16 with an affine map for each column."""
    low, span = rows.min(axis=0), np.ptp(rows, axis=0)
    step = np.where(span > 0.0, span, 1.0) / LEVELS
    return np.asarray(low + step * np.rint((rows - low) / step))


def errors(optima: Optima, truth: Array, made: Array) -> dict[str, Array]:
    """Of made rows (k, 8 n + 1) against the optima there; each column (k,).

    Greatest and root mean square over the nodes, which are at equal shares of the flight.
    """
    n = optima.mission.pseudospectral_mesh.n_nodes
    own, known = (rows[:, : N_STATES * n].reshape(-1, N_STATES, n) for rows in (made, truth))
    radius = optima.mission.flight_model.planet.equatorial_radius
    places = (own[:, LONGITUDE], own[:, LATITUDE], known[:, LONGITUDE], known[:, LATITUDE])
    altitude = own[:, ALTITUDE] - known[:, ALTITUDE]
    each = (
        np.hypot(great_circle_distance(*places, radius), altitude),
        altitude,
        own[:, SPEED] - known[:, SPEED],
        np.degrees(own[:, BANK] - known[:, BANK]),
    )
    greatest = [np.abs(e).max(axis=1) for e in each]
    mean = [np.sqrt(np.square(e).mean(axis=1)) for e in each]
    return dict(zip(COLUMNS, [*greatest, *mean], strict=True))


def open_loop_miss(optima: Optima, points: Array, made: Array) -> Array:
    """Distance (m) from the target at which made bank angles, flown for their time, end; ∞ if none."""
    mission = optima.mission
    family = mission.family(optima.parameters(points))
    flown, final_time = made[:, : N_STATES * mission.pseudospectral_mesh.n_nodes], made[:, -1]
    flown = flown.reshape(len(made), N_STATES, -1).copy()
    flown[:, :BANK, 0] = family.entry_states
    try:
        mesh = mission.pseudospectral_mesh
        end = reintegrate_many(family, mesh, flown, final_time, np.inf).states[..., -1]
    except IntegrationError:
        if len(points) == 1:
            return np.array([np.inf])
        parts = np.array_split(np.arange(len(points)), 2)
        return np.concatenate([open_loop_miss(optima, points[p], made[p]) for p in parts])
    target, radius = mission.target, mission.flight_model.planet.equatorial_radius
    return np.asarray(
        great_circle_distance(
            end[:, LONGITUDE], end[:, LATITUDE], target.longitude, target.latitude, radius
        )
    )


def measured(
    optima: Optima, tables: Sequence[Table], points: Array, percentile: float
) -> list[dict[str, Any]]:
    """What each table costs: its sizes, and a percentile of each error over the points."""
    truth, nodes = optima.rows(points), optima.mission.pseudospectral_mesh.n_nodes
    found = []
    for table in tables:
        made = table.at(points)
        own, coarse = errors(optima, truth, made), errors(optima, truth, table.at_int16(points))
        own["miss_km"] = open_loop_miss(optima, points, made) / 1e3
        found.append(
            {
                "order": table.name,
                "size": table.size,
                "cases": table.cases,
                "bytes_float64": table.bytes(nodes, 8),
                "bytes_int16": table.bytes(nodes, 2),
                **{c: float(np.percentile(e, percentile)) for c, e in own.items()},
                "int16": {c: float(np.percentile(e, percentile)) for c, e in coarse.items()},
            }
        )
        optima.advance(len(points))
    return found
