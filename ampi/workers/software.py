"""Which software a process has: one result comes from one version of each package and of our sources.

Workers import their sources when they start, and a file may change meanwhile; what supervises them
compares.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from ampi.workers.job import JobError

PACKAGES = ("ampi", "numpy", "scipy", "casadi", "clarabel", "h5py")
FOR_EYES = ("ampi/report/", "ampi/cli/")  # no number depends on these
UNKNOWN = "unknown"


@lru_cache(maxsize=1)
def software() -> dict[str, str]:
    """Versions of Python and of the packages that solve and write, and a digest of the sources.

    As this process finds them at first: later, sources may have changed beneath it.
    """
    found = {f"{package}_version": package_version(package) for package in PACKAGES}
    return {"python_version": platform.python_version(), **found, "source_sha256": source_digest()}


def require_same(found: Mapping[str, str], whose: str, here: Mapping[str, str]) -> None:
    """Raise JobError if a process has found other `software` than this one."""
    other = [name for name, value in found.items() if value != here.get(name)]
    if other:
        first = other[0]
        raise JobError(
            f"{whose} has {first} {found[first]}, this process {here.get(first)}; a result is of one "
            "software, so let all be the same"
        )


def source_digest() -> str:
    """SHA-256 of the code and the tables that numbers may depend on: with or without git, and dirty."""
    digest, root = hashlib.sha256(), Path(__file__).parents[2]
    files = [f for package in ("ampi", "database") for f in (root / package).rglob("*.*")]
    for file in sorted(files):
        name = file.relative_to(root).as_posix()
        if file.suffix in (".py", ".csv") and not name.startswith(FOR_EYES):
            digest.update(name.encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()


def package_version(name: str) -> str:
    """Installed version of a package, or 'unknown'."""
    try:
        return version(name)
    except PackageNotFoundError:
        return UNKNOWN
