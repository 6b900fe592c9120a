"""`ampi export`: the guidance of a database as flight code in C, or as a functional mock-up unit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ampi.cli.console import out, print_json
from ampi.cli.endings import refusals
from ampi.cli.options import (
    ONE_MODE,
    DatabaseArgument,
    Force,
    HolesOption,
    Json,
    ModulateOption,
    member,
    one_of,
)
from ampi.cli.output_files import check_output

if TYPE_CHECKING:
    from ampi.correction.onboard_correction import Correction
    from ampi.dataset import TrajectoryDataset
    from ampi.export.fmu_description import FmuModel
    from ampi.guidance import Guidance

MADE_BY = "INTERFACE.md"  # a folder that has this may be written again


def export(
    path: DatabaseArgument,
    c: Annotated[
        Path | None, typer.Option("--c", help="Folder for C99: core, table, example, interface.")
    ] = None,
    fmu: Annotated[
        Path | None, typer.Option(help="FMI co-simulation unit to write (.fmu).")
    ] = None,
    fmi: Annotated[int, typer.Option(help="Version of FMI: 3 or 2.")] = 3,
    law: Annotated[
        str,
        typer.Option(help="linear_quadratic, drag_sliding_mode or drag_shuttle."),
    ] = "linear_quadratic",
    modulate: ModulateOption = False,
    mode: Annotated[str, typer.Option(help=ONE_MODE)] = "ampi",
    kind: Annotated[
        str, typer.Option(help="How the table is stored: float64, float32 or int16.")
    ] = "float64",
    cycle: Annotated[
        float | None, typer.Option(help="Nominal guidance cycle (s), that of the first command.")
    ] = None,
    holes: HolesOption = "refuse",
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write what flies: the table with the hand-written C99 that reads it, as sources or as an FMU.

    It is the code that campaigns are flown with; its commands have the bits of `Guidance.step`.
    """
    with refusals():
        if c is None and fmu is None:
            raise ValueError("export: expected --c FOLDER or --fmu FILE, got neither")
        _check(path, c, fmu, force=force)
        model, blob, on_board = _flown(path, law, mode, kind, cycle, holes, modulate=modulate)
        written = _written(model, blob, on_board, c, fmu, fmi)
    if as_json:
        print_json(written)
        return
    for text in written.values():
        out.print(text["text"], soft_wrap=True, highlight=False)


def _check(path: Path, c: Path | None, fmu: Path | None, *, force: bool) -> None:
    check_output(fmu, ".fmu", force=force, others=[path])
    if c is None:
        return
    if c.exists() and not c.is_dir():
        raise ValueError(f"{c}: expected a folder, got a file")
    if c.is_dir() and any(c.iterdir()) and not (force or (c / MADE_BY).is_file()):
        raise ValueError(
            f"{c} holds other files; nothing was overwritten: choose another folder, or add --force"
        )


def _flown(
    path: Path,
    law: str,
    mode: str,
    kind: str,
    cycle: float | None,
    holes: str,
    *,
    modulate: bool,
) -> tuple[FmuModel, bytes, bytes | None]:
    """What is described, what flies, and the model on board of a mission that has one."""
    from ampi.dataset import read_dataset
    from ampi.export.blob import KINDS
    from ampi.export.model_blob import model_blob
    from ampi.loading import HOLES, LAWS, guidance_of
    from ampi.onboard.reference import Mode

    stored = one_of(KINDS, kind, "--kind")
    dataset = read_dataset(path)
    guidance = guidance_of(
        dataset,
        mode=member(Mode, mode, "--mode"),
        law=one_of(LAWS, law, "--law"),
        modulate=modulate,
        holes=one_of(HOLES, holes, "--holes"),
        cycle=cycle,
    )
    correction = _correction(dataset)
    if correction is not None:  # the table holds the limits of all that it may ask for
        guidance = guidance.corrected(correction)
    on_board = None if correction is None else model_blob(correction)
    model = _model(dataset, guidance)
    names = ", ".join(f"{own.name} [{own.unit}]" for own in model.parameters)
    about = f"mission {dataset.mission.name}, {dataset.mission.digest[:12]}\nparameters {names}"
    return model, guidance.blob(stored, about), on_board


def _correction(dataset: TrajectoryDataset) -> Correction | None:
    from ampi.onboard_model import correction_of

    try:
        return correction_of(dataset.mission)
    except ValueError:  # what is flown without
        return None


def _model(dataset: TrajectoryDataset, guidance: Guidance) -> FmuModel:
    from ampi.export.fmu_description import FmuModel, Measured

    measured = tuple(Measured(p.name, p.number.unit) for p in dataset.mission.parameters)
    return FmuModel(dataset.mission.name, guidance.table, measured, guidance.cycle)


def _written(
    model: FmuModel,
    blob: bytes,
    on_board: bytes | None,
    c: Path | None,
    fmu: Path | None,
    fmi: int,
) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    if c is not None:
        from ampi.export.c_code import export_c

        code = export_c(c, model, blob, on_board)
        found["c"] = {
            "text": str(code),
            "files": list(code.files),
            "table_bytes": len(blob),
            "flight_bytes": code.sizes.guidance,
        }
    if fmu is not None:
        from ampi.export.fmu import export_fmu

        version = {2: 2, 3: 3}.get(fmi)
        if version is None:
            raise ValueError(f"--fmi: expected 2 or 3, got {fmi}")
        unit = export_fmu(fmu, model, blob, version=2 if version == 2 else 3)
        found["fmu"] = {"text": str(unit), "platform": unit.platform, "bytes": fmu.stat().st_size}
    return found
