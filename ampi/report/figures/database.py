"""The trajectory database in pictures, after Sagliano et al. 2016, Figs. 4–7."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.onboard.table import GuidanceTable
from ampi.physics.state import BANK
from ampi.report.figures.ground_track import (
    TrackBundle,
    draw_ground_tracks,
    draw_target_window,
    map_and_window,
    track_keys,
)
from ampi.report.figures.panels import (
    control_limits,
    draw_angle_bounds,
    draw_bundle,
    draw_quantity_limits,
    limit_key,
    line_key,
    loads,
    panel_grid,
    place_legend,
)
from ampi.report.figures.style import DATABASE_COLOUR, MODE_STYLES, house_style
from ampi.report.quantities import (
    CONTROL_QUANTITIES,
    ENTRY_QUANTITIES,
    Quantity,
)

Array = NDArray[np.float64]

NOMINAL_COLOUR = MODE_STYLES[Mode.NOMINAL].colour


@dataclass(frozen=True, eq=False)
class HighDensityDatabase:
    """Every optimum of a table on the high-density grid; c of them, m points."""

    times: Array  # (c, m), s
    states: Array  # (7, c, m); (8, c, m) where the angle of attack is a control; SI, rad
    bank_rate: Array  # (c, m), rad/s
    nominal: int  # which of them is that of the nominal parameters

    @classmethod
    def of(cls, table: GuidanceTable) -> HighDensityDatabase:
        """Low density to high density, Eqs. (31) and (33), for all cases at once."""
        n = table.conversion.shape[0]
        rows = table.values.reshape(-1, table.values.shape[-2], n)
        fixed, free = table.high_density_time
        own = with_optimum(table)
        centre = int(np.ravel_multi_index(table.centre, table.final_time.shape))
        rows = rows[own]
        return cls(
            times=fixed + free * table.final_time.ravel()[own, None],
            states=(table.layout.flight_states(rows) @ table.conversion).transpose(1, 0, 2),
            bank_rate=rows[:, table.layout.bank_rate] @ table.conversion,
            nominal=int(np.count_nonzero(own[:centre])),
        )


def with_optimum(table: GuidanceTable) -> NDArray[np.bool_]:
    """(c,): grid points with an optimum of their own; a hole holds its neighbour's."""
    if table.solved is None:
        return np.ones(table.final_time.size, dtype=bool)
    return table.solved.ravel()


def table_family(mission: Mission, table: GuidanceTable) -> MissionFamily:
    """The mission at every grid point of a table that has an optimum."""
    points = np.stack(np.meshgrid(*table.axes, indexing="ij"), axis=-1)
    return mission.family(points.reshape(-1, len(table.axes))[with_optimum(table)])


@house_style
def database_states(mission: Mission, table: GuidanceTable) -> Figure:
    """The first six states of every optimum over time [Fig. 4]."""
    database = HighDensityDatabase.of(table)
    figure, panels = panel_grid([q.label for q in ENTRY_QUANTITIES], 2)
    for axes, quantity, values in zip(
        panels, ENTRY_QUANTITIES, database.states[:BANK], strict=True
    ):
        _draw_cases(axes, database, quantity, values)
    place_legend(figure, _keys(database))
    return figure


@house_style
def database_controls(mission: Mission, table: GuidanceTable) -> Figure:
    """Angle of attack, bank angle and bank rate of every optimum, with their limits [Fig. 5]."""
    database = HighDensityDatabase.of(table)
    model = table_family(mission, table).flight_model(trailing=1)
    values = (
        model.angle_of_attack(database.states, database.times),
        database.states[BANK],
        database.bank_rate,
    )
    figure, panels = panel_grid([q.label for q in CONTROL_QUANTITIES], 1)
    limits = control_limits(mission)
    for axes, quantity, value, levels in zip(
        panels, CONTROL_QUANTITIES, values, limits, strict=True
    ):
        _draw_cases(axes, database, quantity, value)
        draw_quantity_limits(axes, quantity, levels)
    if not limits[0]:
        nominal = database.nominal
        draw_angle_bounds(panels[0], mission, database.times[nominal], database.states[:, nominal])
    place_legend(figure, [*_keys(database), limit_key()])
    return figure


@house_style
def database_ground_tracks(mission: Mission, table: GuidanceTable) -> Figure:
    """Ground tracks from the entry points to the target, with a window on the target [Fig. 6]."""
    database = HighDensityDatabase.of(table)
    every = np.arange(len(database.times))
    bundles = [
        _tracks(database, every, DATABASE_COLOUR, width=0.5, alpha=0.3),
        _tracks(database, every[[database.nominal]], NOMINAL_COLOUR, width=2.2, alpha=1.0),
    ]
    figure, chart, window = map_and_window()
    draw_ground_tracks(chart, mission, bundles)
    draw_target_window(window, mission, bundles)
    place_legend(figure, [*_keys(database), *track_keys(mission)])
    return figure


@house_style
def database_constraints(mission: Mission, table: GuidanceTable) -> Figure:
    """The loads on the path of every optimum, with their limits [Fig. 7]."""
    database = HighDensityDatabase.of(table)
    family = table_family(mission, table)
    limits = family.path_limits(trailing=1)
    use = limits.path(family.flight_model(trailing=1), database.states, database.times)
    drawn = loads(mission)
    figure, panels = panel_grid([load.quantity.label for load in drawn], 1)
    for axes, load in zip(panels, drawn, strict=True):
        _draw_cases(axes, database, load.quantity, load.value(use[load.index], limits))
        draw_quantity_limits(axes, load.quantity, [load.limit])
    place_legend(figure, [*_keys(database), limit_key()])
    return figure


def _draw_cases(
    axes: Axes, database: HighDensityDatabase, quantity: Quantity, values: Array
) -> None:
    shown = quantity.shown(values)
    draw_bundle(axes, database.times, shown, DATABASE_COLOUR)
    nominal = database.nominal
    axes.plot(database.times[nominal], shown[nominal], color=NOMINAL_COLOUR, linewidth=2.2)


def _tracks(
    database: HighDensityDatabase,
    cases: NDArray[np.intp],
    colour: str,
    *,
    width: float,
    alpha: float,
) -> TrackBundle:
    longitude, latitude = database.states[1, cases], database.states[2, cases]
    return TrackBundle(
        longitude=longitude,
        latitude=latitude,
        final=np.stack([longitude[:, -1], latitude[:, -1]], axis=1),
        colour=colour,
        marker="o",
        width=width,
        alpha=alpha,
    )


def _keys(database: HighDensityDatabase) -> list[Line2D]:
    return [
        line_key(f"{len(database.times)} optimal trajectories", DATABASE_COLOUR),
        line_key("nominal", NOMINAL_COLOUR),
    ]
