"""References of the flight code are those of `Guidance.reference`: cells, flags and nodes to the bit."""

from __future__ import annotations

import ctypes
from dataclasses import replace

import numpy as np
import pytest

from ampi.export.blob import ORDERS, table_blob
from ampi.guidance import Guidance
from ampi.onboard.health import Health
from ampi.onboard.reference import Mode
from ampi.onboard.subspace import Order
from tests.export.conftest import LAWS, LIMITS, LawMaker, entry_table
from tests.support.flight_blobs import blob_of, some_parameters
from tests.support.flight_code import FlightCode, compiled

MODES = [mode for mode in Mode if mode is not Mode.HERMITE]


def shape_of(guidance: Guidance) -> tuple[int, int, int]:
    return (len(guidance.table.layout), *guidance.table.conversion.shape)


def assert_equal(guidance: Guidance, flight: FlightCode, n: int, seed: int = 5) -> None:
    """To the bit, but for the sum of a matrix product."""
    d = len(guidance.table.axes)
    for p in some_parameters(guidance, np.random.default_rng(seed), n):
        ours, told = guidance.reference(p), flight.reference(p, shape_of(guidance))
        assert np.array_equal(told.nodal, ours.nodal)
        assert (told.final_time, told.hole) == (ours.final_time, ours.hole)
        assert told.cell[:d] == ours.cell
        assert told.clipped[:d] == ours.clipped
        assert told.excess[:d] == ours.excess
        assert told.health == ours.health
        assert np.array_equal(told.times, ours.times)
        sizes = np.abs(ours.rows).max(axis=1, keepdims=True)
        assert np.all(np.abs(told.rows - ours.rows) <= 1e-14 * sizes)


@pytest.mark.parametrize("mode", MODES)
def test_references_are_equal_in_every_mode(code: ctypes.CDLL, entry: LawMaker, mode: Mode) -> None:
    guidance = entry(mode=mode)
    assert_equal(guidance, FlightCode(code, blob_of(guidance)), 300)


@pytest.mark.parametrize("seed", range(6))
def test_references_are_equal_for_any_orders_and_lengths_of_axes(
    code: ctypes.CDLL, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    law, shape = LAWS["linear_quadratic"], tuple(int(n) for n in rng.integers(1, 8, 3))
    table = entry_table(law, shape)
    solved = rng.random(shape) < 0.8
    orders = [list(ORDERS)[i] for i in rng.integers(0, len(ORDERS), 3)]
    guidance = Guidance(
        replace(table, solved=solved), LIMITS, law=law, orders=orders, engine="numpy"
    )
    assert_equal(guidance, FlightCode(code, blob_of(guidance)), 150, seed)


def test_a_null_pointer_of_parameters_is_no_number(code: ctypes.CDLL, entry: LawMaker) -> None:
    guidance = entry()
    told = FlightCode(code, blob_of(guidance)).reference(None, shape_of(guidance))
    ours = guidance.reference([np.nan] * 3)
    assert told.health == ours.health
    assert np.array_equal(told.nodal, ours.nodal)


@pytest.mark.parametrize("kind", ["float32", "int16"])
def test_smaller_types_are_as_near_as_their_steps(
    code: ctypes.CDLL, entry: LawMaker, kind: str
) -> None:
    guidance = entry()
    flight = FlightCode(code, blob_of(guidance, kind=kind))
    values = guidance.table.values
    every = tuple(range(values.ndim - 2))
    half = (values.max(axis=every) - values.min(axis=every)) / (4 * 32767)
    if kind == "float32":
        half = np.abs(values).max(axis=every) * 2.0**-24
    axes = guidance.table.axes
    low, high = np.array([a[0] for a in axes]), np.array([a[-1] for a in axes])
    for p in np.random.default_rng(2).uniform(low, high, (100, 3)):
        ours, told = guidance.reference(p), flight.reference(p, shape_of(guidance))
        size = np.abs(ours.nodal)
        assert np.all(np.abs(told.nodal - ours.nodal) <= 1.001 * half + 1e-14 * size)


def test_in_single_precision_a_reference_is_near(
    code: ctypes.CDLL, entry: LawMaker, tmp_path_factory: pytest.TempPathFactory
) -> None:
    single = compiled(tmp_path_factory.mktemp("single"), "-DAMPI_SINGLE")
    guidance = entry()
    flight = FlightCode(single, blob_of(guidance, kind="float32"))
    p = np.array([axis[0] + 0.3 * (axis[-1] - axis[0]) for axis in guidance.table.axes])
    ours, told = guidance.reference(p), flight.reference(p, shape_of(guidance))
    sizes = np.abs(ours.rows).max(axis=1, keepdims=True)
    assert np.all(np.abs(told.rows - ours.rows) <= 2e-6 * sizes)
    assert told.cell[:3] == ours.cell


def test_an_order_that_flight_code_has_not_is_refused(entry: LawMaker) -> None:
    guidance = entry()
    with pytest.raises(ValueError, match=r"orders: expected 3 of those .* got hermite, hermite"):
        table_blob(guidance.table, guidance.law, guidance.limits, orders=[Order.HERMITE] * 3)


def test_nothing_is_written_of_a_table_that_is_closed(code: ctypes.CDLL, entry: LawMaker) -> None:
    guidance = entry()
    flight = FlightCode(code, blob_of(guidance)[:-1])
    told = flight.reference([0.0] * 3, shape_of(guidance))
    assert told.health == Health.NOT_BEGUN
    assert np.isnan(told.rows).all()
