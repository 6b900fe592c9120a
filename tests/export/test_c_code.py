"""The exported folder: built by CMake it flies what `Guidance.step` flies; what it says is so."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import ampi
from ampi.correction.corrector import CorrectionOutcome
from ampi.export.blob import blob_text, blob_vertices
from ampi.export.c_code import SMALL, export_c
from ampi.export.c_correction import correction_bounds, corrector_size, model_size
from ampi.export.c_interface import STATUSES
from ampi.export.fmu_description import FmuModel, Measured
from ampi.export.model_blob import model_blob
from ampi.guidance import Guidance
from ampi.missions.loading import load_mission
from ampi.onboard.health import Health, Steering
from ampi.onboard.subspace import Order
from ampi.onboard_model import correction_of
from tests.export.conftest import LAWS, LIMITS, LawMaker, entry_table
from tests.support.flight_blobs import recorded
from tests.support.flight_code import COMPILER, CORE, compiled, needs_compiler

NAMES = (Measured("longitude", "rad"), Measured("speed", "m/s"), Measured("limit", "rad"))


def model_of(guidance: Guidance) -> FmuModel:
    return FmuModel("test", guidance.table, NAMES)


def small(entry: LawMaker) -> Guidance:
    return entry(mode="nominal", cycle=0.5)


def large() -> Guidance:
    law = LAWS["linear_quadratic"]
    return Guidance(entry_table(law, (6, 4, 3)), LIMITS, law=law, cycle=0.5, engine="numpy")


@needs_compiler
@pytest.mark.skipif(shutil.which("cmake") is None, reason="NO CMAKE: the export is not built")
@pytest.mark.parametrize("is_small", [True, False])
def test_built_and_run_it_commands_what_guidance_does(
    entry: LawMaker, tmp_path: Path, is_small: bool
) -> None:
    guidance = small(entry) if is_small else large()
    blob = guidance.blob()
    assert (len(blob) <= SMALL) == is_small
    folder = export_c(tmp_path / "code", model_of(guidance), blob).directory
    build = folder / "build"
    for command in (["cmake", "-S", folder, "-B", build], ["cmake", "--build", build]):
        subprocess.run([*map(str, command)], check=True, capture_output=True)

    p = np.array(
        [axis[i] for axis, i in zip(guidance.table.axes, guidance.table.centre, strict=True)]
    )
    times, navigation, _ = recorded(guidance, p, np.random.default_rng(4), 50)
    flight = tmp_path / "flight.csv"
    np.savetxt(
        flight, np.column_stack([times, navigation]), fmt="%.17g", delimiter=",", header="time"
    )
    table = [] if is_small else [folder / "ampi_table.bin"]  # a small one is compiled in
    run = [*map(str, [build / "main", *table, flight])]
    printed = subprocess.run(run, check=True, capture_output=True, text=True).stdout.splitlines()[
        1:
    ]
    guidance.begin(p)
    for line, time, state in zip(printed, times, navigation, strict=True):
        command = guidance.step(time, state)
        told = [float(number) for number in line.split(",")[1:]]
        assert told[:3] == [command.bank_rate, command.bank_angle, command.angle_of_attack]
        assert told[3:] == [command.steering, command.health]


def test_the_same_table_makes_the_same_bytes(entry: LawMaker, tmp_path: Path) -> None:
    for name in ("a", "b"):
        guidance = small(entry)
        export_c(tmp_path / name, model_of(guidance), guidance.blob())
    files = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert {"ampi_table.bin", "ampi_table_data.h", "main.c", "CMakeLists.txt", "INTERFACE.md"} < {
        *files
    }
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    for name in ("ampi_config.h", "INTERFACE.md"):
        assert f"Written by ampi {ampi.__version__}." in (tmp_path / "a" / name).read_text("utf-8")


def test_the_core_is_shipped_as_it_is(entry: LawMaker, tmp_path: Path) -> None:
    guidance = large()
    export_c(tmp_path, model_of(small(entry)), small(entry).blob())
    written = export_c(tmp_path, model_of(guidance), guidance.blob())
    for file in CORE.glob("ampi*"):
        if file.name != "ampi_config.h":
            assert (tmp_path / file.name).read_bytes() == file.read_bytes()
    assert not (tmp_path / "ampi_table_data.h").exists()  # that of the smaller table is gone
    assert "files; the table takes" in str(written)


@needs_compiler
def test_memory_is_what_the_document_says(entry: LawMaker, tmp_path: Path) -> None:
    for i, law in enumerate(("linear_quadratic", "drag_shuttle")):
        guidance = entry(law)
        folder = tmp_path / str(i)
        sizes = export_c(folder, model_of(guidance), guidance.blob()).sizes
        (folder / "library").mkdir()
        code = compiled(folder / "library", "-include", str(folder / "ampi_config.h"))
        told = [code.probe_size(i) for i in range(3)]
        assert told == [sizes.table, sizes.reference, sizes.guidance]
        page = (folder / "INTERFACE.md").read_text(encoding="utf-8")
        for size in told:
            assert f"{size:,}" in page
        assert blob_text(guidance.blob()) in page


@needs_compiler
def test_with_a_model_it_is_built_described_and_flown_corrected(
    entry: LawMaker, tmp_path: Path
) -> None:
    guidance, on_board = small(entry), model_blob(correction_of(load_mission("shefex3")))
    folder = export_c(tmp_path / "code", model_of(guidance), guidance.blob(), on_board).directory
    assert (folder / "ampi_model.bin").read_bytes() == on_board
    (tmp_path / "library").mkdir()
    code = compiled(tmp_path / "library", "-include", str(folder / "ampi_config.h"))
    assert [code.probe_size(i) for i in (3, 4)] == [model_size(on_board), corrector_size()]
    page = (folder / "INTERFACE.md").read_text(encoding="utf-8")
    for number in (*correction_bounds(on_board)[:2], model_size(on_board), corrector_size()):
        assert f"{number:,}" in page
    assert all(outcome.sentence in page for outcome in CorrectionOutcome)
    assert COMPILER is not None
    sources = [str(file) for file in folder.glob("*.c")]
    flags = ["-std=c99", "-DAMPI_TABLE_DATA", f"-I{folder}"]
    subprocess.run([COMPILER, *flags, *sources, "-o", str(tmp_path / "main"), "-lm"], check=True)
    run = [str(tmp_path / "main"), "-m", str(folder / "ampi_model.bin")]
    flown = subprocess.run(run, check=True, capture_output=True, text=True).stdout.splitlines()
    steering = {line.split(",")[4] for line in flown[1:]}
    assert str(int(Steering.PLANNED)) in steering
    export_c(tmp_path / "code", model_of(guidance), guidance.blob())  # of a mission without
    assert not (folder / "ampi_model.bin").exists()


def test_numbers_and_names_of_the_header_are_those_of_the_document() -> None:
    header = (CORE / "ampi.h").read_text(encoding="ascii")
    enumerations = [
        re.findall(r"^\s*(AMPI_\w+)", re.sub(r"/\*.*?\*/|= 0", "", body), re.MULTILINE)
        for body in re.findall(r"typedef enum \{(.*?)\}", header.replace(", ", ",\n"), re.DOTALL)
    ]
    outcomes = [[f"AMPI_{outcome.name}" for outcome in each] for each in (Health, Steering)]
    assert enumerations == [[*STATUSES], *outcomes]
    assert [*Health] == [*range(len(Health))]


def test_the_vertices_of_a_reference_are_counted() -> None:
    law = LAWS["linear_quadratic"]
    table = entry_table(law, (5, 3, 2))
    for orders, expected in (
        ([Order.LINEAR] * 3, 8),
        ([Order.CUBIC, Order.QUADRATIC, Order.NEAREST], 12),
        ([Order.SECOND_DIFFERENCES] * 3, 8 + 4 * 4 + 4 * 3),
    ):
        guidance = Guidance(table, LIMITS, law=law, orders=orders, engine="numpy")
        assert blob_vertices(guidance.blob()) == expected
