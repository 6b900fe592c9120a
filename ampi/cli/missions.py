"""`ampi missions`: what is shipped."""

from __future__ import annotations

from ampi.cli.console import out


def missions() -> None:
    """List the shipped missions."""
    from ampi.missions.loading import load_mission, shipped_missions

    for name in shipped_missions():
        out.print(f"{name:16} {load_mission(name).title}")


def worlds() -> None:
    """List the shipped worlds: what may be true and is not told."""
    from ampi.simulation.world_loading import load_world, shipped_worlds

    for name in shipped_worlds():
        out.print(f"{name:<16} {load_world(name).title}")
