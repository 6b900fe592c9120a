"""The CSV of nodes: columns by the names of the states, angles in degrees."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ampi.cli.node_table import HEADER, write_nodes
from ampi.pseudospectral.mesh import Mesh, Phase
from ampi.trajectory import Status, Trajectory


def test_columns_are_the_states_in_printed_units(tmp_path: Path) -> None:
    mesh = Mesh((Phase((3,)),))
    states = np.arange(28.0).reshape(7, 4)
    rate = np.array([0.0, 0.1, 0.2, 0.3])
    path = tmp_path / "nodes.csv"
    write_nodes(path, Trajectory(mesh, states, rate, 100.0, 0.0, Status.SOLVED))
    header, *rows = path.read_text(encoding="utf-8").splitlines()
    assert HEADER == (
        "time_s,altitude_m,longitude_deg,latitude_deg,speed_m_per_s,flight_path_angle_deg,"
        "azimuth_deg,bank_angle_deg"
    )
    assert header == f"{HEADER},bank_rate_deg_per_s"
    found = np.array([[float(cell) for cell in row.split(",")] for row in rows]).T
    assert np.allclose(found[[1, 4]], states[[0, 3]], rtol=1e-9)
    assert np.allclose(found[[2, 3, 5, 6, 7]], np.degrees(states[[1, 2, 4, 5, 6]]), rtol=1e-9)
    assert np.allclose(found[8], np.degrees(rate), rtol=1e-9)


def test_a_second_control_has_columns_of_its_own(tmp_path: Path) -> None:
    mesh, path = Mesh((Phase((3,)),)), tmp_path / "nodes.csv"
    states, rates = np.arange(32.0).reshape(8, 4), np.array([[0.0, 0.1, 0.2, 0.3], [0.4] * 4])
    write_nodes(
        path,
        Trajectory(
            mesh, states, rates[0], 100.0, 0.0, Status.SOLVED, angle_of_attack_rate=rates[1]
        ),
    )
    header, first, *_ = path.read_text(encoding="utf-8").splitlines()
    assert header == (
        f"{HEADER},angle_of_attack_deg,bank_rate_deg_per_s,angle_of_attack_rate_deg_per_s"
    )
    assert [float(cell) for cell in first.split(",")[-3:]] == [
        float(f"{np.degrees(value):.10g}") for value in (28.0, 0.0, 0.4)
    ]
