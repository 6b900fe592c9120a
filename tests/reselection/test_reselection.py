"""The laws of re-selection in flight."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.onboard.command import Command
from ampi.onboard.table import GuidanceTable
from ampi.reselection.optimum_field import MatchWeights, OptimumField, lagrange_weights
from ampi.reselection.reselecting import ParameterPlan, Reselecting, Reselection
from ampi.reselection.settings import ReselectionSettings
from ampi.reselection.still_air import StillAir
from ampi.tracking.bank_limiter import BankLimits
from tests.support.reselection import (
    AXES,
    BEGIN,
    PLAN,
    RADIUS,
    RATE,
    Told,
    quadratic_table,
    reselecting,
    state_at,
)

Array = NDArray[np.float64]

NOMINAL = np.array([5000.0])
TIMES = np.arange(0.0, 62.0, 0.5)
WEIGHTS = MatchWeights(np.array([500.0, 4e-4, 2e-4, 20.0, 3e-3, 3e-3]), 1e3, 6)


@pytest.fixture(scope="module")
def table() -> GuidanceTable:
    return quadratic_table()


def flown(road: Reselecting, times: Array = TIMES, off: Array | None = None) -> list[Command]:
    """Commands of flights that lie `off` (8, n) the nominal optimum."""
    found = []
    for time in times:
        state = np.append(state_at(float(time), 5000.0, 1.0, 1.0), 0.0)
        beside = state if off is None else state[:, None] + off
        found.append(road.step(float(time), beside, np.zeros_like(beside[:3])))
    return found


def test_factors_at_the_nodes_of_the_table_fly_the_stored_optimum(table: GuidanceTable) -> None:
    for i, j in ((0, 2), (2, 0), (1, 1)):
        road = reselecting(table, Told(AXES[1][i], AXES[2][j]), matches=False)
        road.begin(NOMINAL)
        flown(road)
        np.testing.assert_array_equal(road.references[0].nodal, table.values[1, i, j])
        assert road.references[0].parameters == (5000.0, AXES[1][i], AXES[2][j])


def test_without_news_no_bit_changes(table: GuidanceTable) -> None:
    road, plain = reselecting(table, Told(), matches=False), reselecting(table, Told(), first=1e6)
    for each in (road, plain):
        each.begin(NOMINAL)
    assert flown(road) == flown(plain)
    assert road.counts[:, 0].tolist() == [0, 0, 0, 3, 0, 0, 0]
    assert road.outcome[0] == Reselection.UNCHANGED


@pytest.mark.parametrize("time", [10.0, 41.5, 90.0])
def test_a_state_of_the_field_is_found_again(table: GuidanceTable, time: float) -> None:
    field = OptimumField(table, (1, 2))
    for speed, density, lift in ((4930.0, 1.1, 1.05), (5080.0, 0.9, 0.96)):
        state = state_at(time, speed, density, lift)[:6, None]
        found = field.matched(time, state, np.array([[5000.0, density, lift]]), WEIGHTS)
        assert found[0] == pytest.approx([speed, density, lift], abs=0.02)


def test_the_match_is_the_least_of_its_function(table: GuidanceTable) -> None:
    """Against a search along the only axis that is free."""
    field, time, weights = OptimumField(table, (1, 2)), 50.0, MatchWeights(WEIGHTS.scale, 0.2, 8)
    state = state_at(time, 5060.0, 1.0, 1.0)[:6] + 0.7 * weights.scale
    found = field.matched(time, state[:, None], np.array([[4980.0, 1.05, 1.0]]), weights)
    speeds = np.linspace(4900.0, 5100.0, 20001)
    misses = np.stack([state_at(time, s, 1.05, 1.0)[:6] - state for s in speeds]) / weights.scale
    values = (misses**2).sum(axis=1) + ((speeds - 4980.0) / (200.0 * 0.2)) ** 2
    assert found[0, 0] == pytest.approx(speeds[np.argmin(values)], abs=0.02)


def test_beyond_the_grid_the_match_is_its_edge(table: GuidanceTable) -> None:
    state = state_at(50.0, 5200.0, 1.0, 1.0)[:6, None]
    asked = np.array([[5000.0, 1.0, 1.0]])
    assert OptimumField(table, (1, 2)).matched(50.0, state, asked, WEIGHTS)[0, 0] == 5100.0


def test_weights_are_those_of_polynomials() -> None:
    axis, at = np.array([-1.0, 0.5, 2.0, 4.0]), np.array([-0.7, 0.5, 3.1])
    weights, slopes = lagrange_weights(axis, at)
    np.testing.assert_allclose(weights @ axis**3, at**3, atol=1e-13)
    np.testing.assert_allclose(slopes @ axis**3, 3.0 * at**2, atol=1e-12)


def test_a_flight_has_the_same_bits_alone_and_in_company(table: GuidanceTable) -> None:
    rng = np.random.default_rng(5)
    n, sizes = 4, np.array([300.0, 1e-4, 1e-4, 15.0, 2e-3, 2e-3, 0.05, 0.01])[:, None]
    off, entries = sizes * rng.standard_normal((8, n)), rng.uniform(4910.0, 5090.0, (n, 1))
    together = reselecting(table, Told(1.07, 0.98, wind=12.0))
    together.begin(entries)
    company = flown(together, off=off)
    for i in range(n):
        alone = reselecting(table, Told(1.07, 0.98, wind=12.0))
        alone.begin(entries[i : i + 1])
        for one, all_ in zip(flown(alone, off=off[:, i : i + 1]), company, strict=True):
            for name in [field.name for field in fields(Command)]:
                assert getattr(one, name)[0] == getattr(all_, name)[i], name
    assert np.all(together.counts[Reselection.RESELECTED] >= 2)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 0.0, -1.0, 40.0])
def test_a_bad_estimate_keeps_the_reference_and_is_told(table: GuidanceTable, bad: float) -> None:
    air = Told(1.1, 1.0)
    road = reselecting(table, air)
    road.begin(NOMINAL)
    flown(road, TIMES[:82])
    kept = road.references[0]
    assert road.outcome[0] == Reselection.RESELECTED
    air.density = bad
    commands = flown(road, TIMES[82:102])
    assert road.outcome[0] == Reselection.BAD_ESTIMATE
    assert road.references[0] is kept
    assert all(np.isfinite(c.bank_rate) for c in commands)


@pytest.mark.parametrize("wind", [np.nan, np.inf, 1e4])
def test_a_wind_that_is_none_is_not_believed(table: GuidanceTable, wind: float) -> None:
    road, calm = reselecting(table, Told(wind=wind)), reselecting(table, Told())
    for each in (road, calm):
        each.begin(NOMINAL)
    assert flown(road) == flown(calm)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e9])
def test_a_bad_state_keeps_the_reference_and_is_told(table: GuidanceTable, bad: float) -> None:
    road = reselecting(table, Told(1.1))
    road.begin(np.full((2, 1), 5000.0))
    off = np.zeros((8, 2))
    off[3, 1] = bad
    flown(road, TIMES[:82], off)
    assert road.outcome.tolist() == [Reselection.RESELECTED, Reselection.BAD_STATE]
    assert road.references[1].parameters == (5000.0, 1.0, 1.0)


def test_nonsense_never_raises(table: GuidanceTable) -> None:
    road = reselecting(table, Told())
    assert road.step(0.0, np.zeros(8)) is not None  # before any begin
    road.begin("not numbers")
    for time, navigation in ((40.0, "no"), (np.nan, None), (50.0, np.zeros(3)), (60.0, [[]])):
        road.step(time, navigation, {})  # type: ignore[arg-type]
    assert road.outcome[0] == Reselection.BAD_STATE


def test_factors_beyond_the_table_are_told(table: GuidanceTable) -> None:
    road = reselecting(table, Told(1.4))
    road.begin(NOMINAL)
    flown(road)
    assert road.outcome[0] == Reselection.OUTSIDE
    assert road.references[0].cell is not None and not road.references[0].inside


def test_near_the_end_the_reference_stays(table: GuidanceTable) -> None:
    road = reselecting(table, Told(1.1), rest=45.0)
    road.begin(NOMINAL)
    flown(road)
    assert road.outcome[0] == Reselection.ENDING
    assert road.counts[:, 0].tolist() == [0, 2, 0, 0, 0, 0, 1]


def test_in_still_air_nothing_is_moved_and_in_wind_the_drift_of_the_end(
    table: GuidanceTable,
) -> None:
    still, zero = StillAir.of(table, RADIUS, 5e4), np.zeros(1)
    assert (still.speed, still.deceleration) == pytest.approx((1000.0, 40.0))
    at = np.append(state_at(40.0, 5000.0, 1.0, 1.0), 0.0)[:, None]
    np.testing.assert_allclose(still.seen(at, zero, zero, zero + 60.0), at, rtol=1e-14)
    end = BEGIN + RATE * 100.0
    end[[4, 5]] = 0.0, 0.5 * np.pi  # level, to the east
    seen = still.seen(np.append(end, 0.0)[:, None], zero + 20.0, zero, zero + 10.0)[:, 0]
    assert seen[3] == pytest.approx(end[3] - 20.0)
    farther = 20.0 * 10.0 + 1000.0 * 20.0 / 40.0  # drift, and flown on to the slower end
    assert (seen[1] - end[1]) * RADIUS * np.cos(end[2]) == pytest.approx(farther)


@pytest.mark.parametrize(
    ("plan", "said"),
    [
        (ParameterPlan((0, None), 1, 1, 2), "3 places"),
        (ParameterPlan((0, None, None), 1, 1, 1), "two axes"),
        (ParameterPlan((0, None, None), 1, 1, 3), "two axes"),
    ],
)
def test_a_plan_of_another_table_is_refused(
    table: GuidanceTable, plan: ParameterPlan, said: str
) -> None:
    guidance = Guidance(table, BankLimits(1.0, 0.1, 0.1))
    assert Reselecting(guidance, Told(), PLAN, radius=RADIUS) is not None
    with pytest.raises(ValueError, match=said):
        Reselecting(guidance, Told(), plan, radius=RADIUS)


def test_settings_are_refused_by_name() -> None:
    with pytest.raises(ValueError, match="every: expected a positive number, got 0"):
        ReselectionSettings(every=0.0)
    with pytest.raises(ValueError, match="wind: expected no negative number, got nan"):
        ReselectionSettings(wind=np.nan)
