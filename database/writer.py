"""The single writer: from case records to one HDF5 file, with provenance."""

from __future__ import annotations

import json
import platform
import subprocess
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ampi.dataset import SCHEMA_VERSION, write_dataset
from ampi.missions.mission import Mission
from ampi.physics.equations_of_motion import STATES
from ampi.physics.path_constraints import PATH_CONSTRAINTS
from ampi.pseudospectral.mesh import Mesh
from ampi.scp.exact_hessian import SolverSettings
from ampi.simulation.reintegration import reintegrate_many
from database.gains import GainSettings, vertex_gains
from database.grid import Grid
from database.jobs import CaseRecord

Array = NDArray[np.float64]

HIGH_DENSITY_INTERVALS = 600
CHUNK = 81  # cases whose gains and re-integration are computed together: bounds memory
MESSAGE_BYTES = 400


def high_density_times(mesh: Mesh, nominal_final_time: float) -> tuple[Array, Array]:
    """(a, b) of the high-density times: uniform in each phase, about equal steps at nominal t_f.

    Phase boundaries are high-density points, so no interval holds a kink.
    """
    ends = [0.0, *(p.end for p in mesh.phases if p.end is not None), nominal_final_time]
    lengths = np.diff(ends)
    counts = np.maximum(1, np.round(HIGH_DENSITY_INTERVALS * lengths / lengths.sum())).astype(int)
    counts[-1] += HIGH_DENSITY_INTERVALS - counts.sum()
    fixed, free = [np.zeros(1)], [np.zeros(1)]
    for begin, length, count in zip(ends[:-2], lengths[:-1], counts[:-1], strict=True):
        fixed.append(begin + length * np.arange(1, count + 1) / count)
        free.append(np.zeros(count))
    fraction = np.arange(1, counts[-1] + 1) / counts[-1]
    fixed.append(ends[-2] * (1.0 - fraction))
    free.append(fraction)
    return np.concatenate(fixed), np.concatenate(free)


def write_database(
    path: Path, mission: Mission, grid: Grid, records: list[CaseRecord], settings: GainSettings
) -> dict[str, Array]:
    """Gains, re-integration and everything else into `path`; returns what the report needs."""
    mesh = mission.pseudospectral_mesh
    n, cases = mesh.n_nodes, grid.size
    states = np.stack([r.trajectory.states for r in records])
    rate = np.stack([r.trajectory.bank_rate for r in records])
    final_time = np.array([r.trajectory.final_time for r in records])
    status = np.array([int(r.trajectory.status) for r in records])
    good = np.array([r.trajectory.status.ok for r in records])
    for array in (states, rate, final_time):
        array[~good] = np.nan
    gains = np.full((cases, 7, n), np.nan)
    errors = {k: np.full(cases, np.nan) for k in ("position", "altitude", "speed")}
    peak = np.full((cases, 3), np.nan)
    solved = np.flatnonzero(good)
    for chunk in np.array_split(solved, max(1, -(-len(solved) // CHUNK))):
        if len(chunk) == 0:
            continue
        family = mission.family([grid.point(int(case)) for case in chunk])
        gains[chunk] = vertex_gains(family, mesh, states[chunk], final_time[chunk], settings)
        check = reintegrate_many(family, mesh, states[chunk], final_time[chunk])
        errors["position"][chunk] = check.position_error
        errors["altitude"][chunk] = check.altitude_error
        errors["speed"][chunk] = check.speed_error
        peak[chunk] = check.peak
    nominal = final_time[np.ravel_multi_index(grid.centre, grid.shape)]
    # without a nominal solution the file still records every failure; it cannot fly
    typical = float(nominal) if np.isfinite(nominal) else 2.0 * (mesh.node_time[0].max() + 1.0)
    fixed, free = high_density_times(mesh, typical)
    conversion = mesh.conversion(fixed + free * typical, typical).T
    shape = grid.shape
    values = {
        "states": states.reshape(*shape, 7, n),
        "bank_rate": rate.reshape(*shape, n),
        "gains": gains.reshape(*shape, 7, n),
        "final_time": final_time.reshape(shape),
        "cost": np.array([r.trajectory.cost for r in records]).reshape(shape),
        "status": status.reshape(shape),
        "iterations": np.array([r.trajectory.statistics.iterations for r in records]).reshape(
            shape
        ),
        "position_error": errors["position"].reshape(shape),
        "altitude_error": errors["altitude"].reshape(shape),
        "speed_error": errors["speed"].reshape(shape),
        "peak": peak.reshape(*shape, 3),
        "message": np.array(
            [r.message.encode("utf-8")[:MESSAGE_BYTES] for r in records], dtype=f"S{MESSAGE_BYTES}"
        ).reshape(shape),
        "node_time": np.stack(mesh.node_time),
        "high_density_time": np.stack([fixed, free]),
        "ld_to_hd": np.ascontiguousarray(conversion),
    }
    write_dataset(
        path,
        names=grid.names,
        axes=grid.axes,
        axis_units=grid.units,
        scales={
            "state": np.array(STATES, dtype="S20"),
            "limit": np.array(PATH_CONSTRAINTS, dtype="S20"),
            "affine": np.array(["a", "b"], dtype="S1"),
            "node": np.arange(n),
            "high_density": np.arange(len(fixed)),
        },
        values=values,
        attributes=provenance(mission, grid, settings),
    )
    return {"position_error": errors["position"], "peak": peak}


def provenance(mission: Mission, grid: Grid, settings: GainSettings) -> dict[str, object]:
    """Root attributes: enough to build the file again. Nothing depends on host or clock."""
    attributes: dict[str, object] = {
        "schema_version": SCHEMA_VERSION,
        "title": f"Trajectory database of {mission.title}",
        "mission": mission.name,
        "mission_toml": mission.toml,
        "parameters": np.array(grid.names, dtype=object),
        "bank_rate_effort": mission.objective.bank_rate_effort,
        "mesh": json.dumps([asdict(p) for p in mission.pseudospectral_mesh.phases]),
        "solver_settings": json.dumps(asdict(SolverSettings()), sort_keys=True),
        "gain_settings": json.dumps(asdict(settings), sort_keys=True),
        "ampi_version": package_version("ampi"),
        "git_revision": git_revision(),
        "python_version": platform.python_version(),
    }
    for package in ("numpy", "scipy", "casadi", "clarabel", "h5py"):
        attributes[f"{package}_version"] = package_version(package)
    return attributes


def package_version(name: str) -> str:
    """Installed version of a package, or 'unknown'."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"


def git_revision() -> str:
    """Revision of the checkout that this file lies in, or 'unknown' (an installed wheel)."""
    try:
        return subprocess.run(
            ["git", "rev-parse", "HEAD"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
