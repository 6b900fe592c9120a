"""`ampi export`: what is written of a database, and what is refused before anything is."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.support.command_line import run, unwrapped
from tests.support.databases import small_database


@pytest.fixture(scope="module")
def database_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_database(tmp_path_factory)


def test_a_folder_of_flight_code_is_written_and_written_again(
    database_file: Path, tmp_path: Path
) -> None:
    asked = ("export", database_file, "--c", tmp_path / "code", "--json")
    first = json.loads(run(*asked, "--kind", "int16").stdout)["c"]
    names = {file.name for file in (tmp_path / "code").iterdir()}
    assert set(first["files"]) <= names
    assert {"ampi.h", "ampi_step.c", "ampi_table.bin", "main.c", "INTERFACE.md"} <= names
    assert (tmp_path / "code" / "ampi_table.bin").stat().st_size == first["table_bytes"]
    second = json.loads(run(*asked, "--law", "drag_shuttle", "--mode", "quadratic").stdout)["c"]
    assert second["table_bytes"] > first["table_bytes"]
    text = (tmp_path / "code" / "INTERFACE.md").read_text(encoding="utf-8")
    assert "law drag_shuttle, mode quadratic" in text
    assert "parameters speed [m/s]" in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "export: expected --c FOLDER or --fmu FILE, got neither"),
        (("--fmu", "unit.zip"), "unit.zip: expected a name that ends in .fmu"),
        (("--c", "full"), "full holds other files; nothing was overwritten"),
        (("--c", "code", "--kind", "int8"), "--kind: expected one of float64, float32, int16"),
        (("--c", "code", "--law", "none"), "--law: expected one of linear_quadratic"),
        (("--c", "code", "--mode", "hermite"), "orders: hermite needs a table with sensitivities"),
        (("--fmu", "unit.fmu", "--fmi", "1"), "--fmi: expected 2 or 3, got 1"),
    ],
)
def test_what_cannot_be_written_is_refused(
    database_file: Path, tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").touch()
    done = run("export", database_file, *arguments, cwd=tmp_path, code=2)
    assert message in unwrapped(done.stderr)
    assert {path.name for path in tmp_path.iterdir()} == {"full"}
