"""Drag-tracking laws at one instant: what they ask for, from memory to memory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.onboard.row_layout import DRAG_TRACKING
from ampi.physics.planet import WGS84
from ampi.tracking.drag_reference import DragReference
from ampi.tracking.drag_shuttle import DragShuttle
from ampi.tracking.drag_sliding_mode import DISTURBANCE, DragSlidingMode
from ampi.tracking.law import Told

Array = NDArray[np.float64]
Law = DragSlidingMode | DragShuttle

MU, RADIUS = WGS84.gravitational_parameter, WGS84.equatorial_radius
SLIDING = DragSlidingMode(gravitational_parameter=MU, radius=RADIUS)
SHUTTLE = DragShuttle(gravitational_parameter=MU, radius=RADIUS)
MODULATING = [replace(law, modulates=True) for law in (SLIDING, SHUTTLE)]
LAWS = pytest.mark.parametrize(
    "law",
    [SLIDING, SHUTTLE, *MODULATING],
    ids=lambda law: f"{law.name}{' and angle' * law.modulates}",
)
MODULATING_LAWS = pytest.mark.parametrize("law", MODULATING, ids=lambda law: law.name)
FLIGHT_PATH_ANGLE, AZIMUTH, BANK = 4, 5, 6
STEP = 0.5
laws = settings(deadline=None, max_examples=100)


def reference(n: int = 1, bank: float = -0.6, bank_rate: float = 0.01) -> Array:
    """Rows (r, n) at 40 km and 3 km/s: D = 8 m/s², L/D = 1.7, 700 km to go."""
    states = [4e4, -0.3, 1.2, 3000.0, -0.03, -1.8, bank]
    rows = np.array([*states, bank_rate, np.log(8.0), 1.7, 7e3, 5.0, 7e5])
    return np.ascontiguousarray(np.repeat(rows[:, None], n, axis=1))


def told(at: Array, *, drag: float = 1.0, lift: float = 1.0, **moved: float) -> Told:
    """On the reference, but with sensed `drag` and `lift` times its own and states moved."""
    states = at[DRAG_TRACKING.states].copy()
    for name, by in moved.items():
        states[DRAG_TRACKING.index(name)] += by
    own = np.exp(at[DRAG_TRACKING.index("log_drag")])
    lifting = lift * own * at[DRAG_TRACKING.index("lift_to_drag")]
    sensed = np.stack([-drag * own, lifting * np.cos(states[BANK]), lifting * np.sin(states[BANK])])
    return Told(states, sensed, STEP, np.zeros(at.shape[1]))


def asked(law: Law, at: Array, now: Told) -> tuple[float, float]:
    """Of one flight, from a fresh memory."""
    rate, angle = law.command(at, now, law.memory(1))
    return float(rate[0]), float(angle[0])


@LAWS
@pytest.mark.parametrize("bank", [-0.6, 0.6, 1.0, 0.02])
def test_on_the_reference_the_rate_is_the_reference_s(law: Law, bank: float) -> None:
    at = reference(bank=bank)
    memory = law.memory(1)
    for _ in range(50):
        rate, angle = law.command(at, told(at), memory)
        assert rate[0] == pytest.approx(0.01, abs=1e-9)
        assert angle[0] == pytest.approx(0.0, abs=1e-12)


@LAWS
@pytest.mark.parametrize("bank", [-0.6, 0.6])
def test_too_much_drag_and_too_steep_a_descent_ask_for_lift_upwards(law: Law, bank: float) -> None:
    """That is, for a smaller bank angle; and the opposite for a larger one."""
    at = reference(bank=bank, bank_rate=0.0)
    at[FLIGHT_PATH_ANGLE] = 0.0  # where equal energies are equal climbs
    for now, upwards in (
        (told(at, drag=1.1), True),
        (told(at, drag=0.9), False),
        (told(at, flight_path_angle=-0.01), True),
        (told(at, flight_path_angle=0.01), False),
        (told(at, lift=0.9), True),
    ):
        rate, _ = asked(law, at, now)
        assert rate * np.sign(bank) * (-1.0 if upwards else 1.0) > 1e-4


def test_a_law_that_does_not_modulate_leaves_the_angle_of_attack() -> None:
    for law in (SLIDING, SHUTTLE):
        assert asked(law, reference(), told(reference(), drag=1.05))[1] == 0.0


@MODULATING_LAWS
def test_a_small_error_of_drag_is_answered_whole_if_there_is_lift_to_spare(law: Law) -> None:
    """δα = −e/slope; with the lift upwards already none is given away."""
    at, memory = reference(bank=0.6), law.memory(1)
    for e in (0.02, -0.02):
        _, angle = law.command(at, told(at, drag=np.exp(e)), memory)
        assert angle[0] == pytest.approx(-e / 5.0, rel=1e-12)
        # flown: the drag is the reference's, and the error without δα is still e
        flown = replace(told(at), change=np.array([-e / 5.0]))
        assert law.command(at, flown, memory)[1][0] == pytest.approx(-e / 5.0, rel=1e-12)
    level = reference(bank=0.0)
    level[FLIGHT_PATH_ANGLE] = 0.0
    assert asked(law, level, told(level, drag=1.2))[1] == 0.0
    assert asked(law, level, told(level, drag=0.9))[1] > 0.0


@MODULATING_LAWS
def test_where_the_drag_answers_no_angle_or_is_not_felt_none_is_asked_for(law: Law) -> None:
    flat, thin = reference(), reference()
    flat[DRAG_TRACKING.index("drag_slope")] = 0.05
    thin[DRAG_TRACKING.index("log_drag")] = np.log(0.4)
    assert asked(law, flat, told(flat, drag=1.1))[1] == 0.0
    assert asked(law, thin, told(thin, drag=1.1))[1] == 0.0


def test_the_bank_angle_of_the_shuttle_s_law_answers_the_drag_without_the_change() -> None:
    """What δα has taken away is still an error that the bank angle is to remove."""
    at = reference(bank=0.6, bank_rate=0.0)
    at[FLIGHT_PATH_ANGLE] = 0.0
    _, modulating = MODULATING
    flown = replace(told(at), change=np.array([-0.02]))
    rate, _ = asked(modulating, at, flown)
    alone, _ = asked(SHUTTLE, at, told(at, drag=np.exp(0.1), lift=np.exp(0.1)))
    assert rate == pytest.approx(alone, rel=1e-9)
    assert rate < -1e-3


def test_the_observer_finds_a_constant_disturbance_under_a_known_input() -> None:
    memory, s, true = SLIDING.memory(1), np.zeros(1), 3e-4
    for k in range(100):
        known = np.array([2e-4 * np.sin(0.05 * k)])  # 1/s², held over a step
        s = s + STEP * (known + true)
        SLIDING._observe(memory, s, known, STEP)
    assert memory[DISTURBANCE, 0] == pytest.approx(true, rel=1e-6)


def test_less_lift_than_the_model_s_is_learned_up_to_its_bound() -> None:
    """A flight that sinks although its sensed lift should hold it: d > 0 asks for more lift."""
    at, memory = reference(), SLIDING.memory(1)
    for k in range(40):
        SLIDING.command(at, told(at, flight_path_angle=-1e-4 * k), memory)
    inverse = 1.0 / 7e3 + 2.0 * 9.7 / 3000.0**2
    bound = SLIDING.most_disturbance * 8.0 * 1.7 * inverse
    assert 0.0 < memory[DISTURBANCE, 0] <= bound * 1.01


@LAWS
def test_the_sign_is_the_reference_s_within_the_deadband_and_the_heading_s_outside(
    law: Law,
) -> None:
    band = law.lateral.deadband
    at = reference(bank=0.6, bank_rate=0.0)
    near = law.command(at, told(at, azimuth=0.9 * band), law.memory(1))[0]
    assert near[0] == pytest.approx(0.0, abs=1e-9)
    memory = law.memory(1)
    far = law.command(at, told(at, azimuth=1.1 * band), memory)[0]  # too far right: turn left
    assert far[0] < -0.05
    still = law.command(at, told(at, azimuth=0.6 * band), memory)[0]  # until half of it
    assert still[0] < -0.05
    back = law.command(at, told(at, azimuth=0.4 * band), memory)[0]
    assert back[0] == pytest.approx(0.0, abs=1e-9)


@LAWS
def test_being_aside_counts_as_heading_over_the_range_to_go(law: Law) -> None:
    """12 km right of the reference with 700 km to go is 0.98°; westward, that is to the north."""
    at = reference(bank=0.6, bank_rate=0.0)
    at[AZIMUTH] = -0.5 * np.pi
    at[DRAG_TRACKING.index("range_to_go")] = 7e5
    for north, left in ((12e3, True), (-12e3, False)):
        now = told(at, latitude=north / RADIUS)
        error = law.lateral.heading_error(at, now.state, law.radius)
        assert error[0] == pytest.approx(north / 7e5, rel=1e-9)
        assert (asked(law, at, now)[0] < -0.05) == left


@LAWS
@laws
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 40))
def test_a_batch_is_its_flights_to_the_bit(law: Law, seed: int, n: int) -> None:
    at, now = random_flights(seed, n)
    memory, alone = law.memory(n), [law.memory(1) for _ in range(n)]
    for _ in range(3):
        both = np.stack(law.command(at, now, memory))
        for i, own in enumerate(alone):
            one = slice(i, i + 1)
            part = Told(
                now.state[:, one].copy(), now.sensed[:, one].copy(), now.step, now.change[one]
            )
            single = np.stack(law.command(at[:, one].copy(), part, own))
            assert np.array_equal(both[:, one], single)
            assert np.array_equal(memory[:, one], own)


def random_flights(seed: int, n: int) -> tuple[Array, Told]:
    rng = np.random.default_rng(seed)
    at = reference(n) * rng.uniform(0.8, 1.2, (len(DRAG_TRACKING), n))
    sizes = np.array([1e3, 0.01, 0.01, 50.0, 0.02, 0.05, 0.5])[:, None]
    state = at[DRAG_TRACKING.states] + sizes * rng.standard_normal((7, n))
    return at, Told(state, rng.normal(0.0, 10.0, (3, n)), STEP, rng.uniform(-0.1, 0.1, n))


@LAWS
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 0.0])
def test_accelerations_that_are_none_leave_the_reference_and_no_trace(law: Law, bad: float) -> None:
    at = reference()
    memory = law.memory(1)
    gone = replace(told(at), sensed=np.full((3, 1), bad))
    with np.errstate(all="ignore"):
        for _ in range(3):
            rate, angle = law.command(at, gone, memory)
    assert rate[0] == pytest.approx(0.01, abs=1e-9)
    assert angle[0] == 0.0
    assert np.isfinite(memory).all()
    assert law.command(at, told(at), memory)[0][0] == pytest.approx(0.01, abs=1e-9)


@LAWS
@pytest.mark.parametrize("row", range(7))
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_states_that_are_none_poison_neither_command_nor_memory(
    law: Law, row: int, bad: float
) -> None:
    at = reference()
    memory, now = law.memory(1), told(at, drag=1.02)
    law.command(at, now, memory)
    lost = replace(now, state=now.state.copy())
    lost.state[row] = bad
    with np.errstate(all="ignore"):
        rate, angle = law.command(at, lost, memory)
    assert np.isfinite([rate[0], angle[0]]).all()
    assert np.isfinite(memory).all()


def rows_of_an_entry(n: int = 60) -> tuple[Array, Array]:
    """Times (1, n) and rows (1, n, r): speed and height fall, drag rises from 1 mm/s²."""
    times = np.linspace(0.0, 300.0, n)
    rows = np.repeat(reference().T[None], n, axis=1)
    share = np.linspace(0.0, 1.0, n)
    rows[0, :, 0] = 1e5 - 7e4 * share
    rows[0, :, 3] = 5000.0 - 4000.0 * share**2
    rows[0, :, DRAG_TRACKING.index("log_drag")] = np.log(1e-3) + 10.0 * share
    return times[None], rows


def test_the_look_up_goes_by_time_until_the_air_is_felt_then_by_energy() -> None:
    law: DragReference = SLIDING
    times, rows = rows_of_an_entry()
    along = law.along(times, rows)
    assert np.all(np.diff(along) > 0.0)
    for k in range(times.shape[1]):
        at = np.ascontiguousarray(rows[0, k][:, None])
        value = law.now(times[0, k], told(at))
        assert value[0] == pytest.approx(along[0, k], abs=0.1)
    late = told(np.ascontiguousarray(rows[0, 50][:, None]))
    assert law.now(1e3, late)[0] == law.now(0.0, late)[0]  # felt: whatever the time
    blind = replace(late, sensed=np.full((3, 1), np.nan))
    assert law.now(0.0, blind)[0] == law.now(0.0, late)[0]


def test_a_reference_that_gains_energy_by_rounding_still_increases() -> None:
    times, rows = rows_of_an_entry()
    rows[0, 30:33, :7] = rows[0, 30, :7]
    assert np.all(np.diff(SLIDING.along(times, rows)) > 0.0)
