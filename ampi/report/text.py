"""The verdict for a terminal: one row per campaign, at most 100 characters wide."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import wrap

from ampi.missions.mission import Mission
from ampi.report.cells import Cell, Group
from ampi.report.scheme_groups import by_world, scheme_groups
from ampi.report.schemes_table import SchemesTable, schemes_table
from ampi.report.verdict_tables import VerdictTable, coincident, verdict_tables
from ampi.simulation.flights import Flights

WIDTH = 100
LABEL = 12  # characters of a campaign's name
LONGEST_LABEL = 24  # of a scheme
GAP = 2


def verdict_text(mission: Mission, campaigns: Mapping[str, Flights]) -> str:
    """The schemes, then every verdict table, as aligned text; the paper's rows are marked 2016."""
    lines = [f"{mission.title}: {_flown(campaigns)}"]
    for world, flown in by_world(campaigns).items():
        drawn = "; ".join(next(iter(flown.values())).drawn.splitlines())
        lines += wrap(f"World {world}: {drawn}", WIDTH, subsequent_indent=" " * GAP)
    for sentence in coincident(campaigns):
        lines += wrap(sentence, WIDTH, subsequent_indent=" " * GAP)
    lines += _schemes(schemes_table(campaigns))
    groups = scheme_groups(campaigns)
    for of in groups:
        if len(groups) > 1:
            lines += ["", f"=== {of.title} "[: WIDTH - 4].ljust(WIDTH, "=")]
        for table in verdict_tables(mission, of.campaigns):
            lines += ["", table.title.upper()]
            for group in table.groups:
                lines += _block(table, group)
    return "\n".join(lines)


def _flown(campaigns: Mapping[str, Flights]) -> str:
    """How many flights, of which draws."""
    kinds = {
        f"{f.n} flights, {f.pool} draws of seed {f.seed}, {1.0 / f.cycle:.4g} Hz, {f.engine}"
        for f in campaigns.values()
    }
    return f"{'; '.join(sorted(kinds))}; {len(campaigns)} campaigns"


def _schemes(table: SchemesTable) -> list[str]:
    """Worlds and laws down, and the references of each; group by group."""
    labels = {k: " " * GAP + label for own in table.rows.values() for k, label in own.items()}
    room = min(max(LABEL, *map(len, labels.values())), LONGEST_LABEL)
    lines = ["", table.title.upper()]
    for group in table.groups:
        texts = {k: [f"{c.value} {c.interval}".strip() for c in group.cells[k]] for k in labels}
        widths = _widths(group, texts)
        lines.append(f"{group.name} [95 % interval]" if _has_intervals(group) else group.name)
        for part in _parts(widths, room):
            lines.append(_row("", group.quantities[part], widths[part], room))
            for title, own in table.rows.items():
                lines.append(title)
                lines += [_row(labels[k], texts[k][part], widths[part], room) for k in own]
    return [*lines, *wrap(table.note, WIDTH)]


def _has_intervals(group: Group) -> bool:
    return any(cell.interval for row in group.cells.values() for cell in row)


def _block(table: VerdictTable, group: Group) -> list[str]:
    """A group, transposed: campaigns down, quantities across."""
    texts = {label: [_text(cell) for cell in group.cells[label]] for label in table.columns}
    widths = _widths(group, texts)
    lines = [group.name]
    for part in _parts(widths, LABEL):
        lines.append(_row("", group.quantities[part], widths[part], LABEL))
        lines += [_row(label, row[part], widths[part], LABEL) for label, row in texts.items()]
    return lines


def _widths(group: Group, texts: Mapping[str, list[str]]) -> list[int]:
    return [
        max(len(quantity), *(len(row[i]) for row in texts.values()))
        for i, quantity in enumerate(group.quantities)
    ]


def _parts(widths: list[int], label: int) -> list[slice]:
    """Columns side by side, as many as one line holds beside a label."""
    parts, start, used = [], 0, label
    for i, width in enumerate(widths):
        if used + GAP + width > WIDTH and i > start:
            parts.append(slice(start, i))
            start, used = i, label
        used += GAP + width
    return [*parts, slice(start, len(widths))]


def _row(label: str, texts: tuple[str, ...] | list[str], widths: list[int], room: int) -> str:
    cut = label if len(label) <= room else label[: room - 1] + "…"
    cells = "".join(f"{' ' * GAP}{t:>{w}}" for t, w in zip(texts, widths, strict=True))
    return f"{cut:<{room}}{cells}"


def _text(cell: Cell) -> str:
    """The percentage of a count, whose sign stands in the group's heading; else the number."""
    if cell.interval.startswith("["):
        return f"{cell.value} {cell.interval}"
    return cell.interval.replace(" %", "") if cell.interval else cell.value
