"""One self-contained page of a database: `explore`.

The page holds the table (`packed_table`), the physics as JavaScript (`page_physics`), the flight code
as WebAssembly (`wasm/flight.c`), coast lines (`coast`), and flights if there are some (`page_flights`).
What is too large for a page is left out, and said (`small_table`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from html import escape
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.correction.onboard_correction import NO_AXIS
from ampi.dataset import TrajectoryDataset
from ampi.explorer.coast import land
from ampi.explorer.packed_table import PackedTable, deflated, text_of
from ampi.explorer.page_flights import few_of, shown_flights
from ampi.explorer.page_physics import PagePhysics
from ampi.explorer.small_table import SmallTable, fitting
from ampi.export.blob import table_blob
from ampi.export.model_blob import model_blob
from ampi.guidance import Guidance
from ampi.loading import guidance_of
from ampi.missions.mission import Mission
from ampi.missions.parameters import Parameter
from ampi.missions.path_limits import PathLimits
from ampi.missions.units import symbol
from ampi.onboard.reference import Mode
from ampi.onboard.table import GuidanceTable
from ampi.onboard_model import correction_of
from ampi.physics.state import AZIMUTH, LATITUDE, LONGITUDE
from ampi.simulation.flights import Flights

Array = NDArray[np.float64]

MODES = {
    Mode.NOMINAL: "nominal",
    Mode.MPI: "MPI",
    Mode.AMPI: "AMPI",
    Mode.QUADRATIC: "AMPI, quadratic",
}
OUTSIDE = 0.2  # of an axis' range, that sliders go beyond it
ROOM = 0.15  # of the map's window around all tracks
ENGINE = ("table.js", "flight.js", "engine.js")
VIEW = ("chart.js", "ground.js", "controls.js", "cloud.js", "results.js", "page.js")


def explore(dataset: TrajectoryDataset, campaigns: Mapping[str, Flights] | None = None) -> str:
    """The page of a database, as HTML.

    Parameters
    ----------
    dataset
        From `ampi.dataset.read_dataset`; holes are flown from beside, and flagged.
    campaigns
        Flights of the same mission, to be shown with their ellipses.

    Raises
    ------
    ValueError
        If the flights are of another mission, the angle of attack is a control, or the table is too
        large whatever is left out of it.
    """
    mission = dataset.mission
    if mission.angle_of_attack is not None:
        raise ValueError(
            f"{mission.name}: expected a schedule of the angle of attack, which the page flies, got "
            "one that is steered ([angle_of_attack])"
        )
    guidance = guidance_of(dataset, holes="fly", engine="numpy")
    small = fitting(guidance.table, [parameter.name for parameter in mission.parameters])
    correction, without = _correction(mission, small)
    physics = PagePhysics.of(mission)
    data = {
        "shown": {
            **_shown(mission, small),
            "flights": _flights(mission, guidance, small, campaigns),
            "left_out": [*small.left_out, *without, *_too_many(campaigns)],
        },
        "limits": list(PathLimits.of(mission).names),
        "units": _units(mission)[small.axes].tolist(),
        "nominal": mission.nominal_parameters[small.axes].tolist(),
        "radius": mission.flight_model.planet.equatorial_radius,
        "physics": {"base": physics.base.tolist(), "slope": physics.slope[:, small.axes].tolist()},
        **_tables(guidance, small),
        "model": correction,
        "code": deflated(files(__package__).joinpath("wasm/flight.wasm").read_bytes()),
    }
    return _assembled(mission.title, data, physics.source)


def _assembled(title: str, data: Mapping[str, Any], physics: str) -> str:
    # no text of a mission or a campaign ends the script that it stands in
    numbers = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    parts = {
        "{{title}}": escape(title),
        "/*STYLE*/": _text("style.css"),
        "/*DATA*/": f"const DATA = {numbers};",
        "/*ENGINE*/": physics + "\n".join(map(_text, ENGINE)),
        "/*VIEW*/": "\n".join(map(_text, VIEW)),
    }
    page = _text("page.html")
    for mark, content in parts.items():
        page = page.replace(mark, content)
    return page


def _text(name: str) -> str:
    return files(__package__).joinpath("page", name).read_text("utf-8")


def _tables(guidance: Guidance, small: SmallTable) -> dict[str, Any]:
    """Values, and what else stands in the blob of each mode: its own part, and what all share."""
    table, own = small.table, small.axes
    limit_axes = {k: own.index(i) for k, i in guidance.limit_axes.items() if i in own}
    packed, heads, holes = PackedTable.of(table), [], []
    grid = np.arange(table.final_time.size).reshape(table.final_time.shape)
    chosen = {
        Mode.NOMINAL: [int(grid[table.centre])],
        Mode.MPI: grid[np.ix_(*([0, len(axis) - 1] for axis in table.axes))].reshape(-1).tolist(),
    }
    for mode in MODES:
        blob = table_blob(
            table,
            guidance.law,
            guidance.limits,
            modulation=guidance.modulation,
            angles=guidance.angles,
            mode=mode,
            limit_axes=limit_axes,
        )
        vertices = chosen.get(mode, grid.reshape(-1))
        rest = 0 if table.solved is None else -(-len(vertices) // 8) * 8
        heads.append(blob[: len(blob) - rest - 8 * len(vertices) * packed.shape[-1]])
        holes.append(blob[len(blob) - rest :])
    shared = 8 * min(_alike(heads[0], head) for head in heads)
    return {
        "table": packed.as_json(),
        "ranges": [*np.ptp(_rows(table), axis=1).tolist(), float(np.ptp(table.final_time)) or 1.0],
        "shared": deflated(heads[0][len(heads[0]) - shared :]),
        "modes": [
            {
                "head": deflated(head[: len(head) - shared]),
                "vertices": chosen.get(mode),
                "holes": text_of(own_holes),
            }
            for mode, head, own_holes in zip(MODES, heads, holes, strict=True)
        ],
    }


def _alike(one: bytes, other: bytes) -> int:
    """How many last words of eight bytes are the same."""
    length = min(len(one), len(other)) // 8
    ends = [np.frombuffer(part[len(part) - 8 * length :], "<u8")[::-1] for part in (one, other)]
    differ = np.flatnonzero(ends[0] != ends[1])
    return int(differ[0]) if len(differ) else length


def _rows(table: GuidanceTable) -> Array:
    return np.moveaxis(table.values, -2, 0).reshape(len(table.layout), -1)


def _shown(mission: Mission, small: SmallTable) -> dict[str, Any]:
    target, limits = mission.target, PathLimits.of(mission)
    parameters = [mission.parameters[i] for i in small.axes]
    window = _window(_rows(small.table)[LONGITUDE], _rows(small.table)[LATITUDE])
    return {
        "title": mission.title,
        "mission": mission.name,
        "target": {
            "altitude": target.altitude,
            "longitude": float(np.degrees(target.longitude)),
            "latitude": float(np.degrees(target.latitude)),
            "speed": target.speed,
            "radii": [radius / 1e3 for radius in target.judged_radii],
        },
        "parameters": [
            _parameter(parameter, axis)
            for parameter, axis in zip(parameters, small.table.axes, strict=True)
        ],
        "modes": [{"name": mode.value, "label": label} for mode, label in MODES.items()],
        "limits": [{"name": name, "label": name.replace("_", " ")} for name in limits.names],
        "window": window,
        "coast": [np.round(ring, 3).tolist() for ring in land(window)],
    }


def _parameter(parameter: Parameter, axis: Array) -> dict[str, Any]:
    per_unit = parameter.number.per_unit
    points, range_ = axis / per_unit, np.ptp(axis) / per_unit
    return {
        "name": parameter.name,
        "label": parameter.name.replace("_", " ").replace(".", " "),
        "unit": symbol(parameter.number.key[len(parameter.number.name) + 1 :]),
        "digits": int(np.clip(np.ceil(2.0 - np.log10(range_)), 0, 6)),
        "points": points.tolist(),
        "nominal": parameter.number.nominal / per_unit,
        "low": float(points[0] - OUTSIDE * range_),
        "high": float(points[-1] + OUTSIDE * range_),
    }


def _units(mission: Mission) -> Array:
    """SI per shown unit of each parameter."""
    return np.array([parameter.number.per_unit for parameter in mission.parameters])


def _window(longitude: Array, latitude: Array) -> dict[str, float]:
    """Degrees around all tracks, with some room."""
    west, east = np.degrees([longitude.min(), longitude.max()])
    south, north = np.degrees([latitude.min(), latitude.max()])
    x, y = ROOM * max(east - west, 1.0), ROOM * max(north - south, 1.0)
    return {
        "west": float(west - x),
        "east": float(east + x),
        "south": float(max(south - y, -90.0)),
        "north": float(min(north + y, 90.0)),
    }


def _correction(mission: Mission, small: SmallTable) -> tuple[str | None, list[str]]:
    """The model that corrects plans, for the flight code; or why there is none."""
    try:
        moves = mission.limits.angle_of_attack_change is not None
        correction = correction_of(mission, angle_of_attack=moves)
        axes = tuple(
            small.axes.index(axis) if axis in small.axes else NO_AXIS
            for axis in correction.target_axes
        )
        return deflated(model_blob(replace(correction, target_axes=axes))), []
    except ValueError as error:
        return None, [f"no corrected flight: {error}"]


def _flights(
    mission: Mission,
    guidance: Guidance,
    small: SmallTable,
    campaigns: Mapping[str, Flights] | None,
) -> dict[str, Any] | None:
    if not campaigns:
        return None
    nominal = guidance.in_mode(Mode.NOMINAL).reference(mission.nominal_parameters)
    found = shown_flights(mission, campaigns, _units(mission), float(nominal.states[AZIMUTH, -1]))
    for campaign in found["campaigns"]:
        campaign["parameters"] = [[row[i] for i in small.axes] for row in campaign["parameters"]]
    return found


def _too_many(campaigns: Mapping[str, Flights] | None) -> list[str]:
    shown = few_of(campaigns or {})
    return [
        f"{label}: all but the first {shown} of {flights.n} flights; ellipses and shares are of all"
        for label, flights in (campaigns or {}).items()
        if flights.n > shown
    ]
