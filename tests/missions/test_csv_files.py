"""CSV files as people make them: read rightly, or refused in one sentence with file, line and column."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from ampi.missions import MissionError, load_mission
from ampi.missions.aerodynamic_table import parse_aerodynamic_table
from ampi.missions.csv_text import read_csv_text
from ampi.simulation.world import WorldError
from ampi.simulation.world_loading import load_world

SOURCE = load_mission("cavh_wang2020")
TABLE = SOURCE.vehicle.aerodynamics
ROWS = [
    f"{angle:g},{mach:g},{TABLE.lift[i][j]!r},{TABLE.drag[i][j]!r}"
    for i, angle in enumerate((10.0, 15.0, 20.0))
    for j, mach in enumerate(TABLE.mach)
]
HEADER = "angle_of_attack_deg,mach,lift,drag"
CSV = "\n".join([HEADER, *ROWS]) + "\n"


def by_file(folder: Path, csv: bytes, *, ends: str = "\n", mark: bytes = b"") -> Path:
    """A mission file whose aerodynamics stand in a CSV beside it."""
    before, rest = SOURCE.toml.split("[vehicle.aerodynamics]")
    after = rest[rest.index("\n[") :]
    text = f'{before}[vehicle.aerodynamics]\nmodel = "table"\nfile = "aero.csv"\n{after}'
    (folder / "aero.csv").write_bytes(csv)
    path = folder / "m.toml"
    path.write_bytes(mark + text.replace("\n", ends).encode())
    return path


@pytest.mark.parametrize("ends", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_marks_line_ends_and_the_order_of_rows_change_nothing(
    tmp_path: Path, ends: str, mark: bytes
) -> None:
    csv = mark + ends.join([HEADER, *reversed(ROWS), ""]).encode()
    path = by_file(tmp_path, csv, ends=ends, mark=mark)
    assert load_mission(path).digest == SOURCE.digest


def with_row(line: int, row: str) -> str:
    lines = CSV.splitlines()
    lines[line - 1] = row
    return "\n".join(lines)


FAULTS = {
    "a missing column": (CSV.replace(",drag", ",cd", 1), "line 1: expected the columns angle_of_"),
    "semicolons": (
        CSV.replace(",", ";"),
        "line 1: expected commas between the columns, got semicolons",
    ),
    "tabulators": (CSV.replace(",", "\t"), "line 1: expected commas between the columns, got tab"),
    "a decimal comma": (
        with_row(3, "10,5,0,425,0,17"),
        "line 3: expected 4 cells, one for each column, got 6; the decimal sign is a point",
    ),
    "a quoted decimal comma": (
        with_row(3, '10,5,"0,425",0.17'),
        "line 3, column lift: expected a number with a decimal point, got '0,425'",
    ),
    "an empty cell": (
        with_row(3, "10,5,,0.17"),
        "line 3, column lift: expected a number, got an empty cell",
    ),
    "a word": (with_row(3, "10,5,low,0.17"), "line 3, column lift: expected a number, got 'low'"),
    "a doubled row": (
        CSV + ROWS[0],
        "line 23, column mach: expected each pair of angle of attack and Mach number once, got 10° "
        "and 3.5 again, which line 2 has",
    ),
    "a row that is not there": (
        CSV.replace(ROWS[4] + "\n", ""),
        "expected a row for every pair of 3 angles of attack and 7 Mach numbers, got none in columns "
        "angle_of_attack_deg, mach for 10, 15",
    ),
    "a column named twice": (
        CSV.replace(HEADER, HEADER + ",lift"),
        "line 1: expected a name for each column, each once",
    ),
    "columns alone": (HEADER, "expected one or more rows of numbers, got none"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_told_in_one_sentence(tmp_path: Path, fault: str) -> None:
    csv, said = FAULTS[fault]
    with pytest.raises(MissionError, match=re.escape(said)) as caught:
        load_mission(by_file(tmp_path, csv.encode()))
    assert "vehicle.aerodynamics.file: aero.csv: " in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_a_file_of_another_encoding_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        MissionError, match=r"aerodynamics\.file: aero\.csv: not a text file in UTF-8"
    ):
        load_mission(by_file(tmp_path, CSV.encode("utf-16")))


def test_altitudes_of_the_air_increase(tmp_path: Path) -> None:
    world = tmp_path / "w.toml"
    world.write_bytes(
        '\ufeffname = "w"\r\ntitle = "w"\r\n[entry]\r\ndistribution = "none"\r\n'
        '[density]\r\ntable = "d.csv"\r\n'.encode()
    )
    csv = "\ufeff# [P] a source\r\naltitude_m,factor\r\n0,1\r\n60000,1.1\r\n120000,1\r\n"
    (tmp_path / "d.csv").write_bytes(csv.encode())
    assert load_world(world).title == "w"
    (tmp_path / "d.csv").write_text(csv.replace("60000", "-1"), encoding="utf-8")
    said = "d.csv: line 4, column altitude_m: expected more than 0, the number of the row before"
    with pytest.raises(WorldError, match=re.escape(said)):
        load_world(world)


def test_cells_may_be_quoted_and_other_columns_anything() -> None:
    text = '# by hand\n"drag", "note", "lift"\n0.1, "a, b", 1e-1\n\n.5,,"2"\n'
    table = read_csv_text(text, "t.csv", ("lift", "drag"))
    assert table.columns == {"lift": (0.1, 2.0), "drag": (0.1, 0.5)}
    assert table.lines == (3, 5)


def test_a_table_reads_by_its_keys() -> None:
    said = parse_aerodynamic_table(CSV, "aero.csv")
    assert tuple(map(tuple, said["drag"])) == TABLE.drag
    assert tuple(said["mach"]) == TABLE.mach
