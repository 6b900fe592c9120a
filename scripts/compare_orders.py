"""What does an order of interpolation cost, and which pays at which size of the table?

python scripts/compare_orders.py                            print the tables
python scripts/compare_orders.py --figure orders.svg        and draw them
python scripts/compare_orders.py --json orders.json         and keep the numbers
python scripts/compare_orders.py --page docs/results.md         replace the tables between their markers

SHEFEX-3 over the box of its grid, by tables of more or fewer points an axis, full or sparse: in three
entry states, and in all six. Errors are those of references at random points against the optimum there.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from order_errors import Optima, Table, full_table, measured, sparse_table
from page_section import write_section

import ampi
from ampi.cli.progress import progress
from ampi.onboard.reference import Mode
from ampi.onboard.subspace import Order
from ampi.report.figures.style import INK, MODE_STYLES, house_style, new_figure, save_figure

THREE = ("altitude_m", "speed_m_per_s", "flight_path_angle_deg")
SPARSE = (Order.LINEAR, Order.QUADRATIC)
DIFFERENTIATED = 5000  # optima at most: those of 5^6 would take minutes and gigabytes
PERCENTILE = 90.0
SEED = 2016
STYLES = {
    order.value: MODE_STYLES[Mode(order.value)] for order in Order if order is not Order.LINEAR
}
STYLES["linear"] = MODE_STYLES[Mode.AMPI]
NUMBERED = ("linear", "cubic", "hermite")
DRAWN = {"position_m": "reference, position (m)", "miss_km": "flown open loop, miss (km)"}


def mission_over(names: Sequence[str]) -> ampi.Mission:
    """SHEFEX-3 with a grid in these of its parameters."""
    mission = ampi.load_mission("shefex3")
    offsets = mission.grid.as_written()
    return mission.with_grid({name: offsets[name] for name in names or offsets})


def is_another(order: Order, points: int) -> bool:
    """Whether an order differs from a lower one on axes of so many points."""
    return points >= (3 if order is Order.SECOND_DIFFERENCES else order.points)


def tables(optima: Optima, sizes: Sequence[int], levels: int) -> list[Table]:
    """Every order on full grids of these sizes, and sparse grids up to a level."""
    d = len(optima.half)
    found = [
        full_table(optima, n, order)
        for order in Order
        for n in sizes
        if is_another(order, n) and not (order is Order.HERMITE and n**d > DIFFERENTIATED)
    ]
    sparse = [sparse_table(optima, k + 1, order) for order in SPARSE for k in range(levels)]
    return found + sparse


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Both boxes."""
    boxes = {}
    plan = (
        ("3 entry states", THREE, arguments.three, arguments.levels),
        ("6 entry states", (), arguments.six, arguments.levels),
    )
    for name, axes, sizes, levels in plan:
        mission = mission_over(axes)
        d = len(mission.parameters)
        points = np.random.default_rng(SEED).uniform(-1.0, 1.0, (arguments.probes, d))
        with progress(name, 2 * sum(n**d for n in sizes)) as advance:
            optima = Optima(mission, advance)
            own = tables(optima, sizes, levels)
        with progress(f"{name}: {len(own)} tables", len(own) * len(points)) as advance:
            optima.advance = advance
            boxes[name] = measured(optima, own, points, PERCENTILE)
    return {"probes": arguments.probes, "percentile": PERCENTILE, "boxes": boxes}


def pays(rows: Sequence[dict[str, Any]], own: dict[str, Any]) -> bool:
    """Whether no table of as few bytes flies closer to the target."""
    return not any(
        other["bytes_int16"] <= own["bytes_int16"] and other["miss_km"] < own["miss_km"]
        for other in rows
    )


def text_of(found: dict[str, Any]) -> str:
    """The tables in Markdown; in bold what pays."""
    lines = [
        f"{found['percentile']:.0f}th percentiles over {found['probes']} random entries; in bold the "
        "tables that fly closer to the target than every other of as few bytes.",
    ]
    head = "order | grid | optima | int16 | float64 | position (m) | altitude (m) | speed (m/s) | "
    head += "bank (°) | flown miss (km)"
    for name, rows in found["boxes"].items():
        lines += ["", f"| {name}: {head} |", f"|{'---|' * 10}"]
        for row in sorted(rows, key=lambda row: (row["bytes_int16"], -row["miss_km"])):
            mark = "**" if pays(rows, row) else ""
            cells = [
                f"{mark}{row['order'].replace('_', ' ')}{mark}",
                row["size"].replace("^", " ^ "),
                f"{row['cases']}",
                *(_bytes(row[f"bytes_{kind}"]) for kind in ("int16", "float64")),
                *(f"{row[c]:.3g}" for c in ("position_m", "altitude_m", "speed_m_per_s")),
                f"{row['bank_deg']:.2g}",
                f"{mark}{row['miss_km']:.3g}{mark}",
            ]
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def of_all_states(found: dict[str, Any]) -> dict[str, Any]:
    """The widest box alone: a page has no room for all."""
    name = list(found["boxes"])[-1]
    return {**found, "boxes": {name: found["boxes"][name]}}


def _bytes(count: int) -> str:
    return f"{count / 1e6:.3g} MB" if count >= 1e6 else f"{count / 1e3:.3g} kB"


@house_style
def drawing(found: dict[str, Any]) -> Figure:
    """Error over bytes, a line an order."""
    boxes = found["boxes"]
    figure = new_figure(10.0, 7.6)
    grid = figure.subplots(len(DRAWN), len(boxes), squeeze=False, sharex="col", sharey="row")
    for row, (column, label) in zip(grid, DRAWN.items(), strict=True):
        row[0].set_ylabel(label)
        for axes, (name, rows) in zip(row, boxes.items(), strict=True):
            _draw(axes, rows, column)
            axes.set_title(name if column == "position_m" else "")
    for axes in grid[-1]:
        axes.set_xlabel("table in int16 (bytes); beside some: points an axis")
    handles, labels = grid[0, -1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def _draw(axes: Axes, rows: Sequence[dict[str, Any]], column: str) -> None:
    for order in dict.fromkeys(row["order"] for row in rows):
        own = [row for row in rows if row["order"] == order]
        is_sparse = order.startswith("sparse ")
        style = STYLES[order.removeprefix("sparse ")]
        axes.loglog(
            [row["bytes_int16"] for row in own],
            [row[column] for row in own],
            marker=style.marker,
            color=style.colour,
            markerfacecolor="white" if is_sparse else style.colour,
            linestyle=(0, (3.0, 2.0)) if is_sparse else "-",
            linewidth=1.4,
            markersize=5.5,
            label=order.replace("_", " "),
        )
        if order in NUMBERED:
            for row in own:
                axes.annotate(
                    row["size"].split("^")[0],
                    (row["bytes_int16"], row[column]),
                    textcoords="offset points",
                    xytext=(5, 4),
                    fontsize=7.0,
                    color=INK,
                )


def main() -> None:
    """Parse, measure, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--three", type=int, nargs="*", default=[2, 3, 4, 5, 9], help="points an axis"
    )
    parser.add_argument("--six", type=int, nargs="*", default=[2, 3, 4], help="points an axis")
    parser.add_argument("--levels", type=int, default=4, help="of sparse grids")
    parser.add_argument("--probes", type=int, default=100, help="random entries")
    parser.add_argument("--json", type=Path, help="write the numbers")
    parser.add_argument("--figure", type=Path, help="draw (SVG, PNG, PDF)")
    parser.add_argument("--page", type=Path, help="replace the table in this page")
    arguments = parser.parse_args()
    found = measure(arguments)
    text = text_of(found)
    print(text)
    if arguments.json:
        arguments.json.write_text(json.dumps(found, indent=1), encoding="utf-8")
    if arguments.figure:
        save_figure(arguments.figure, drawing(found), "scripts/compare_orders.py")
    if arguments.page:
        write_section(arguments.page, "orders", text_of(of_all_states(found)))


if __name__ == "__main__":
    main()
