"""What made a database: with its mission text, enough to build the file again.

Nothing here depends on host or clock. A build continues only what the same software began: the file
names one version of each package, and its cases must be of that one.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
from collections.abc import Mapping
from dataclasses import asdict
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from ampi.dataset import SCHEMA_VERSION
from ampi.scp.exact_hessian import SolverSettings
from database.campaign import Campaign, solver_name

PACKAGES = ("ampi", "numpy", "scipy", "casadi", "clarabel", "h5py")
SOURCES = (":/ampi", ":/database")
UNKNOWN = "unknown"


def provenance(campaign: Campaign, made: Mapping[str, object]) -> dict[str, object]:
    """Root attributes of the file; `made` is `made_by` of the campaign."""
    mission = campaign.mission
    return {
        "schema_version": SCHEMA_VERSION,
        "title": f"Trajectory database of {mission.title}",
        "mission": mission.name,
        "mission_toml": mission.toml,
        "parameters": np.array(campaign.grid.names, dtype=object),
        "bank_rate_effort": mission.objective.bank_rate_effort,
        "mesh": json.dumps([asdict(p) for p in mission.pseudospectral_mesh.phases]),
        **made,
    }


def made_by(campaign: Campaign) -> dict[str, object]:
    """All that the numbers of a file depend on besides its mission."""
    return {
        "solver": solver_name(campaign.solver),
        "solver_settings": json.dumps(asdict(SolverSettings()), sort_keys=True),
        "time_limit": campaign.time_limit,  # s, of one solve
        "gain_settings": json.dumps(asdict(campaign.gains), sort_keys=True),
        "git_revision": git_revision(),
        **software(),
    }


@lru_cache(maxsize=1)
def software() -> dict[str, str]:
    """Versions of Python and of the packages that solve and write."""
    found = {f"{package}_version": package_version(package) for package in PACKAGES}
    return {"python_version": platform.python_version(), **found}


def package_version(name: str) -> str:
    """Installed version of a package, or 'unknown'."""
    try:
        return version(name)
    except PackageNotFoundError:
        return UNKNOWN


def git_revision() -> str:
    """The last commit that changed the sources, in the checkout that this file belongs to.

    With '-dirty' behind it where they have been changed since; 'unknown' for an installed package.
    """
    try:
        _git("ls-files", "--error-unmatch", Path(__file__).name)  # no checkout of something else
        revision = _git("log", "-1", "--format=%H", "--", *SOURCES)
        changed = _git("status", "--porcelain", "--untracked-files=no", "--", *SOURCES)
    except (OSError, subprocess.CalledProcessError):
        return UNKNOWN
    return f"{revision}-dirty" if changed else revision


def _git(*arguments: str) -> str:
    """In the folder of this file, whatever repository the environment names."""
    return subprocess.run(
        ["git", *arguments],
        cwd=Path(__file__).parent,
        env={k: v for k, v in os.environ.items() if not k.startswith("GIT_")},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
