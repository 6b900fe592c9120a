"""The verdict for a terminal: one row per campaign, at most 100 characters wide."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import wrap

from ampi.missions.mission import Mission
from ampi.report.verdict_tables import Cell, Group, VerdictTable, coincident, verdict_tables
from ampi.simulation.flights import Flights

WIDTH = 100
LABEL = 12  # characters of a campaign's name
GAP = 2


def verdict_text(mission: Mission, campaigns: Mapping[str, Flights]) -> str:
    """Every verdict table as aligned text; the paper's rows are marked 2016."""
    lines = [f"{mission.title}: {_flown(campaigns)}"]
    for words in sorted({flights.dispersions.in_words(mission) for flights in campaigns.values()}):
        lines += wrap(f"Offsets from the nominal, {words}", WIDTH, subsequent_indent=" " * GAP)
    lines += coincident(campaigns)
    for table in verdict_tables(mission, campaigns):
        lines += ["", table.title.upper()]
        for group in table.groups:
            lines += _block(table, group)
    return "\n".join(lines)


def _flown(campaigns: Mapping[str, Flights]) -> str:
    """How many flights, of which draws."""
    kinds = sorted({f"{f.n} flights, {f.distribution}, seed {f.seed}" for f in campaigns.values()})
    return f"{'; '.join(kinds)}; {len(campaigns)} campaigns"


def _block(table: VerdictTable, group: Group) -> list[str]:
    """A group, transposed: campaigns down, quantities across."""
    texts = {label: [_text(cell) for cell in group.cells[label]] for label in table.columns}
    widths = [
        max(len(quantity), *(len(row[i]) for row in texts.values()))
        for i, quantity in enumerate(group.quantities)
    ]
    lines = [group.name]
    for part in _parts(widths):
        lines.append(_row("", group.quantities[part], widths[part]))
        lines += [_row(label, row[part], widths[part]) for label, row in texts.items()]
    return lines


def _parts(widths: list[int]) -> list[slice]:
    """Columns side by side, as many as one line holds."""
    parts, start, used = [], 0, LABEL
    for i, width in enumerate(widths):
        if used + GAP + width > WIDTH and i > start:
            parts.append(slice(start, i))
            start, used = i, LABEL
        used += GAP + width
    return [*parts, slice(start, len(widths))]


def _row(label: str, texts: tuple[str, ...] | list[str], widths: list[int]) -> str:
    cut = label if len(label) <= LABEL else label[: LABEL - 1] + "…"
    cells = "".join(f"{' ' * GAP}{t:>{w}}" for t, w in zip(texts, widths, strict=True))
    return f"{cut:<{LABEL}}{cells}"


def _text(cell: Cell) -> str:
    """The percentage where there is one; its sign stands in the group's heading."""
    return cell.interval.replace(" %", "") if cell.interval else cell.value
