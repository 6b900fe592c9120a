"""Whose records are these? A folder of records belongs to one build, and no other may go on with it.

All that the numbers of a build depend on is its fingerprint: mission, optimiser, settings, software, and
the optima that it takes over. It lies in the folder, and its digest seals every record.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ampi.dataset import SENSITIVITIES
from ampi.trajectory import Trajectory
from ampi.workers.fingerprint import differences, read_fingerprint, write_fingerprint
from ampi.workers.keeping import keeping
from database.file.provenance import made_by
from database.records.campaign import BuildError, Campaign
from database.records.record_files import FINGERPRINTS, count_records, discard_records, fingerprints


def fingerprint_of(campaign: Campaign, known: Mapping[int, Trajectory]) -> dict[str, str]:
    """All that the records of a build depend on."""
    return {
        "mission": campaign.mission.name,
        "mission_sha256": hashlib.sha256(campaign.toml.encode()).hexdigest(),
        **made_by(campaign),
        "known_sha256": _digest(known),
    }


def claim(folder: Path, fingerprint: dict[str, str], toml: str, *, resume: bool) -> dict[str, str]:
    """Mark the folder of records as this build's; refuse another's, or empty it.

    What is returned is the fingerprint of the first run: the same sources may have another revision.
    """
    found = read_fingerprint(fingerprints(folder)) if resume else None
    if resume:
        _refuse_other_build(folder, found, fingerprint)
    if found is None:
        discard_records(folder)
        found = fingerprint
    keeping({str(folder / "mission.toml"): toml.encode()})()
    write_fingerprint(fingerprints(folder), found)
    return found


def _refuse_other_build(
    folder: Path, found: dict[str, str] | None, fingerprint: dict[str, str]
) -> None:
    count = count_records(folder)
    if found is None and count:
        raise BuildError(
            f"{folder}: neither {' nor '.join(FINGERPRINTS)} can be read, so nobody knows what its "
            f"{count} finished cases belong to; put one of the two back, choose another path, or start "
            "afresh with resume off"
        )
    optional = {SENSITIVITIES: "none"} if found is not None and SENSITIVITIES in found else {}
    differing = differences(found, {**optional, **fingerprint}) if found is not None else []
    if differing:
        raise BuildError(
            f"{folder} holds cases of another build (different {', '.join(differing)}); "
            "finish that build as it was begun, choose another path, or delete the folder to start "
            "afresh"
        )


def _digest(known: Mapping[int, Trajectory]) -> str:
    """Of the optima that are not to be solved: resumed with others, a build would mix the two."""
    digest = hashlib.sha256()
    for case in sorted(known):
        flown = known[case]
        digest.update(f"{case} {flown.final_time!r} {flown.cost!r}".encode())
        digest.update(np.ascontiguousarray(flown.states).tobytes())
    return digest.hexdigest() if known else "none"
