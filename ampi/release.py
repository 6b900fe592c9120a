"""The version of this software: of pyproject.toml, as it was installed, and of nowhere else."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version


def _installed() -> str:
    try:
        return version("ampi")
    except PackageNotFoundError:  # sources on a path, never installed
        return "unknown"


RELEASE = _installed()
