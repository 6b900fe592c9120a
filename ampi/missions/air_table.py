"""A table of the air as CSV: altitude (m), density (kg/m³) and speed of sound (m/s), read and written.

    altitude_m,density_kg_per_m3,speed_of_sound_m_per_s
    0,1.24853,328.7
    2000,1.00429,325.1

Lines that begin with # say where it is from; other columns are not read.
"""

from __future__ import annotations

from collections.abc import Iterable

from ampi.missions.csv_text import read_csv_text

COLUMNS = {  # of the CSV → key of the mission file
    "altitude_m": "altitude_m",
    "density_kg_per_m3": "density",
    "speed_of_sound_m_per_s": "speed_of_sound_m_per_s",
}


def parse_air_table(text: str, name: str) -> dict[str, list[float]]:
    """Columns by the keys of a mission file; `name` opens the error messages.

    Raises
    ------
    ValueError
        One sentence, if the text is no such table or its altitudes do not increase.
    """
    table = read_csv_text(text, name, tuple(COLUMNS))
    table.increasing("altitude_m")
    return {key: list(table.columns[column]) for column, key in COLUMNS.items()}


def air_table_text(columns: Iterable[Iterable[float]], comments: Iterable[str]) -> str:
    """The CSV of columns in the order of `COLUMNS`, in six digits, under `comments`."""
    lines = [*(f"# {comment}" for comment in comments), ",".join(COLUMNS)]
    lines += [",".join(f"{value:.6g}" for value in row) for row in zip(*columns, strict=True)]
    return "\n".join(lines) + "\n"
