"""What made a database: with its mission text, enough to build the file again.

Nothing here depends on host or clock. A build continues only what the same software began, and its
workers must have that, too: the file names one version of each package and one digest of the sources.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np

from ampi.dataset import CONTROLS_OF, SCHEMA_VERSION, SENSITIVITIES
from ampi.physics.state import N_STATES, STEERING
from ampi.workers.software import UNKNOWN, software
from database.records.campaign import Campaign, solver_name

SOURCES = (":/ampi", ":/database")


def provenance(campaign: Campaign, fingerprint: Mapping[str, str]) -> dict[str, object]:
    """Root attributes of the file, from what its records depend on (database.build)."""
    mission = campaign.mission
    found = {
        "schema_version": SCHEMA_VERSION,
        "title": f"Trajectory database of {mission.title}",
        "mission_toml": mission.toml,
        "parameters": np.array(campaign.grid.names, dtype=object),
        "bank_rate_effort": mission.objective.bank_rate_effort,
        "mesh": json.dumps([asdict(p) for p in mission.pseudospectral_mesh.phases]),
        **{k: v for k, v in fingerprint.items() if k != "mission_sha256"},
        "time_limit": campaign.time_limit,  # s, of one solve
        **({CONTROLS_OF: " ".join(STEERING)} if mission.n_states > N_STATES else {}),
    }
    return dict(sorted(found.items()))  # the bytes of the file depend on the order


def made_by(campaign: Campaign) -> dict[str, str]:
    """All that the numbers of a file depend on besides its mission, and the revision that has it."""
    return {
        **({SENSITIVITIES: "stored"} if campaign.sensitivities else {}),
        "solver": solver_name(campaign.solver),
        "settings": json.dumps(asdict(campaign.settings), sort_keys=True),
        "time_limit": f"{campaign.time_limit!r} s",
        "gain_settings": json.dumps(asdict(campaign.gains), sort_keys=True),
        "git_revision": git_revision(),
        **software(),
    }


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
