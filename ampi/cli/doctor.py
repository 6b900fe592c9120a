"""`ampi doctor`: what is installed here, and what that allows."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, metadata, requires, version
from pathlib import Path

from ampi.cli.console import escaped, out, print_json
from ampi.cli.options import Json

DEVELOPERS = ("test", "lint")  # extras that no user asks for
TOOLS = {
    "cc": "compiles the engine, and the FMUs that carry a binary",
    "clang": "compiles the flight code to WebAssembly, with wasm-ld",
    "wasm-ld": "links it",
    "h5dump": "reads a database without us",
    "git": "names the revision in what a checkout writes",
}
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
Rows = dict[str, str]


def doctor(as_json: Json = False) -> None:
    """Print versions, cores, BLAS, the compiled engine, optional extras and tools."""
    found = {
        "software": _software(),
        "machine": _machine(),
        "blas": _blas(),
        "engine": {"compiled engine": _engine()},
        "extras": {extra: _extra(extra) for extra in _extras()},
        "tools": {tool: _tool(tool, purpose) for tool, purpose in TOOLS.items()},
    }
    if as_json:
        print_json(found)
        return
    for title, rows in found.items():
        out.print(title)
        for name, told in rows.items():
            out.print(escaped(f"  {name:24} {told}"))


def _software() -> Rows:
    """Python, ampi and the packages that it needs."""
    import ampi

    found = {
        "python": f"{platform.python_version()} ({sys.executable})",
        "ampi": f"{ampi.__version__} ({Path(ampi.__file__).parent})",
    }
    for package, _ in sorted(_required("")):
        found[package] = _installed(package) or "MISSING; try: pip install ampi"
    return found


def _required(extra: str) -> Iterator[tuple[str, str]]:
    """Name and whole requirement of what ampi asks for: by itself, or for one of its extras."""
    try:
        asked = requires("ampi") or []
    except PackageNotFoundError:
        return
    for requirement in asked:
        wanted, _, condition = requirement.partition(";")
        marker = condition.partition("extra ==")[2].strip(" \"'") if "extra ==" in condition else ""
        if marker == extra:
            end = next((i for i, sign in enumerate(wanted) if sign in "[<>=!~ ("), len(wanted))
            yield wanted[:end].strip(), requirement


def _installed(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _machine() -> Rows:
    import joblib

    allowed = joblib.cpu_count()
    physical = joblib.cpu_count(only_physical_cores=True)
    return {
        "system": f"{platform.system()} {platform.release()}, {platform.machine()}",
        "cores": f"{allowed} may be used ({physical} physical)",
        "threads asked for": ", ".join(
            f"{name}={os.environ[name]}" for name in THREADS if name in os.environ
        )
        or "nothing: each worker limits itself to one",
    }


def _blas() -> Rows:
    """The linear algebra that numpy and scipy have loaded."""
    import numpy.linalg  # noqa: F401
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_info

    return {
        _of_package(
            one["filepath"]
        ): f"{one['internal_api']} {one.get('version') or '?'}, {one['num_threads']} "
        f"thread{'s' * (one['num_threads'] != 1)}"
        for one in threadpool_info()
    } or {"none": "no library that threadpoolctl knows"}


def _of_package(library: str) -> str:
    """The package that brings a library: numpy of numpy.libs/libopenblas.so."""
    return Path(library).parent.name.removesuffix(".libs")


def _engine() -> str:
    from ampi._native.engine import WHY_NOT, is_available

    return "there: flights in C" if is_available() else f"not there, flights in numpy: {WHY_NOT}"


def _extras() -> list[str]:
    try:
        every = metadata("ampi").get_all("Provides-Extra") or []
    except PackageNotFoundError:
        return []
    return [extra for extra in every if extra not in DEVELOPERS]


def _extra(extra: str) -> str:
    """Whether all its packages are there, with their versions, or how to get them."""
    packages = [package for package, _ in _required(extra)]
    versions = {package: _installed(package) for package in packages}
    missing = [package for package, number in versions.items() if number is None]
    if missing or not packages:
        return f"not there ({', '.join(missing) or 'unknown'}); try: pip install 'ampi[{extra}]'"
    return ", ".join(f"{package} {number}" for package, number in versions.items())


def _tool(tool: str, purpose: str) -> str:
    place = shutil.which(tool)
    return f"{place} ({purpose})" if place else f"not there ({purpose})"
