"""Trajectories, references and flights as `xarray.Dataset`: the names of the files, SI and radians."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import numpy as np
import xarray
from numpy.typing import NDArray

from ampi.onboard.reference import Reference
from ampi.onboard.row_layout import ANGLE_OF_ATTACK, BANK_RATE, STATES, Row, RowKind
from ampi.report.scheme_groups import words
from ampi.simulation.flights import Flights
from ampi.simulation.flights_schema import ATTRIBUTES, FIELDS, FLIGHT, LABELS, SCALES
from ampi.trajectory import Trajectory

STEERED_ROWS = (*STATES, ANGLE_OF_ATTACK)
CONTROL_ROWS = (BANK_RATE, Row("angle_of_attack_rate", "rad/s", RowKind.CONTROL))


@singledispatch
def dataset_of(value: Any) -> xarray.Dataset:
    """A value as a dataset: `units` and `long_name` of every variable, what is one number in `attrs`."""
    raise TypeError(f"value: expected Trajectory, Reference or Flights, got {type(value).__name__}")


@dataset_of.register
def _of_trajectory(optimum: Trajectory) -> xarray.Dataset:
    """Over the nodes, by their times."""
    controls = optimum.controls
    named = (*STEERED_ROWS[: len(optimum.states)], *CONTROL_ROWS[: len(controls)])
    attributes = {
        "final_time": optimum.final_time,
        "cost": optimum.cost,
        "status": optimum.status.name,
        "status_sentence": optimum.status.sentence,
        "iterations": optimum.statistics.iterations,
    }
    return _over_time(named, np.vstack([optimum.states, controls]), optimum.times, attributes)


@dataset_of.register
def _of_reference(reference: Reference) -> xarray.Dataset:
    """Over the points of the high-density grid; a copy, for its arrays are overwritten."""
    attributes = {
        "final_time": reference.final_time,
        "parameters": list(reference.parameters),
        "cell": list(reference.cell),
        "clipped": [int(axis) for axis in reference.clipped],
        "excess": list(reference.excess),
        "hole": int(reference.hole),
        "health": reference.health.name,
        "health_sentence": reference.health.sentence,
    }
    return _over_time(reference.layout.rows, reference.rows, reference.times, attributes)


def _over_time(
    rows: tuple[Row, ...],
    values: NDArray[np.float64],
    times: NDArray[np.float64],
    attributes: dict[str, Any],
) -> xarray.Dataset:
    scale = {"units": "s", "long_name": "time since the entry interface"}
    return xarray.Dataset(
        {
            row.name: ("time", own.copy(), {"units": row.unit, "long_name": words(row.name)})
            for row, own in zip(rows, values, strict=True)
        },
        coords={"time": ("time", times.copy(), scale)},
        attrs=attributes,
    )


@dataset_of.register
def _of_flights(flights: Flights) -> xarray.Dataset:
    """Every array of the campaign, on the dimensions of its file; histories are read whole."""
    scales = {scale: own for own, scale in SCALES.items()}
    known = {**LABELS, FLIGHT: np.arange(flights.n)}
    known["parameter"] = np.arange(flights.parameters.shape[1])
    found = {}
    for name, field in FIELDS.items():
        values = known[name] if name in known else getattr(flights, scales.get(name, name))
        array = np.array(values)  # of a stored history, all of it
        found[name] = (
            field.dimensions,
            array.astype(str) if array.dtype.kind == "S" else array,
            {"units": field.units, "long_name": field.long_name},
        )
    attributes = {name: getattr(flights, name) for name in ATTRIBUTES}
    attributes["mode"] = flights.mode.value
    coords = [name for name, field in FIELDS.items() if field.dimensions == (name,)]
    return xarray.Dataset(
        {name: found[name] for name in found if name not in coords},
        coords={name: found[name] for name in coords},
        attrs=attributes,
    )
