"""What the records of a folder belong to, in two copies: a fault of one must not cost the records."""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Mapping
from pathlib import Path

from database.records.record_files import FINGERPRINTS, keeping


def write_fingerprint(folder: Path, fingerprint: dict[str, str], toml: str) -> None:
    """Mark a folder of records with what made it."""
    checked = {**fingerprint, "crc32": _crc_of(fingerprint)}
    text = json.dumps(checked, indent=1, sort_keys=True).encode()
    keeping({str(folder / "mission.toml"): toml.encode()})()
    keeping({str(folder / name): text for name in FINGERPRINTS})()


def read_fingerprint(folder: Path) -> dict[str, str] | None:
    """What made the records of a folder; None if no copy of it is whole.

    Raises
    ------
    OSError
        If no copy is whole, and one cannot be read.
    """
    unreadable: OSError | None = None
    for name in FINGERPRINTS:
        try:
            found = dict(json.loads((folder / name).read_text(encoding="utf-8")))
        except (FileNotFoundError, ValueError, TypeError):
            continue
        except OSError as error:
            unreadable = error
            continue
        if found.pop("crc32", "") == _crc_of(found):
            return found
    if unreadable is not None:
        raise unreadable
    return None


def label_of(fingerprint: Mapping[str, str]) -> str:
    """What the records of a build are sealed with."""
    return hashlib.sha256(json.dumps(fingerprint, sort_keys=True).encode()).hexdigest()


def _crc_of(fingerprint: dict[str, str]) -> str:
    return f"{zlib.crc32(json.dumps(fingerprint, sort_keys=True).encode()):08x}"
