"""The report: one HTML file with its figures inside; it needs no network and no scripts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np
from jinja2 import Environment, StrictUndefined

from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.onboard.table import GuidanceTable
from ampi.outputs import written
from ampi.report.exhibits import Exhibit, campaign_exhibits, database_exhibits
from ampi.report.figures.database import with_optimum
from ampi.report.figures.style import data_uri, image_bytes
from ampi.report.published import is_of_the_paper, is_shipped
from ampi.report.quantities import DEGREES, KILO
from ampi.report.verdict_tables import coincident, verdict_tables
from ampi.simulation.flights import Flights

TEMPLATE = "report.html.j2"

MODE_SENTENCES = {
    Mode.NOMINAL: "tracks the optimum of the nominal entry, whatever the entry state",
    Mode.MPI: "interpolates multilinearly between the outer vertices of the hypercube",
    Mode.AMPI: "interpolates multilinearly inside the cell of the grid that holds the entry state",
    Mode.QUADRATIC: "interpolates quadratically, with three points per axis of the same table",
}


@dataclass(frozen=True)
class Picture:
    """A drawn exhibit, ready to embed."""

    name: str
    title: str
    caption: str
    alternative: str
    source: str  # data: URI


def write_report(
    path: str | Path,
    mission: Mission,
    table: GuidanceTable,
    campaigns: Mapping[str, Flights],
    extra: Mapping[str, str],
    notices: Sequence[str] = (),
    audit: Mapping[str, str] | None = None,
) -> Path:
    """Write the report of a database and its campaigns.

    Parameters
    ----------
    path
        The HTML file; its folder must exist.
    mission, table
        What was flown, and from which table.
    campaigns
        Name → flights; each name becomes a column.
    extra
        Provenance: versions, git revision, database file, date.
    notices
        What speaks against the database, a sentence each; they stand first on the page.
    audit
        What is known of the database, a line each: solved cases, re-integration, coherence.

    Returns
    -------
    Path
        The file written.
    """
    if not campaigns:
        raise ValueError("campaigns: expected at least one campaign of flights, got none")
    of_the_paper = is_of_the_paper(mission)
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    text = resources.files("ampi.report").joinpath(TEMPLATE).read_text(encoding="utf-8")
    page = environment.from_string(text).render(
        title=f"{mission.title}: entry guidance by pseudospectral interpolation",
        statement=mission_statement(mission, table),
        surrogate=is_shipped(mission) and "surrogate" in mission.title.lower(),
        compared_with_paper=of_the_paper,
        provenance={**_draws(campaigns), **extra},
        notices=notices,
        modes={name: MODE_SENTENCES[f.mode] for name, f in campaigns.items()},
        coincident=coincident(campaigns),
        tables=verdict_tables(mission, campaigns),
        axes=axes_table(mission),
        dispersions=dispersions_table(mission, campaigns),
        audit=audit or {},
        campaign_pictures=_drawn(campaign_exhibits(mission, campaigns), of_the_paper),
        database_pictures=_drawn(database_exhibits(mission, table), of_the_paper),
    )
    target = Path(path)
    with written(target) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return target


def mission_statement(mission: Mission, table: GuidanceTable) -> str:
    """The mission in two sentences, from its own numbers."""
    entry, target = mission.entry, mission.target
    optima = int(np.count_nonzero(with_optimum(table)))
    return (
        f"A vehicle of {mission.vehicle.mass:g} kg enters at {entry.altitude * KILO:.1f} km and "
        f"{entry.speed:.0f} m/s with a flight-path angle of "
        f"{entry.flight_path_angle * DEGREES:.2f}° and shall arrive at "
        f"{target.latitude * DEGREES:.2f}° latitude, {target.longitude * DEGREES:.2f}° longitude, "
        f"{target.altitude * KILO:.1f} km altitude with {target.speed:.0f} m/s, steered by bank "
        f"angle alone. Guidance interpolates {optima} optimal trajectories, stored "
        f"at {table.conversion.shape[0]} nodes each, over {len(table.axes)} parameters."
    )


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
    """The law and what came of it, as offsets from the nominal value; once for campaigns that share."""
    sharing: dict[bytes, list[str]] = {}
    for name, flights in campaigns.items():
        sharing.setdefault(flights.parameters.tobytes(), []).append(name)
    rows: list[tuple[str, ...]] = []
    for names in sharing.values():
        flights = campaigns[names[0]]
        law = flights.dispersions
        centre = law.centre or (0.0,) * len(law.half_widths)
        for i, parameter in enumerate(mission.parameters):
            own = parameter.number
            drawn = (flights.parameters[:, i] - own.nominal) / own.per_unit
            inside = (drawn >= parameter.offsets[0]) & (drawn <= parameter.offsets[-1])
            numbers = (
                centre[i] / own.per_unit,
                law.half_widths[i] / own.per_unit,
                *(drawn.min(), drawn.mean(), drawn.max()),
            )
            label = parameter.key if len(sharing) == 1 else f"{parameter.key}: {', '.join(names)}"
            share = f"{100.0 * float(np.mean(inside)):.1f} %"
            rows.append((label, law.distribution, *(f"{n:.4g}" for n in numbers), share))
    heads = ("Centre", "Half width", "Least drawn", "Mean drawn", "Greatest drawn", "On the axis")
    return PlainTable(("Parameter", "Distribution", *heads), tuple(rows))


def _draws(campaigns: Mapping[str, Flights]) -> dict[str, str]:
    """Provenance that the campaigns carry themselves."""

    def each(values: Iterable[object]) -> str:
        return ", ".join(dict.fromkeys(str(value) for value in values))

    flights = campaigns.values()
    return {
        "Mission": each(f.mission for f in flights),
        "Flights per campaign": each(f.n for f in flights),
        "Seed": each(f.seed for f in flights),
    }


def _drawn(exhibits: tuple[Exhibit, ...], of_the_paper: bool) -> list[Picture]:
    """Draw one after the other: a figure of a thousand curves is dropped once it is an image."""
    return [
        Picture(
            e.name,
            e.title,
            f"{e.caption} After {e.after} of the paper." if of_the_paper and e.after else e.caption,
            e.alternative,
            data_uri(image_bytes(e.draw(), e.image_format), e.image_format),
        )
        for e in exhibits
    ]
