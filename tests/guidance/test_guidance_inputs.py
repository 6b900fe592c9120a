"""Nonsense in every input and every combination: a health, a finite command, never an exception."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.onboard.health import Health, Steering
from ampi.onboard.reference import Mode, Reference
from ampi.onboard.row_layout import LINEAR_TRACKING
from ampi.simulation.closed_loop import fly_batch
from ampi.simulation.plant import FlightStatus
from ampi.tracking.bank_limiter import BankLimits, bank_on_turn
from tests.support.references import asking, at_instant
from tests.support.steps import command
from tests.support.truths import nominal_truth

Array = NDArray[np.float64]
MODES = [mode for mode in Mode if mode is not Mode.HERMITE]  # no sensitivities in these tables

laws = settings(deadline=None, max_examples=100)
DEGREE, TURN = np.pi / 180.0, 2.0 * np.pi
NAMES = ("altitude", "longitude", "latitude", "speed", "flight_path_angle", "azimuth", "bank_angle")
ANGLES = [1, 2, 4, 5, 6]
TIME = 100.0


@pytest.fixture(scope="module")
def flying(mission: Mission, loaded: Guidance) -> tuple[Guidance, Reference, Array]:
    """Guidance of its own, the nominal reference and its state at 100 s."""
    guidance = loaded.at_cycle(0.5)
    reference = guidance.reference(mission.nominal_parameters).copy()
    k = int(np.searchsorted(reference.times, TIME))
    return guidance, reference, reference.states[:, k].copy()


def told(flying: tuple[Guidance, Reference, Array], state: object, rate: object = 0.0) -> Health:
    guidance, reference, _ = flying
    guidance.reset()
    return Health(command(guidance, reference, TIME, state, rate).health)


# --- states ---------------------------------------------------------------------------------------


def test_states_of_flights_are_good(
    flying: tuple[Guidance, Reference, Array], mission: Mission
) -> None:
    _, reference, state = flying
    assert told(flying, state) is Health.GOOD
    assert told(flying, state.tolist()) is Health.GOOD
    for k in range(0, 600, 25):
        assert told(flying, reference.states[:, k]) is Health.GOOD
    errors = np.array([5e3, 0.05, 0.05, 200.0, 0.05, 0.1, 0.5])  # more than any flight has
    for signs in product([-1.0, 1.0], repeat=3):
        assert told(flying, state + errors * np.resize(signs, 7)) is Health.GOOD


@pytest.mark.parametrize(
    ("row", "wrong"),
    [
        *((row, "degrees") for row in (1, 2, 4, 5)),
        *((row, "thousandth") for row in (0, 3)),  # kilometres, kilometres per second
        *((row, "thousandfold") for row in (0, 3)),
        *((row, "sign") for row in (0, 2, 3)),
    ],
)
def test_one_number_in_another_unit_is_told(
    flying: tuple[Guidance, Reference, Array], row: int, wrong: str
) -> None:
    factor = {"degrees": 1.0 / DEGREE, "thousandth": 1e-3, "thousandfold": 1e3, "sign": -1.0}
    _, reference, _ = flying
    for k in (0, 150, 300, 450):
        state = reference.states[:, k].copy()
        state[row] *= factor[wrong]
        if abs(state[row]) > 0.3 or row in (0, 3):  # −0.2° of flight path may be −0.2 rad
            assert told(flying, state) is Health.IMPLAUSIBLE_NAVIGATION


def test_a_whole_state_in_degrees_is_told_all_along_the_flight(
    flying: tuple[Guidance, Reference, Array],
) -> None:
    _, reference, _ = flying
    for k in range(0, 601, 20):
        state = reference.states[:, k].copy()
        state[ANGLES] /= DEGREE
        assert told(flying, state) is Health.IMPLAUSIBLE_NAVIGATION


@pytest.mark.parametrize(
    "navigation",
    [
        np.zeros(7),
        np.zeros(9),
        np.zeros((1, 8)),
        np.zeros((8, 2)),
        np.zeros((8, 1, 1)),
        0.0,
        None,
        [],
        "here",
        [1.0, 2.0, [3.0]],
        {"altitude": 1e5},
        [1e5, 0.0, 0.0, 4e3, -0.1, 0.0, 0.0, "level"],
        [10**400] * 8,
    ],
)
def test_what_is_no_navigation_is_bad_navigation(
    flying: tuple[Guidance, Reference, Array], navigation: object
) -> None:
    guidance, reference, _ = flying
    guidance.reset()
    guidance.follow(reference)
    got = guidance.step(TIME, navigation)  # type: ignore[arg-type]
    assert (got.health, got.steering) == (Health.BAD_NAVIGATION, Steering.REFERENCE)
    own = at_instant(guidance.table, reference, TIME)[7]
    assert got.bank_rate == pytest.approx(own, abs=1e-12)


@pytest.mark.parametrize(
    ("rate", "health"),
    [
        (4.9 * DEGREE, Health.GOOD),
        (-9.9 * DEGREE, Health.GOOD),  # twice the limit: a gust
        (10.1 * DEGREE, Health.IMPLAUSIBLE_NAVIGATION),
        (3.0, Health.IMPLAUSIBLE_NAVIGATION),  # 3 °/s
        (np.nan, Health.BAD_NAVIGATION),
        (-np.inf, Health.BAD_NAVIGATION),
        (None, Health.BAD_NAVIGATION),
        ([0.0, 0.0], Health.BAD_NAVIGATION),
        (np.array([0.0]), Health.BAD_NAVIGATION),
        (np.float32(0.01), Health.GOOD),
        (0, Health.GOOD),
    ],
)
def test_bank_rates(
    flying: tuple[Guidance, Reference, Array], rate: object, health: Health
) -> None:
    assert told(flying, flying[2], rate) is health


def test_without_a_bank_rate_the_state_is_tracked_all_the_same(
    flying: tuple[Guidance, Reference, Array],
) -> None:
    guidance, reference, state = flying
    state = state + np.array([300.0, 0.0, 0.0, 10.0, 0.0, 0.0, 0.01])
    commands = []
    for rate in (0.0, np.nan):
        guidance.reset()
        command(guidance, reference, TIME - 0.5, state, 0.0)
        commands.append(command(guidance, reference, TIME, state, rate).bank_rate)
    assert commands[1] == pytest.approx(commands[0], abs=1e-3)
    own = at_instant(guidance.table, reference, TIME)[7]
    assert abs(commands[1] - own) > 1e-3


# --- all together ---------------------------------------------------------------------------------

TIMES = {"good": TIME, "late": 1e6, "nan": np.nan, "inf": np.inf, "word": "noon", "vector": [1.0]}
RATES = {"good": 0.01, "nan": np.nan, "unit": 3.0, "none": None}
VECTORS = {"good": [], "outside": [], "far": [], "nan": [np.nan, np.nan], "short": [1.0]}


@pytest.mark.parametrize("mode", MODES)
def test_of_every_combination_the_gravest_is_told(
    mission: Mission, loaded: Guidance, mode: Mode
) -> None:
    guidance = loaded.in_mode(mode)
    centre = mission.nominal_parameters
    speeds = {"good": 0.0, "outside": 80.0, "far": 300.0}
    nominal = mode is Mode.NOMINAL
    of_p = {
        "good": Health.GOOD,
        "outside": Health.GOOD if nominal else Health.BOUNDARY_REFERENCE,
        "far": Health.FAR_OUTSIDE,
        "nan": Health.BAD_PARAMETERS,
        "short": Health.BAD_PARAMETERS,
    }
    of_time = {"good": Health.GOOD, "late": Health.AFTER_FINAL_TIME}
    of_rate = {"good": Health.GOOD, "unit": Health.IMPLAUSIBLE_NAVIGATION}
    of_state = {"good": Health.GOOD, "unit": Health.IMPLAUSIBLE_NAVIGATION}
    for name, fault in VECTORS.items():
        p = fault or centre + np.array([speeds[name], 0.0])
        reference = guidance.reference(p).copy()
        good = reference.states[:, 100]
        unit = good * np.array([1e-3, 1, 1, 1, 1, 1, 1])
        states = {"good": good, "unit": unit, "nan": good * np.nan, "six": good[:6]}
        for (t, time), (s, state), (r, rate) in product(
            TIMES.items(), states.items(), RATES.items()
        ):
            guidance.reset()
            got = command(guidance, reference, time, state, rate)
            navigation = max(
                of_state.get(s, Health.BAD_NAVIGATION), of_rate.get(r, Health.BAD_NAVIGATION)
            )
            expected = max(of_p[name], of_time.get(t, Health.BAD_TIME), navigation)
            assert got.health is expected, (name, t, s, r)
            assert np.isfinite([got.bank_rate, got.bank_angle]).all()
            assert abs(got.bank_rate) <= guidance.limits.rate * (1.0 + 1e-9)


# --- angles ---------------------------------------------------------------------------------------


@laws
@given(
    turns=st.lists(st.integers(-3, 3), min_size=3, max_size=3),
    share=st.floats(0.05, 0.9),
    seed=st.integers(0, 2**32 - 1),
)
def test_whole_turns_of_longitude_azimuth_and_bank_angle_do_not_matter(
    flying: tuple[Guidance, Reference, Array], turns: list[int], share: float, seed: int
) -> None:
    guidance, reference, _ = flying
    k = int(share * (len(reference.times) - 1))
    time = float(reference.times[k])
    errors = np.random.default_rng(seed).uniform(-1.0, 1.0, 7)
    state = reference.states[:, k] + errors * np.array([2e3, 0.01, 0.01, 50.0, 0.01, 0.02, 0.1])
    turned = state.copy()
    turned[[1, 5, 6]] += TURN * np.array(turns)
    commands = []
    for x in (state, turned):
        guidance.reset()
        commands.append(command(guidance, reference, time, x, 0.01))
    assert commands[1].health is commands[0].health is Health.GOOD
    assert commands[1].bank_rate == pytest.approx(commands[0].bank_rate, abs=1e-10)
    assert commands[1].bank_angle == pytest.approx(commands[0].bank_angle, abs=1e-10)


def test_a_bank_angle_told_as_320_degrees_does_not_unwind_a_turn(
    flying: tuple[Guidance, Reference, Array],
) -> None:
    """−40° told as 320°: 5 °/s to the right would be 72 s of flight upside down."""
    guidance, reference, state = flying
    still = asking(reference, 0.0)
    state = state.copy()
    state[6] = 320.0 * DEGREE
    guidance.reset()
    got = command(guidance, still, TIME, state, 0.0)
    assert got.bank_rate == 0.0
    assert got.bank_angle == pytest.approx(-40.0 * DEGREE)


@laws
@given(
    limit=st.floats(20.0, 180.0),
    bank=st.floats(-1.0, 1.0),
    reference=st.floats(-1.0, 1.0),
    turns=st.integers(-3, 3),
)
def test_between_its_limits_a_bank_angle_keeps_its_side(
    limit: float, bank: float, reference: float, turns: int
) -> None:
    """−115° stays −115° where the limits are ±120° and +110° is wanted: the way leads over 0."""
    limits = BankLimits(limit * DEGREE, 0.1, 0.1)
    side = min(limit, 169.0)  # nearer to 180° the reference decides
    got = bank_on_turn(limits, bank * side * DEGREE + turns * TURN, reference * limit * DEGREE)
    assert got == pytest.approx(bank * side * DEGREE, abs=1e-12)


@pytest.mark.parametrize("limit", [172.0, 180.0])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_where_the_limit_is_near_180_degrees_an_overshoot_is_one(limit: float, sign: float) -> None:
    limits = BankLimits(limit * DEGREE, 0.1, 0.1)
    for turns in (-1, 0, 1):
        beyond = sign * (limit + 1.5) * DEGREE
        got = bank_on_turn(limits, beyond + turns * TURN, sign * limit * DEGREE)
        assert got == pytest.approx(beyond, abs=1e-12)


def test_an_overshoot_over_180_degrees_is_brought_back_by_the_command(
    synthetic: Guidance,
) -> None:
    """Told as −178.5° beside a reference at 180°: 1.5° back, not a turn less 1.5°."""
    guidance = Guidance(synthetic.table, BankLimits(np.pi, 0.1, 0.07), cycle=0.5)
    reference = asking(guidance.reference([0.1] * 6), 0.0)
    reference.nodal[14], reference.nodal[6] = 0.5, np.pi
    state = reference.states[:, 20].copy()
    state[6] = -178.5 * DEGREE
    got = command(guidance, reference, float(reference.times[20]), state, 0.0)
    assert got.bank_rate == pytest.approx(-0.07 * 0.5)  # back to the limit, at once
    assert 180.0 * DEGREE < got.bank_angle < 181.5 * DEGREE


def test_nothing_that_is_told_is_written_to(flying: tuple[Guidance, Reference, Array]) -> None:
    guidance, reference, state = flying
    turned = state + np.array([0.0, TURN, 0.0, 0.0, 0.0, -TURN, TURN])
    for p in (np.array([4712.0, TURN]), np.array([np.nan, 1e9])):
        before = p.copy(), turned.copy()
        guidance.reset()
        command(guidance, reference, TIME, turned, 0.0)
        guidance.reference(p)
        assert np.array_equal(p, before[0], equal_nan=True)
        assert np.array_equal(turned, before[1])


# --- a limit that is a parameter ------------------------------------------------------------------


def test_a_bank_limit_told_in_degrees_ends_at_its_axis(synthetic: Guidance) -> None:
    axes = (np.array([0.7, 0.8, 1.2]), *synthetic.table.axes[1:])
    table = replace(synthetic.table, axes=axes)
    guidance = Guidance(table, BankLimits(1.0, 0.1, 0.07), limit_axes={"angle": 0})
    for told_limit, limit in ((0.9, 0.9), (0.5, 0.5), (1.2, 1.2), (45.0, 1.2), (np.nan, 1.0)):
        own = guidance.limits_at([told_limit] + [0.0] * 5)
        assert float(own.angle) == limit
    assert guidance.reference([45.0] + [0.0] * 5).health is Health.FAR_OUTSIDE
    assert guidance.limits_at(guidance.reference([1.0]).parameters).angle == 1.0  # of another table


# --- the simulator and the envelope ---------------------------------------------------------------


def test_a_simulated_flight_out_of_the_envelope_is_that_of_the_commands(
    mission: Mission, loaded: Guidance
) -> None:
    """A table of slow flights alone: what flies faster is implausible, and flies the own bank rate."""
    values = loaded.table.values.copy()
    values[..., 3, :] = np.minimum(values[..., 3, :], 1500.0)
    blind = Guidance(replace(loaded.table, values=values), loaded.limits)
    without = values.copy()
    without[..., 8:, :] = 0.0
    open_loop = Guidance(replace(loaded.table, values=without), loaded.limits)
    assert blind.table.envelope.middle[3] < 2000.0
    p = mission.nominal_parameters + np.array([30.0, 0.003])
    flights = [
        fly_batch(mission.family(p[None]), guidance, nominal_truth(p[None]), record_every=1.0)
        for guidance in (blind, open_loop)
    ]
    assert {int(f.status[0]) for f in flights} == {int(FlightStatus.REACHED_SPEED)}
    fast = flights[0].states[0, 3] > 2400.0
    slow = flights[0].states[0, 3] < 1800.0
    n = min(len(f.times) for f in flights)
    difference = np.abs(flights[0].bank_rate[0, :n] - flights[1].bank_rate[0, :n])
    assert difference[fast[:n]].max() < 1e-12
    assert np.nanmax(difference[slow[:n]]) > 1e-4


def test_the_envelope_is_half_a_width_wider_and_bounds_what_is_positive(
    synthetic: Guidance, loaded: Guidance
) -> None:
    states, envelope = loaded.table.values[..., LINEAR_TRACKING.states, :], loaded.table.envelope
    least, greatest = states.min(axis=(0, 1, 3)), states.max(axis=(0, 1, 3))
    width = np.maximum(greatest - least, [0.0, 0.2, 0.2, 0.0, 0.2, 0.2, 0.0])
    high = greatest + 0.5 * width
    assert (envelope.middle + envelope.reach)[:6] == pytest.approx(high[:6], rel=1e-12)
    low = (envelope.middle - envelope.reach)[:6]
    angles = [1, 2, 4, 5]
    assert low[angles] == pytest.approx((least - 0.5 * width)[angles], rel=1e-12)
    assert low[[0, 3]] == pytest.approx(
        np.maximum(least - 0.5 * width, 0.5 * least)[[0, 3]], rel=1e-12
    )
    # over the poles, where random latitudes lead, longitude and azimuth may be any
    assert synthetic.table.envelope.reach[[1, 5, 6]] == pytest.approx(np.full(3, 7.0 * np.pi))
    for array in (envelope.middle, envelope.reach):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
