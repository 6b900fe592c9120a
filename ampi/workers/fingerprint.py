"""What the records of a folder belong to, in copies: a fault of one must not cost the records."""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path

from ampi.workers.keeping import keeping

READABLE = 50  # characters of a value, to be shown


def write_fingerprint(copies: Sequence[Path], fingerprint: Mapping[str, str]) -> None:
    """Mark a folder of records with what made it, in each of the files `copies`."""
    checked = {**fingerprint, "crc32": _crc_of(fingerprint)}
    text = json.dumps(checked, indent=1, sort_keys=True).encode()
    keeping({str(copy): text for copy in copies})()


def read_fingerprint(copies: Sequence[Path]) -> dict[str, str] | None:
    """What made the records of a folder; None if no copy of it is whole.

    Raises
    ------
    OSError
        If no copy is whole, and one cannot be read.
    """
    unreadable: OSError | None = None
    for copy in copies:
        try:
            found = dict(json.loads(copy.read_text(encoding="utf-8")))
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
    """What the records are sealed with."""
    return hashlib.sha256(json.dumps(fingerprint, sort_keys=True).encode()).hexdigest()


def differences(found: Mapping[str, str], expected: Mapping[str, str]) -> list[str]:
    """What differs, with the values where they can be read; the same sources may have two revisions."""
    return [
        f"{key} ({found.get(key)} there, {value} here)" if len(value) < READABLE else key
        for key, value in expected.items()
        if found.get(key) != value and key != "git_revision"
    ]


def _crc_of(fingerprint: Mapping[str, str]) -> str:
    return f"{zlib.crc32(json.dumps(fingerprint, sort_keys=True).encode()):08x}"
