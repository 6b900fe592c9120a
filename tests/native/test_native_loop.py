"""The closed loop of the compiled engine against numpy's: the same flights."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi._native.engine import core
from ampi.guidance import Guidance
from ampi.missions.family import MissionFamily
from ampi.missions.flight_sections import EntrySection
from ampi.missions.mission import Mission
from ampi.physics.state import ENTRY_STATES
from ampi.simulation import closed_loop, native_loop
from ampi.simulation.closed_loop import FlightBatch
from ampi.simulation.plant import FlightStatus
from ampi.simulation.world_loading import load_world, shipped_worlds
from tests.native.conftest import LAWS
from tests.support.truths import nominal_truth

Array = NDArray[np.float64]
METRES = np.array([1.0, 6.4e6, 6.4e6, 1e3, 1e6, 1e6, 1e6])[:, None]  # of the states' differences
TOLERANCE = 1e-6  # m


def flown(engine: Any, mission: Mission, guidance: Guidance, world: str, n: int) -> FlightBatch:
    guidance = guidance.on_engine("native" if engine is native_loop else "numpy")
    truth = load_world(world).draw(mission, n, 11)
    batch: FlightBatch = engine.fly_batch(mission.family(truth.parameters), guidance, truth, 2.0)
    return batch


def assert_equal_bits(one: FlightBatch, two: FlightBatch) -> None:
    for field in fields(FlightBatch):
        a, b = getattr(one, field.name), getattr(two, field.name)
        assert a.dtype == b.dtype, field.name
        assert np.array_equal(a, b, equal_nan=a.dtype.kind == "f"), field.name


def assert_same_flights(native: FlightBatch, numpy: FlightBatch) -> None:
    for name in ("status", "clipped", "hole", "times", "saturation"):
        assert np.array_equal(getattr(native, name), getattr(numpy, name)), name
    for name in ("states", "reference_states"):
        a, b = getattr(native, name), getattr(numpy, name)
        assert np.array_equal(np.isnan(a), np.isnan(b)), name
        assert np.nanmax(np.abs(a - b) * METRES) < TOLERANCE, name
    assert np.abs((native.final_states - numpy.final_states) * METRES.T).max() < TOLERANCE
    for name in ("final_time", "activity", "rebound", "bank_rate", "angle_of_attack", "peak"):
        assert getattr(native, name) == pytest.approx(
            getattr(numpy, name), abs=1e-9, rel=1e-9, nan_ok=True
        ), name


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("world", shipped_worlds())
def test_every_law_flies_the_same_in_every_world(
    short: Mission, guidances: dict[str, Guidance], world: str, law: str
) -> None:
    guidance = guidances[law]
    native = flown(native_loop, short, guidance, world, 4)
    assert_same_flights(native, flown(closed_loop, short, guidance, world, 4))


@pytest.mark.slow
def test_a_whole_flight_has_the_same_bits_where_the_sines_have(
    mission: Mission, guidance: Guidance
) -> None:
    """Numpy takes them from the C library unless the processor has AVX-512."""
    native = flown(native_loop, mission, guidance, "everything", 5)
    numpy = flown(closed_loop, mission, guidance, "everything", 5)
    assert_same_flights(native, numpy)
    angles = np.linspace(-4.0, 4.0, 10_000)
    code = np.array([core().OPCODES["sincos_v"], 1, 2, 0, 0xFFFF, 0], dtype=np.uint16)
    found = np.empty((2, len(angles)))
    places = np.array([1, 2], dtype=np.uint16)
    core().evaluate(code, places, 3, np.zeros(0), angles, len(angles), found, "")
    if np.array_equal(found, [np.sin(angles), np.cos(angles)]):
        assert_equal_bits(native, numpy)


def test_no_flight_sees_its_company(short: Mission, guidance: Guidance) -> None:
    """More than the engine flies abreast, in reverse order, alone: the same bits."""
    n = core().LANES + 9
    truth = load_world("everything").draw(short, n, 3)
    family = short.family(truth.parameters)
    together = native_loop.fly_batch(family, guidance, truth)
    order = np.arange(n)[::-1]
    reverse = native_loop.fly_batch(family.take(order), guidance, truth.take(order))
    for name in ("final_states", "final_time", "peak", "activity", "states", "bank_rate"):
        assert np.array_equal(
            getattr(reverse, name)[::-1], getattr(together, name), equal_nan=True
        ), name
    for one in (0, n - 1):
        alone = native_loop.fly_batch(family.take([one]), guidance, truth.take([one]))
        assert np.array_equal(alone.final_states[0], together.final_states[one])
        assert np.array_equal(alone.peak[0], together.peak[one])


def test_every_instruction_set_has_the_same_bits(short: Mission, guidance: Guidance) -> None:
    truth = load_world("everything").draw(short, 3, 5)
    family = short.family(truth.parameters)
    best, baseline = (
        native_loop.fly_batch(family, guidance, truth, 5.0, name)
        for name in (core().INSTRUCTION_SET, core().BASELINE)
    )
    assert_equal_bits(best, baseline)


# --- flights that end otherwise -------------------------------------------------------------------


def from_entries(mission: Mission, entries: Array) -> MissionFamily[Mission]:
    sections = (
        EntrySection.model_construct(**dict(zip(ENTRY_STATES, row, strict=True)))
        for row in entries.tolist()
    )
    return MissionFamily.of([mission.model_copy(update={"entry": s}) for s in sections])


CASES: dict[str, tuple[int, float, FlightStatus]] = {  # an entry state, its value, the end
    "no number": (3, np.nan, FlightStatus.NOT_FINITE),
    "infinitely high": (0, np.inf, FlightStatus.NOT_FINITE),
    "slow": (3, 500.0, FlightStatus.STARTED_SLOW),
    "low": (0, 20.0, FlightStatus.GROUND),
    "upwards": (4, 0.6, FlightStatus.TIME_LIMIT),
    "vertical": (4, np.pi / 2, FlightStatus.TIME_LIMIT),
    "at the pole": (2, np.pi / 2, FlightStatus.TIME_LIMIT),
    "far beyond a turn": (5, 1e9, FlightStatus.TIME_LIMIT),
}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_absurd_entries_end_as_in_numpy(mission: Mission, guidance: Guidance) -> None:
    entries = np.tile(mission.entry_state, (len(CASES), 1))
    for row, (state, value, _) in zip(entries, CASES.values(), strict=True):
        row[state] = value
    family, truth = from_entries(mission, entries), nominal_truth(entries[:, [3, 4]])
    guidance = guidance.at_cycle(2.0)
    native = native_loop.fly_batch(family, guidance, truth)
    numpy = closed_loop.fly_batch(family, guidance.on_engine("numpy"), truth)
    assert native.status.tolist() == numpy.status.tolist()
    certain = ["no number", "infinitely high", "slow", "low"]
    for name, status, (_, _, expected) in zip(CASES, native.status, CASES.values(), strict=True):
        assert name not in certain or status == expected, name
    assert np.array_equal(np.isnan(native.states), np.isnan(numpy.states))
    for name in ("final_states", "final_time", "peak", "saturation"):
        assert getattr(native, name) == pytest.approx(
            getattr(numpy, name), rel=1e-6, nan_ok=True
        ), name


def test_bad_numbers_of_the_truth_are_a_status(short: Mission, guidance: Guidance) -> None:
    truth = load_world("entry").draw(short, 3, 1)
    broken = truth.parameters.copy()
    broken[1, 0] = np.nan
    batch = native_loop.fly_batch(short.family(broken), guidance, replace(truth, parameters=broken))
    assert batch.status[1] == FlightStatus.NOT_FINITE
    assert np.isnan(batch.final_states[1]).all()
    assert batch.status[[0, 2]].tolist() == [FlightStatus.REACHED_SPEED] * 2
