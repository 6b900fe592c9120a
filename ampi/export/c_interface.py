"""INTERFACE.md: what the engineer who integrates the flight code of one table must know."""

from __future__ import annotations

from collections.abc import Sequence

from ampi.export.blob import blob_text, blob_vertices
from ampi.export.c_correction import correction_interface
from ampi.export.c_sizes import CodeSizes
from ampi.export.fmu_description import FmuModel
from ampi.export.instruction_bounds import InstructionBounds
from ampi.onboard.clock import LONGEST, SHORTEST
from ampi.onboard.health import Health, Steering
from ampi.onboard.row_layout import STATES
from ampi.release import RELEASE

# of ampi_table_open, in the order of their numbers
STATUSES = {
    "AMPI_OK": "The table can be flown.",
    "AMPI_TRUNCATED": "It is shorter or longer than it says.",
    "AMPI_FOREIGN": "It is no guidance table.",
    "AMPI_BYTE_ORDER": "It was written for a machine of the other byte order.",
    "AMPI_VERSION": "It is of a format that this code does not know.",
    "AMPI_CHECKSUM": "It is damaged: its CRC-32 is another one.",
    "AMPI_TOO_LARGE": "It is larger than ampi_config.h allows.",
    "AMPI_INCONSISTENT": "A size, an order or a number is one that no writer makes.",
}


def interface(model: FmuModel, blob: bytes, sizes: CodeSizes, on_board: bytes | None = None) -> str:
    """The document; `on_board` is the blob of the model that corrects plans, if there is one."""
    return "\n".join(
        [
            f"# Flight code: {model.name}\n\nWritten by ampi {RELEASE}.\n",
            _use(model),
            _inputs(model),
            _outputs(),
            _memory(sizes),
            _work(sizes, blob_vertices(blob), InstructionBounds.of(blob)),
            *([] if on_board is None else [correction_interface(on_board)]),
            "## The table\n",
            f"```\n{blob_text(blob)}```\n",
        ]
    )


def _use(model: FmuModel) -> str:
    return f"""\
C99, `<math.h>` and `<string.h>`. SI units and radians. Compile with `-ffp-contract=off` and without
`-ffast-math`: then the commands have the bits of the Python from which the table was written.

1. `ampi_table_open(&table, blob, size)` once. Anything but `AMPI_OK`: do not fly.
2. `ampi_guidance_begin(&guidance, &table, parameters)` at the entry interface.
3. `command = ampi_guidance_step(&guidance, &table, time, navigation, sensed)` at every cycle, nominally
   of {model.cycle:g} s.

`ampi_reference_at` and `ampi_guidance_follow` take up another reference in flight. Table and flight are
memory of the caller; nothing is allocated, and no function waits, fails or calls back.
"""


def _inputs(model: FmuModel) -> str:
    table = model.table
    envelope = zip(STATES, table.envelope.middle, table.envelope.reach, strict=True)
    parameters = [
        (f"parameters[{i}]", p.name, p.unit, f"{axis[0]:.6g}", f"{axis[-1]:.6g}")
        for i, (p, axis) in enumerate(zip(model.parameters, table.axes, strict=True))
    ]
    navigation = [
        (f"navigation[{i}]", row.name, row.unit, f"{mid - reach:.6g}", f"{mid + reach:.6g}")
        for i, (row, mid, reach) in enumerate(envelope)
    ]
    sensed = [
        (f"sensed[{i}]", f"specific force {way}", "m/s²", "", "")
        for i, way in enumerate(("along the velocity", "up of it", "right of it"))
    ]
    heading = ("argument", "what", "unit", "from", "to")
    return f"""\
## Inputs

{_table(heading, parameters)}
Beyond its range a parameter counts as the boundary's, and the health says so; one that is no number
counts as nominal.

{_table(heading, [("time", "since the entry interface", "s", "", ""), *navigation])}
`navigation[7]` is the bank rate (rad/s), up to twice its limit. Beyond these ranges navigation is
implausible; longitude, azimuth and bank angle may be on another turn. Times go on by {SHORTEST:g} s to
{LONGEST:g} nominal cycles.

{_table(heading, sensed)}
A NULL pointer of parameters, navigation or accelerations counts as no numbers.
"""


def _outputs() -> str:
    numbers = [
        ("bank_rate", "rad/s", "to be reached at the end of the cycle"),
        ("bank_angle", "rad", "there"),
        ("angle_of_attack", "rad", "to be added to the schedule's; itself, where there is none"),
    ]
    statuses = [(str(i), *each) for i, each in enumerate(STATUSES.items())]
    health = [(f"{h:d}", f"AMPI_{h.name}", h.sentence) for h in Health]
    steering = [(f"{s:d}", f"AMPI_{s.name}", s.sentence) for s in Steering]
    heading = ("number", "name", "meaning")
    return f"""\
## Outputs

{_table(("command", "unit", "what"), numbers)}
Every command keeps the limits of bank angle, rate and acceleration, and those of the angle of attack's
change.

`steering`:

{_table(heading, steering)}
`health`, of several that apply the greatest:

{_table(heading, health)}
Status of `ampi_table_open`:

{_table(heading, statuses)}"""


def _memory(sizes: CodeSizes) -> str:
    rows = [
        ("the blob, constant", f"{sizes.blob:,}"),
        ("ampi_table, constant once opened", f"{sizes.table:,}"),
        ("ampi_guidance, of each flight", f"{sizes.guidance:,}"),
        ("ampi_reference, in it; another to take one up in flight", f"{sizes.reference:,}"),
        ("stack, about, at the most", f"{sizes.stack:,}"),
    ]
    return f"""\
## Memory

{_table(("what", "bytes"), rows)}
On a machine of eight-byte pointers.
"""


def _work(sizes: CodeSizes, vertices: int, most: InstructionBounds) -> str:
    columns = sizes.rows * sizes.nodes + 1
    reference, high = vertices * columns, sizes.conversions * sizes.rows
    library = f"and {most.library} of the mathematical library" if most.library else ""
    rows = [
        (
            "`ampi_reference_at`",
            f"{most.reference:,}",
            f"{reference:,}",
            f"{vertices:,} vertices × {columns:,} columns",
        ),
        ("`ampi_reference_high_density`", "", f"{high:,}", "not needed to fly"),
        ("`ampi_guidance_step`", f"{most.step:,}", f"{sizes.rows * sizes.widest:,}", library),
        ("`ampi_table_open`", "", "", f"{sizes.blob:,} bytes through the CRC-32"),
    ]
    return f"""\
## Work

{_table(("of", "instructions, at the most", "multiplications and additions", ""), rows)}
Instructions are of gcc 12, -O2, on x86-64; other compilers and processors need others. Those of memset,
exp, log, sin, cos and acos are the library's, and not among them. No loop depends on data: its bound is
one of {sizes.axes} axes, {sizes.rows} rows, {sizes.nodes} nodes, {sizes.segments} segments of
{sizes.widest} nodes at the
most, {sizes.points} high-density points, or a length of the table. The instructions of a step differ by
less than a hundredth, whatever it is told.
"""


def _table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [heading, ["---"] * len(heading), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)
