"""Bytes that say themselves whether they are whole, and what they belong to."""

from __future__ import annotations

import zlib
from functools import lru_cache

CHECKSUM_BYTES = 4


def mark(label: str, number: int) -> int:
    """Where a CRC-32 begins that is to be of a result and of what it belongs to."""
    return zlib.crc32(str(number).encode(), _crc_of_text(label))


@lru_cache(maxsize=8)
def _crc_of_text(label: str) -> int:
    return zlib.crc32(label.encode())


def sealed(raw: bytes, start: int) -> bytes:
    """With its CRC-32 from `start` (`mark`) behind it."""
    return raw + zlib.crc32(raw, start).to_bytes(CHECKSUM_BYTES, "little")


def unsealed(raw: bytes, start: int) -> memoryview:
    """What was `sealed`; ValueError if it is not that any more."""
    view = memoryview(raw)
    body, checksum = view[:-CHECKSUM_BYTES], view[-CHECKSUM_BYTES:]
    if zlib.crc32(body, start).to_bytes(CHECKSUM_BYTES, "little") != checksum:
        raise ValueError("a record does not match its checksum")
    return body
