"""The guidance as C99 for flight software of one's own: sources, table, example, build and interface.

The core is shipped as it stands in `ampi/export/c`, one code for all tables; what is written for a table
are its sizes, its blob, and what a reader must know of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from ampi.export.c_interface import interface
from ampi.export.c_sizes import CodeSizes
from ampi.export.fmu_description import FmuModel
from ampi.outputs import written

SMALL = 64 * 1024  # bytes: a blob up to here is also written as C
A_LINE = 20  # bytes of it


@dataclass(frozen=True)
class FlightCode:
    """What has been written."""

    directory: Path
    files: tuple[str, ...]  # their names
    sizes: CodeSizes

    def __str__(self) -> str:
        return (
            f"{self.directory}: {len(self.files)} files; the table takes {self.sizes.blob:,} bytes, a "
            f"flight {self.sizes.guidance:,}"
        )


def export_c(
    directory: str | Path, model: FmuModel, blob: bytes, on_board: bytes | None = None
) -> FlightCode:
    """Write the flight code of `model`, which flies `blob`; files that are there are replaced.

    ampi_*.c, ampi_*.h
        The core, with the exact sizes of this table in ampi_config.h.
    ampi_table.bin
        The blob; of a small one also ampi_table_data.h, which main.c then compiles in.
    ampi_model.bin
        If there is one, the model on board, by which plans are corrected in flight.
    main.c, CMakeLists.txt
        A loop that flies a recording, and how to build it.
    INTERFACE.md
        Units, ranges, status codes, memory and work.

    The same table makes the same bytes.

    Parameters
    ----------
    directory
        Made if it is not there.
    model
        The table, its name, and the names of its parameters.
    blob
        Of the same table: `ampi.export.blob.table_blob`.
    on_board
        `ampi.export.model_blob.model_blob`, where the mission has a model on board.
    """
    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    sizes = CodeSizes.of(model.table, len(blob))
    files = {
        file.name: file.read_bytes()
        for file in (resources.files("ampi.export") / "c").iterdir()
        if file.name.endswith((".c", ".h", ".txt"))
    }
    files["ampi_config.h"] = sizes.config().encode()
    files["ampi_table.bin"] = blob
    files["INTERFACE.md"] = interface(model, blob, sizes, on_board).encode()
    if on_board is not None:
        files["ampi_model.bin"] = on_board
    else:
        (folder / "ampi_model.bin").unlink(missing_ok=True)  # of another mission
    if len(blob) <= SMALL:
        files["ampi_table_data.h"] = _data(blob).encode()
    else:
        (folder / "ampi_table_data.h").unlink(missing_ok=True)  # of another table
    for name, content in sorted(files.items()):
        with written(folder / name) as unfinished:
            unfinished.write_bytes(content)
    return FlightCode(folder, tuple(sorted(files)), sizes)


def _data(blob: bytes) -> str:
    """ampi_table_data.h: the blob as C."""
    lines = (
        "    " + ", ".join(map(str, blob[i : i + A_LINE])) for i in range(0, len(blob), A_LINE)
    )
    return (
        "/* ampi_table.bin, for a build without files; to be included once. */\n"
        f"static const unsigned char ampi_table_data[{len(blob)}] = {{\n"
        + ",\n".join(lines)
        + "};\n"
    )
