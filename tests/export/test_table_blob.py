"""The blob: what it says of itself, and what becomes of one that is damaged, foreign or wrong."""

from __future__ import annotations

import ctypes
import struct
import zlib
from dataclasses import dataclass, replace

import numpy as np
import pytest

from ampi.export.blob import KINDS, MAGIC, table_blob
from ampi.guidance import Guidance
from ampi.tracking.drag_reference import LateralLogic
from ampi.tracking.linear_quadratic import LinearQuadratic
from tests.export.conftest import LIMITS, LawMaker
from tests.support.flight_blobs import blob_of, numpy_commands, recorded
from tests.support.flight_code import FlightCode

OK, TRUNCATED, FOREIGN, BYTE_ORDER, VERSION, CHECKSUM, TOO_LARGE, INCONSISTENT = range(8)
HEADER, SIZES = 32, 64


@pytest.fixture(scope="module")
def blob(entry: LawMaker) -> bytes:
    return blob_of(entry())


def resealed(blob: bytes) -> bytes:
    """With the size and the checksum of what it is now: only its contents can be wrong."""
    body = blob[HEADER:]
    return blob[:16] + struct.pack("<2I8x", len(body), zlib.crc32(body)) + body


def with_word(blob: bytes, place: int, word: int) -> bytes:
    return blob[:place] + struct.pack("<I", word) + blob[place + 4 :]


def text_of(blob: bytes) -> str:
    length = struct.unpack_from("<I", blob, HEADER + 4 * 14)[0]
    return blob[HEADER + SIZES : HEADER + SIZES + length].decode()


def test_it_explains_itself(entry: LawMaker) -> None:
    guidance = entry("drag_shuttle", mode="cubic")
    text = text_of(blob_of(guidance, kind="int16", about="mission test\nparameters a, b, c"))
    assert "law drag_shuttle, mode cubic" in text
    assert "mission test\nparameters a, b, c\n" in text
    assert "offset + scale x stored" in text
    for row in guidance.table.layout.rows:
        assert f"  {row.name} [{row.unit}]\n" in text


@pytest.mark.parametrize("kind", KINDS)
def test_it_is_the_same_twice_and_opens(code: ctypes.CDLL, entry: LawMaker, kind: str) -> None:
    blob = blob_of(entry(), kind=kind)
    assert blob == blob_of(entry(), kind=kind)
    assert FlightCode(code, blob).status == OK
    assert len(blob) % 8 == 0
    assert blob[:8] == MAGIC


def test_every_truncation_is_told(code: ctypes.CDLL, blob: bytes) -> None:
    for size in [*range(200), *range(200, len(blob), 997), len(blob) - 1]:
        assert FlightCode(code, blob[:size]).status == TRUNCATED
    assert FlightCode(code, blob + bytes(8)).status == TRUNCATED
    for size in [*range(HEADER + SIZES, HEADER + 2000, 8), *range(2000, len(blob), 4096)]:
        assert FlightCode(code, resealed(blob[:size])).status == INCONSISTENT


def test_every_damaged_byte_of_the_header_is_told(code: ctypes.CDLL, blob: bytes) -> None:
    expected = [FOREIGN] * 8 + [BYTE_ORDER] * 4 + [VERSION] * 4
    expected += [TRUNCATED] * 4 + [CHECKSUM] * 4 + [VERSION] * 8
    for place, status in enumerate(expected):
        damaged = bytearray(blob)
        damaged[place] ^= 0x41
        assert FlightCode(code, bytes(damaged)).status == status


def test_damaged_bytes_of_the_body_are_told(code: ctypes.CDLL, blob: bytes) -> None:
    for place in [*range(HEADER, HEADER + 400), *range(HEADER + 400, len(blob), 499)]:
        damaged = bytearray(blob)
        damaged[place] ^= 1 << (place % 8)
        assert FlightCode(code, bytes(damaged)).status == CHECKSUM


def test_a_blob_of_the_other_byte_order_is_told(code: ctypes.CDLL, blob: bytes) -> None:
    mark = blob[8:12][::-1]
    assert FlightCode(code, blob[:8] + mark + blob[12:]).status == BYTE_ORDER


def test_what_no_writer_makes_is_told_though_its_checksum_is_right(
    code: ctypes.CDLL, entry: LawMaker
) -> None:
    """Every word of the sizes and of the counts of axes and segments, at the edges of its range."""
    blob = blob_of(entry())
    begin = HEADER + SIZES + -(-len(text_of(blob)) // 8) * 8
    words = [HEADER + 4 * i for i in range(14)]
    words += [begin + 40 * i + 4 * k for i in range(3) for k in range(2)]
    words += [begin + 120 + 48 * i + 4 * k for i in range(3) for k in range(2)]
    rng = np.random.default_rng(0)
    parameters = np.array([axis[0] for axis in entry().table.axes])
    for place in words:
        old = struct.unpack_from("<I", blob, place)[0]
        for word in (0, 1, old + 1, old - 1, 2 * old, 0xFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF):
            flight = FlightCode(code, resealed(with_word(blob, place, word % 2**32)))
            assert flight.status in (OK, TOO_LARGE, INCONSISTENT)
            flight.begin(parameters)  # whatever it is, it can be flown
            flight.fly(np.arange(3.0), rng.standard_normal((3, 8)))
    drag = blob_of(entry("drag_shuttle"))
    assert FlightCode(code, resealed(with_word(drag, HEADER + 4, 3))).status == INCONSISTENT
    for place in (
        HEADER + 8,
        HEADER + 12,
        HEADER + 16,
        HEADER + 20,
    ):  # of axes, rows, nodes, points
        assert FlightCode(code, resealed(with_word(blob, place, 10**6))).status == TOO_LARGE
        assert FlightCode(code, resealed(with_word(blob, place, 2))).status == INCONSISTENT


@pytest.mark.parametrize("kind", ["float64", "float32"])
def test_numbers_that_are_none_are_told(code: ctypes.CDLL, entry: LawMaker, kind: str) -> None:
    blob = blob_of(entry(), kind=kind)
    begin = HEADER + SIZES + -(-len(text_of(blob)) // 8) * 8 + 120 + 144
    not_a_number = struct.pack("<d", np.nan) if kind == "float64" else struct.pack("<f", np.nan) * 2
    places = [*range(begin, begin + 8 * 34, 8)]  # settings
    for place in places:
        damaged = blob[:place] + struct.pack("<d", np.inf) + blob[place + 8 :]
        assert FlightCode(code, resealed(damaged)).status == INCONSISTENT
    assert FlightCode(code, resealed(blob[:-16] + not_a_number + blob[-8:])).status == INCONSISTENT
    edges = begin - 120 - 144 + 16  # least, greatest, nominal of the first axis
    wrong = [(begin + 8 * i, 0.0) for i in range(4)]  # limits and cycle
    wrong += [(edges, 1e9), (edges + 8, -1e9), (edges + 8, np.inf), (edges + 16, 1e9)]
    for place, number in wrong:
        damaged = blob[:place] + struct.pack("<d", number) + blob[place + 8 :]
        assert FlightCode(code, resealed(damaged)).status == INCONSISTENT


def test_axes_that_do_not_increase_are_told(code: ctypes.CDLL, entry: LawMaker) -> None:
    guidance = entry()
    blob = blob_of(guidance)
    for axis in guidance.table.axes:
        assert FlightCode(code, blob).status == OK
        turned = blob.replace(axis.tobytes(), axis[::-1].tobytes())
        assert turned != blob
        assert FlightCode(code, resealed(turned)).status == INCONSISTENT


def test_settings_that_cannot_be_written_are_refused(entry: LawMaker) -> None:
    guidance = entry()

    @dataclass(frozen=True)
    class Own(LinearQuadratic):
        pass

    with pytest.raises(ValueError, match="law: expected one that flight code has"):
        table_blob(guidance.table, Own(), LIMITS)
    with pytest.raises(ValueError, match="law: expected a table with the rows of drag_shuttle"):
        table_blob(guidance.table, entry("drag_shuttle").law, LIMITS)
    with pytest.raises(ValueError, match="kind: expected one of float64, float32, int16"):
        table_blob(guidance.table, guidance.law, LIMITS, kind="int8")  # type: ignore[arg-type]


def test_gains_of_ones_own_are_flown(code: ctypes.CDLL, entry: LawMaker) -> None:
    """Every gain reaches the C: with others the commands are others, and still those of numpy."""
    rng = np.random.default_rng(1)
    for name in ("drag_shuttle", "drag_sliding_mode"):
        guidance = entry(name)
        lateral = LateralLogic(deadband=0.01, least_range=2e5, turning=0.3, braking=0.01)
        law = replace(guidance.law, felt_drag=0.3, lateral=lateral)  # type: ignore[type-var]
        own = Guidance(guidance.table, LIMITS, law=law, engine="numpy")
        p = np.array([axis[0] for axis in own.table.axes])
        given = recorded(own, p, rng, 200)
        own.begin(p)
        flight = FlightCode(code, blob_of(own))
        flight.begin(p)
        numbers, _ = numpy_commands(own, *given)
        np.testing.assert_allclose(flight.fly(*given)["numbers"], numbers, rtol=0.0, atol=1e-11)
