"""Worlds and tables of the air that tests are made with."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ampi.simulation.world import World
from ampi.simulation.world_loading import parse_world

HEAD = 'name = "w"\ntitle = "W"\n[entry]\ndistribution = "normal"\n'


def world(body: str = "", *, head: str = HEAD, folder: Path | None = None) -> World:
    """A world of some tables beside normal entry states."""
    return parse_world(head + body, "w.toml", folder=folder)


def of_entries(distribution: str) -> World:
    """A world in which the parameters of the mission alone are drawn: uniform, corners, …"""
    return world(head=HEAD.replace("normal", distribution))


def write_draws(path: Path, days: range = range(1, 366, 30), top: int = 130) -> Path:
    """A synthetic table of draws: its density factor and winds name the row."""
    altitudes = range(0, top + 1, 5)
    columns = [
        f"{name}_{z}km" for name in ("density", "wind_east", "wind_north") for z in altitudes
    ]
    rows = []
    for i, day in enumerate(days):
        density = np.exp(0.01 * i * np.sin(np.array(altitudes) / 20.0))
        wind = np.concatenate(
            [np.full(len(altitudes), float(i)), np.full(len(altitudes), -2.0 * i)]
        )
        rows.append([day, 12, 150, 4, *density, *wind])
    lines = [",".join(["day_of_year", "hour", "f107", "ap", *columns])]
    lines += [",".join(repr(float(value)) for value in row) for row in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
