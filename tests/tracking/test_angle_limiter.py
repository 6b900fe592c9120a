"""The limiter of the angle of attack: whatever is asked, δα keeps its limits, and arrives."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ampi.tracking.angle_limiter import ModulationLimits, modulation_rate

laws = settings(deadline=None, max_examples=200)
DEGREE = math.pi / 180.0
SHEFEX = ModulationLimits(4.5 * DEGREE, 5.0 * DEGREE, 4.0 * DEGREE)

limits = st.builds(
    ModulationLimits,
    angle=st.floats(0.01, 0.5),
    rate=st.floats(0.01, 1.0),
    acceleration=st.floats(0.01, 1.0),
)
cycles = st.sampled_from([0.1, 0.5, 1.0])
wishes = st.lists(
    st.one_of(st.floats(-1.0, 1.0), st.sampled_from([1e300, -1e300, math.inf, -math.inf, 0.0])),
    min_size=1,
    max_size=60,
)


def flown(
    lim: ModulationLimits, wanted: list[float], cycle: float, begin: float = 0.0
) -> tuple[list[float], list[float]]:
    """Changes and rates at the ends of cycles, from rest."""
    changes, rates = [begin], [0.0]
    for asked in wanted:
        new = float(modulation_rate(lim, changes[-1], rates[-1], asked, cycle, cycle))
        changes.append(changes[-1] + 0.5 * (rates[-1] + new) * cycle)
        rates.append(new)
    return changes, rates


@laws
@given(lim=limits, wanted=wishes, cycle=cycles)
def test_no_sequence_of_wishes_breaks_a_limit(
    lim: ModulationLimits, wanted: list[float], cycle: float
) -> None:
    changes, rates = flown(lim, wanted, cycle)
    small = 1e-9 * (lim.angle + lim.rate + lim.acceleration)
    assert max(map(abs, changes)) <= lim.angle + small
    assert max(map(abs, rates)) <= lim.rate + small
    for before, after in pairwise(rates):
        assert abs(after - before) <= lim.acceleration * cycle + small


@laws
@given(lim=limits, share=st.floats(-1.0, 1.0), cycle=cycles)
def test_what_is_wanted_is_reached_without_overshoot_and_kept(
    lim: ModulationLimits, share: float, cycle: float
) -> None:
    wanted = share * lim.angle
    longest = abs(wanted) / lim.rate + lim.rate / lim.acceleration
    longest += 2.0 * math.sqrt(abs(wanted) / lim.acceleration)
    changes, rates = flown(lim, [wanted] * (math.ceil(longest / cycle) + 6), cycle)
    small = 1e-9 * (lim.angle + lim.rate)
    assert max(c * math.copysign(1.0, wanted) for c in changes) <= abs(wanted) + small
    assert changes[-1] == pytest.approx(wanted, abs=small)
    assert rates[-1] == pytest.approx(0.0, abs=1e-6)


def test_four_and_a_half_degrees_take_two_seconds() -> None:
    """Half of the way speeding up at 4°/s², half slowing down: 2 √(4.5°/4°/s²) = 2.1 s."""
    changes, _ = flown(SHEFEX, [1.0] * 40, 0.1)
    arrived = next(k for k, c in enumerate(changes) if c > 0.999 * SHEFEX.angle)
    assert 0.1 * arrived == pytest.approx(2.0 * math.sqrt(4.5 / 4.0), abs=0.2)


def test_a_cycle_that_is_not_known_lies_between_its_bounds() -> None:
    """Only what the shortest cycle allows is asked for, and it stops though all are the longest."""
    known = float(modulation_rate(SHEFEX, 0.0, 0.0, 1.0, 0.5, 0.5))
    unknown = float(modulation_rate(SHEFEX, 0.0, 0.0, 1.0, 0.5, 0.05))
    assert unknown == pytest.approx(0.1 * known)


def test_limits_that_are_none_are_refused() -> None:
    with pytest.raises(ValueError, match=r"modulation limits: rate: expected positive numbers"):
        ModulationLimits(0.1, 0.0, 0.1)
