"""An aerodynamic table as CSV: a row for each pair of angle of attack (deg) and Mach number.

    angle_of_attack_deg,mach,lift,drag
    10,3.5,0.450,0.2045
    10,5.0,0.425,0.1700

`lift` and `drag` are C_L and C_D. The rows may come in any order, and each pair once; lines that begin
with # say where the table is from; other columns are not read.
"""

from __future__ import annotations

from typing import Any

from ampi.missions.csv_text import read_csv_text

COLUMNS = ("angle_of_attack_deg", "mach", "lift", "drag")


def parse_aerodynamic_table(text: str, name: str) -> dict[str, Any]:
    """Axes and tables by the keys of a mission file; `name` opens the error messages.

    Raises
    ------
    ValueError
        One sentence, if the text is no such table, or a pair is there twice or not at all.
    """
    table = read_csv_text(text, name, COLUMNS)
    angles, machs, lift, drag = (table.columns[column] for column in COLUMNS)
    rows: dict[tuple[float, float], int] = {}
    for row, pair in enumerate(zip(angles, machs, strict=True)):
        if pair in rows:
            raise ValueError(
                f"{table.place(row, 'mach')}: expected each pair of angle of attack and Mach number "
                f"once, got {pair[0]:g}° and {pair[1]:g} again, which line {table.lines[rows[pair]]} has"
            )
        rows[pair] = row
    over_angle, over_mach = sorted(set(angles)), sorted(set(machs))
    for angle in over_angle:
        for mach in over_mach:
            if (angle, mach) not in rows:
                raise ValueError(
                    f"{name}: expected a row for every pair of {len(over_angle)} angles of attack and "
                    f"{len(over_mach)} Mach numbers, got none in columns angle_of_attack_deg, mach for "
                    f"{angle:g}, {mach:g}"
                )
    return {
        "angle_of_attack_deg": over_angle,
        "mach": over_mach,
        "lift": [[lift[rows[a, m]] for m in over_mach] for a in over_angle],
        "drag": [[drag[rows[a, m]] for m in over_mach] for a in over_angle],
    }
