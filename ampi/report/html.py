"""The report: one HTML file with its figures inside; it needs no network and no scripts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.onboard.table import GuidanceTable
from ampi.outputs import written
from ampi.report.board import board
from ampi.report.exhibits import Exhibit, campaign_exhibits, database_exhibits
from ampi.report.figures.database import with_optimum
from ampi.report.figures.style import data_uri, image_bytes
from ampi.report.plain_tables import axes_table, dispersions_table, drawn_by_world, provenance
from ampi.report.published import PAPER_LAW, is_of_the_paper, is_shipped
from ampi.report.quantities import DEGREES, KILO
from ampi.report.scheme_exhibits import first_exhibit, scheme_exhibits, wrong_world_exhibits
from ampi.report.scheme_groups import (
    UNCORRECTED,
    SchemeGroup,
    differs_from_model,
    scheme_groups,
    words,
)
from ampi.report.schemes_table import schemes_table
from ampi.report.verdict_tables import (
    VerdictTable,
    coincident,
    is_like_the_paper,
    verdict_tables,
)
from ampi.simulation.flights import Flights

TEMPLATE = "report.html.j2"

MODE_SENTENCES = {
    Mode.NOMINAL: "tracks the optimum of the nominal entry, whatever the entry state",
    Mode.MPI: "interpolates multilinearly between the outer vertices of the hypercube",
    Mode.AMPI: "interpolates multilinearly inside the cell of the grid that holds the entry state",
    Mode.NEAREST: "tracks the optimum of the grid point nearest to the entry state",
    Mode.QUADRATIC: "interpolates quadratically, with three points per axis of the same table",
    Mode.CUBIC: "interpolates cubically, with four points per axis of the same table",
    Mode.SECOND_DIFFERENCES: "corrects the multilinear reference of AMPI by second differences along "
    "each axis",
    Mode.HERMITE: "corrects the multilinear reference of AMPI by stored sensitivities to the"
    " entry state",
}
CORRECTED = "corrects the plan in flight, from what the vehicle senses, by a predictor-corrector"


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
        Name → flights, of any laws, references and worlds.
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
    environment = Environment(
        loader=PackageLoader("ampi.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    page = environment.get_template(TEMPLATE).render(
        **_content(mission, table, campaigns),
        provenance={**provenance(campaigns), **extra},
        notices=notices,
        audit=audit or {},
    )
    target = Path(path)
    with written(target) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return target


def _content(
    mission: Mission, table: GuidanceTable, campaigns: Mapping[str, Flights]
) -> dict[str, Any]:
    """What the template shows of the database and the flights, by its names there."""
    of_the_paper = is_of_the_paper(mission)
    groups = scheme_groups(campaigns)
    wrong = wrong_world_exhibits(mission, campaigns)
    all_wrong = all(map(differs_from_model, campaigns.values()))
    modelled = () if wrong and all_wrong else campaign_exhibits(mission, campaigns)
    return {
        "title": f"{mission.title}: entry guidance by pseudospectral interpolation",
        "statement": mission_statement(mission, table),
        "surrogate": is_shipped(mission) and "surrogate" in mission.title.lower(),
        "compared_with_paper": any(is_like_the_paper(mission, g.campaigns) for g in groups),
        "other_tracker": PAPER_LAW not in {flights.law for flights in campaigns.values()},
        "board": board(mission, campaigns),
        "first_pictures": _drawn((first_exhibit(campaigns),), of_the_paper),
        "modes": _sentences(groups),
        "coincident": coincident(campaigns),
        "schemes": schemes_table(campaigns),
        "scheme_pictures": _drawn(scheme_exhibits(mission, campaigns), of_the_paper),
        "details": _details(mission, groups),
        "axes": axes_table(mission),
        "dispersions": dispersions_table(mission, campaigns),
        "drawn": drawn_by_world(campaigns),
        "wrong_pictures": _drawn(wrong, of_the_paper),
        "campaign_pictures": _drawn(modelled, of_the_paper),
        "database_pictures": _drawn(database_exhibits(mission, table), of_the_paper),
    }


def _sentences(groups: Sequence[SchemeGroup]) -> dict[str, str]:
    """What each reference is, by its label, and what corrects it."""
    found = {
        label: MODE_SENTENCES[flights.mode]
        for group in groups
        for label, flights in group.campaigns.items()
    }
    for group in groups:
        if group.correction != UNCORRECTED:
            found[f"corrected by {words(group.correction)}"] = CORRECTED
    return found


def _details(
    mission: Mission, groups: Sequence[SchemeGroup]
) -> dict[str, tuple[VerdictTable, ...]]:
    """Heading → tables, a group each; of one group no heading."""
    return {
        group.title if len(groups) > 1 else "": verdict_tables(mission, group.campaigns)
        for group in groups
    }


def mission_statement(mission: Mission, table: GuidanceTable) -> str:
    """The mission in two sentences, from its own numbers."""
    entry, target = mission.entry, mission.target
    optima = int(np.count_nonzero(with_optimum(table)))
    steered = "by bank angle alone" if mission.angle_of_attack is None else "by both angles"
    return (
        f"A vehicle of {mission.vehicle.mass:g} kg enters at {entry.altitude * KILO:.1f} km and "
        f"{entry.speed:.0f} m/s with a flight-path angle of "
        f"{entry.flight_path_angle * DEGREES:.2f}° and shall arrive at "
        f"{target.latitude * DEGREES:.2f}° latitude, {target.longitude * DEGREES:.2f}° longitude, "
        f"{target.altitude * KILO:.1f} km altitude with {target.speed:.0f} m/s. Guidance "
        f"interpolates {optima} optimal trajectories, steered {steered} and stored at "
        f"{table.conversion.shape[0]} nodes each, over {len(table.axes)} parameters."
    )


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
