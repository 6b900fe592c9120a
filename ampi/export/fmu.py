"""The guidance as a functional mock-up unit (FMI 2.0 or 3.0, co-simulation) for any simulator.

An archive of the model description, the table, the C sources and, where there is a C compiler, their
binary for Linux. The same guidance and compiler make the same bytes.
"""

from __future__ import annotations

import hashlib
import platform
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
import zipfile
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from ampi.export.c_sizes import CodeSizes
from ampi.export.fmu_description import FmuModel, Version, document, model_description
from ampi.outputs import written

# an instruction that fuses two would have other bits; hidden, for a process may load many
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-fvisibility=hidden", "-shared", "-s")
LINUX_2 = {"x86_64": "linux64", "i686": "linux32"}  # folders of FMI 2.0
EPOCH = (1980, 1, 1, 0, 0, 0)  # of every file: the archive tells no time
COMPILE_TIME = 120.0  # s, at most


@dataclass(frozen=True)
class Fmu:
    """What has been written."""

    path: Path
    version: Version
    platform: str | None  # of the binary; None: sources only
    why: str = ""  # there is no binary

    def __str__(self) -> str:
        inside = "sources and the binary of " + self.platform if self.platform else "sources only"
        reason = f" ({self.why})" if self.why else ""
        return f"{self.path}: FMI {self.version}.0 co-simulation, {inside}{reason}"


def export_fmu(
    path: str | Path, model: FmuModel, blob: bytes, *, version: Version = 3, compiler: str = "cc"
) -> Fmu:
    """Write the unit of `model`, which flies `blob`; a file that is there is replaced.

    Parameters
    ----------
    path
        Of the archive.
    model
        The table that is flown, its name, and the names of its parameters.
    blob
        Of the same table: `ampi.export.blob.table_blob`.
    version
        Of the standard: 3 or 2; their archives differ.
    compiler
        Of C, called as gcc and clang are. Where there is none the unit has sources only, and says so.

    Raises
    ------
    ValueError
        If the version is another one.
    """
    if version not in (2, 3):
        raise ValueError(f"version: expected 2 or 3 of FMI, got {version!r}")
    sources = _sources(version)
    token = _token(model, blob, sources)
    sizes = CodeSizes.of(model.table, len(blob)).config().encode()
    sources["ampi_config.h"], sources["fmu_config.h"] = sizes, _config(model, token)
    compiled = sorted(name for name in sources if name.endswith(".c"))
    described = model_description(model, version, token=token, sources=compiled)
    binary, why = _binary(sources, compiled, compiler)
    machine = _platform(version) if binary else None
    files = {"modelDescription.xml": described}
    if binary:
        files[f"binaries/{machine}/{model.identifier}.so"] = binary
    files["resources/ampi_table.bin"] = blob
    if version == 3:
        files["sources/buildDescription.xml"] = _build_description(model, compiled)
    files.update({f"sources/{name}": text for name, text in sorted(sources.items())})
    _write(Path(path), files)
    return Fmu(Path(path), version, machine, why)


def _sources(version: Version) -> dict[str, bytes]:
    """The flight code as it is shipped, and what wraps it."""
    found = {}
    for folder, starts in (("c", "ampi"), ("fmi", ("fmu", f"fmi{version}"))):
        for file in sorted(
            (resources.files("ampi.export") / folder).iterdir(), key=lambda f: f.name
        ):
            if file.name.startswith(starts) and file.name.endswith((".c", ".h")):
                found[file.name] = file.read_bytes()
    return found


def _token(model: FmuModel, blob: bytes, sources: dict[str, bytes]) -> str:
    """What a model description and a binary know each other by: a digest of all that they hold."""
    digest = hashlib.sha256(repr((model.name, model.parameters)).encode())
    for part in (model.start.tobytes(), blob, *sources.values()):
        digest.update(hashlib.sha256(part).digest())
    return f"{{{digest.hexdigest()[:32]}}}"


def _config(model: FmuModel, token: str) -> bytes:
    """fmu_config.h: what fmi/fmu.h wants to be told."""
    start = ", ".join(repr(value) for value in model.start.tolist())
    return (
        "/* Of one unit: written with its model description. */\n"
        "#ifndef FMU_CONFIG_H\n#define FMU_CONFIG_H\n\n"
        f'#define FMU_TOKEN "{token}"\n'
        f"#define FMU_N_PARAMETERS {len(model.parameters)}\n"
        f"#define FMU_START {{{start}}}\n\n"
        "#endif\n"
    ).encode()


def _build_description(model: FmuModel, compiled: list[str]) -> bytes:
    """buildDescription.xml of FMI 3.0."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=model.identifier)
    files = ET.SubElement(
        build, "SourceFileSet", language="C99", compilerOptions="-ffp-contract=off"
    )
    for name in compiled:
        ET.SubElement(files, "SourceFile", name=name)
    ET.SubElement(build, "Library", name="m", external="true")
    return document(root)


def _platform(version: Version) -> str:
    machine = platform.machine()
    known = LINUX_2.get(machine) if version == 2 else None
    return known or f"{machine}-linux"


def _binary(
    sources: dict[str, bytes], compiled: list[str], compiler: str
) -> tuple[bytes | None, str]:
    """The shared library; or None, and why there is none."""
    found = shutil.which(compiler)
    if sys.platform != "linux":
        return None, "binaries are made on Linux"
    if found is None:
        return None, f"no C compiler {compiler} was found"
    with tempfile.TemporaryDirectory() as folder:
        for name, text in sources.items():
            (Path(folder) / name).write_bytes(text)
        command = [found, *FLAGS, *compiled, "-o", "unit.so", "-lm"]
        try:
            run = subprocess.run(
                command, cwd=folder, capture_output=True, text=True, timeout=COMPILE_TIME
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            return None, f"{compiler} did not compile: {error}"
        if run.returncode != 0:
            told = [line for line in run.stderr.splitlines() if "error" in line]
            return None, f"{compiler} did not compile: {told[0] if told else run.returncode}"
        return (Path(folder) / "unit.so").read_bytes(), ""


def _write(path: Path, files: dict[str, bytes]) -> None:
    """The archive, under its name when it is whole."""
    with written(path) as unfinished, zipfile.ZipFile(unfinished, "w") as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, EPOCH)
            entry.external_attr = (0o755 if name.endswith(".so") else 0o644) << 16
            archive.writestr(entry, content, zipfile.ZIP_DEFLATED)
