"""Tables of words for the page: the grid, what was drawn, and what the campaigns say of themselves."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from ampi.missions.mission import Mission
from ampi.report.dispersed import Dispersed, dispersed
from ampi.report.scheme_groups import by_world, words
from ampi.simulation.flights import Flights

NOT_AN_AXIS = "–"


@dataclass(frozen=True)
class PlainTable:
    """Words in rows, the first cell of each a header."""

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def axes_table(mission: Mission) -> PlainTable:
    """The grid: each parameter, its nominal value and its offsets, in the unit of its key."""
    rows = []
    for parameter in mission.parameters:
        nominal = parameter.number.nominal / parameter.number.per_unit
        offsets = ", ".join(f"{offset:+g}" if offset else "0" for offset in parameter.offsets)
        rows.append((parameter.key, f"{nominal:.9g}", offsets, str(len(parameter.offsets))))
    return PlainTable(("Parameter", "Nominal", "Offsets", "Points"), tuple(rows))


def dispersions_table(mission: Mission, campaigns: Mapping[str, Flights]) -> PlainTable:
    """What came of the draws, number by number, once for worlds that share them."""
    sharing: dict[tuple[str, bytes], tuple[Dispersed, list[str]]] = {}
    worlds = by_world(campaigns)
    for world, flown in worlds.items():
        for flights in flown.values():
            for one in dispersed(mission, flights):
                _, names = sharing.setdefault((one.key, one.values.tobytes()), (one, []))
                names += [world] if world not in names else []
    rows = []
    for one, names in sharing.values():
        drawn = (np.min(one.values), np.mean(one.values), np.max(one.values))
        axis = NOT_AN_AXIS if one.on_axis is None else f"{100.0 * np.mean(one.on_axis):.1f} %"
        where = "all" if len(names) == len(worlds) else ", ".join(names)
        rows.append((one.key, where, *(f"{value:.4g}" for value in drawn), axis))
    heads = ("Worlds", "Least drawn", "Mean drawn", "Greatest drawn", "On the axis")
    return PlainTable(("Number", *heads), tuple(rows))


def drawn_by_world(campaigns: Mapping[str, Flights]) -> dict[str, tuple[str, ...]]:
    """World → what is not nominal in it, a line each."""
    return {
        world: tuple(next(iter(flown.values())).drawn.splitlines())
        for world, flown in by_world(campaigns).items()
    }


def provenance(campaigns: Mapping[str, Flights]) -> dict[str, str]:
    """What the campaigns say of themselves."""

    def each(values: Iterable[object]) -> str:
        return ", ".join(dict.fromkeys(str(value) for value in values))

    flights, worlds = campaigns.values(), by_world(campaigns)
    digests = (f"{w} ({next(iter(f.values())).world_sha256[:12]})" for w, f in worlds.items())
    return {
        "Mission": each(f.mission for f in flights),
        "Flights per campaign": each(f.n for f in flights),
        "Draws": each(f.pool for f in flights),
        "Seed": each(f.seed for f in flights),
        "Guidance cycle": f"{each(f'{f.cycle:.6g}' for f in flights)} s",
        "Engine": each(f.engine for f in flights),
        "Tracking laws": each(words(f.law) for f in flights),
        "Worlds (SHA-256)": each(digests),
    }
