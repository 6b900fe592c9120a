"""The verdict: intervals against closed forms, rings that add up, footprints of known shapes."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from ampi.missions.path_limits import KEPT
from ampi.onboard.reference import Mode
from ampi.simulation.estimates.paired import Flown, paired
from ampi.simulation.estimates.spreads import Sizes
from ampi.simulation.flights import Flights
from ampi.simulation.plant import FlightStatus
from ampi.simulation.statistics import (
    TABLE_5_RADII,
    Fraction,
    Spread,
    compare,
    ellipse_area,
    footprint_ratio,
    judge,
    paired_with_nominal,
    ratio_to_nominal,
)

FlightMaker = Callable[..., Flights]

laws = settings(deadline=None, max_examples=100)


def statuses(n: int, failed: list[int]) -> np.ndarray:
    status = np.zeros(n, dtype=np.int64)
    status[failed] = np.resize([1, 2, 3], len(failed))
    return status


# --- fractions ------------------------------------------------------------------------------------


@laws
@given(n=st.integers(1, 3000), share=st.floats(0.0, 1.0))
def test_the_interval_is_that_of_clopper_and_pearson(n: int, share: float) -> None:
    """Roots of binomial tails."""
    count = round(share * n)
    got = Fraction.of(np.arange(n) < count)
    witness = stats.binomtest(count, n).proportion_ci(0.95, method="exact")
    assert (got.count, got.n) == (count, n)
    assert (got.low, got.high) == pytest.approx((witness.low, witness.high), abs=1e-9)
    assert got.low <= got.percent / 100.0 <= got.high


@laws
@given(n=st.integers(1, 300), share=st.floats(0.0, 1.0))
def test_hits_and_misses_mirror_each_other(n: int, share: float) -> None:
    hits = np.arange(n) < round(share * n)
    one, other = Fraction.of(hits), Fraction.of(~hits)
    assert (one.low, one.high) == pytest.approx((1 - other.high, 1 - other.low), abs=1e-9)
    assert one.percent + other.percent == pytest.approx(100.0)


def test_the_interval_covers_as_often_as_it_claims() -> None:
    """Exact: the sum of binomial probabilities of all counts whose interval holds p."""
    n, p = 40, 0.3
    intervals = [Fraction.of(np.arange(n) < k) for k in range(n + 1)]
    covered = sum(
        float(stats.binom.pmf(k, n, p)) for k, i in enumerate(intervals) if i.low <= p <= i.high
    )
    assert 0.95 <= covered < 0.99


def test_a_thousand_of_a_thousand() -> None:
    """The rule of three: none of n missed leaves about 3.7/n at 97.5 %."""
    got = Fraction.of(np.ones(1000, dtype=bool))
    assert (got.percent, got.high) == (100.0, 1.0)
    assert got.low == pytest.approx(0.025 ** (1 / 1000), rel=1e-12)
    assert str(got) == "100.0 % [99.6, 100.0]"


# --- spreads --------------------------------------------------------------------------------------


@laws
@given(st.lists(st.floats(-1e9, 1e9), min_size=1, max_size=50))
def test_a_spread_knows_no_sign_and_no_order(values: list[float]) -> None:
    error = np.array(values)
    got = Spread.of(error)
    assert got == Spread.of(-error) == Spread.of(error[::-1])
    size = sorted(abs(v) for v in values)
    assert got.worst == size[-1]
    assert size[(len(size) - 1) // 2] <= got.median <= size[len(size) // 2]
    assert got.median <= got.percentile_99 <= got.worst


def test_an_empty_spread_is_not_a_number() -> None:
    got = Spread.of(np.empty(0))
    assert np.isnan([got.median, got.percentile_99, got.worst]).all()


def test_the_99th_percentile_of_a_ramp() -> None:
    """Of 0 … 100 it is 99, the sign of a number aside."""
    ramp = np.arange(101.0) * (-1.0) ** np.arange(101)
    got = Spread.of(ramp)
    assert (got.median, got.percentile_99, got.worst) == (50.0, 99.0, 100.0)


# --- the verdict ----------------------------------------------------------------------------------


@laws
@given(seed=st.integers(0, 1000), n=st.integers(3, 80), failed=st.sets(st.integers(0, 79)))
def test_rings_add_up_and_failed_flights_are_in_no_circle(
    make_flights: FlightMaker, seed: int, n: int, failed: set[int]
) -> None:
    lost = sorted(i for i in failed if i < n)
    flights = make_flights(n, seed, status=statuses(n, lost))
    flights.miss[lost] = 0.0  # a flight that met the ground on the target has still not arrived
    verdict = judge(flights)
    assert len(verdict.rings) == len(TABLE_5_RADII) + 1
    assert sum(ring.count for ring in verdict.rings) == n
    assert all(ring.n == n for ring in verdict.rings)
    arrived = np.delete(flights.miss, lost)
    edges = [0.0, *TABLE_5_RADII]
    for ring, a, b in zip(verdict.rings, edges, edges[1:], strict=False):
        assert ring.count == sum(a <= m < b for m in arrived)
    assert verdict.rings[-1].count == len(lost) + sum(m >= TABLE_5_RADII[-1] for m in arrived)
    for radius in flights.radii.tolist():
        assert verdict.within[radius].count == sum(m < radius for m in arrived)
    assert verdict.within[25e3].count == verdict.rings[0].count
    assert (verdict.reached.count, verdict.n) == (n - len(lost), n)
    assert verdict.miss == Spread.of(arrived)


@pytest.mark.parametrize("status", [s for s in FlightStatus if s is not FlightStatus.REACHED_SPEED])
def test_a_campaign_in_which_nothing_arrives(
    make_flights: FlightMaker, status: FlightStatus
) -> None:
    n = 20
    nothing = np.full(n, np.nan)
    flights = make_flights(n, status=np.full(n, int(status)), miss=nothing, along=nothing)
    verdict = judge(flights)
    assert [ring.count for ring in verdict.rings] == [0, 0, 0, n]
    assert verdict.reached.count == 0
    assert np.isnan(verdict.footprint_area)
    assert np.isnan(verdict.miss.worst)


def test_one_limit_exceeded_is_a_flight_that_did_not_keep_them(make_flights: FlightMaker) -> None:
    peak = np.full((4, 5), 0.5)
    peak[1, 0], peak[2, 1], peak[3, 2] = 1.0 + KEPT, np.nextafter(1.0 + KEPT, 2.0), 0.9
    verdict = judge(make_flights(4, peak=peak))
    assert verdict.limits_kept.count == 3
    assert verdict.peak["dynamic_pressure"] == Spread.of(np.array([0.5, 1.0 + KEPT, 0.5, 0.5]))
    assert verdict.peak["heat_flux"].worst > 1.0
    assert verdict.peak["load_factor"].worst == 0.9


def test_a_flight_passes_by_the_tolerances_and_limits_of_its_mission(
    make_flights: FlightMaker,
) -> None:
    """One flight for each reason, one that just passes, one of which nothing is known."""
    n = 8
    status, peak = statuses(n, [1, 7]), np.full((n, 5), 0.9)
    peak[5, 1], peak[7] = 1.002, np.nan
    miss, altitude, speed = np.full(n, 1e3), np.zeros(n), np.zeros(n)
    miss[2], altitude[3], speed[4] = 2001.0, -101.0, 5.5
    miss[6], altitude[6], speed[6], peak[6] = 2000.0, -100.0, -5.0, 1.0005
    miss[7] = altitude[7] = speed[7] = np.nan
    flights = make_flights(
        n,
        status=status,
        peak=peak,
        miss=miss,
        altitude_error=altitude,
        speed_error=speed,
        position_tolerance=2e3,
        altitude_tolerance=100.0,
        speed_tolerance=5.0,
        radii=np.array([1.5e3, 9e3]),
    )
    assert flights.passed.tolist() == [True, *[False] * 5, True, False]
    failed = {reason: np.flatnonzero(f).tolist() for reason, f in flights.faults.items()}
    assert failed == {
        "target_speed_not_reached": [1, 7],
        "position": [2, 7],
        "altitude": [3, 7],
        "speed": [4, 7],
        "dynamic_pressure": [7],
        "heat_flux": [5, 7],
        "load_factor": [7],
        "bank_angle": [7],
        "bank_rate": [7],
    }
    verdict = judge(flights)
    assert verdict.passed == Fraction.of(flights.passed)
    assert verdict.failed_by["position"].count == 2
    assert {radius: f.count for radius, f in verdict.within.items()} == {1.5e3: 4, 9e3: 6}
    plain = json.loads(json.dumps(verdict.as_dict()))
    assert plain["passed"]["count"] == 2
    assert plain["failed_by"]["heat_flux"]["count"] == 2


def test_the_verdict_is_plain_numbers_for_json(make_flights: FlightMaker) -> None:
    flights = make_flights(50, mode=Mode.QUADRATIC)
    verdict = judge(flights)
    plain = json.loads(json.dumps(verdict.as_dict()))
    assert (plain["mode"], plain["n"]) == ("quadratic", 50)
    assert plain["reached"]["count"] == 50
    assert [ring["count"] for ring in plain["rings"]] == [r.count for r in verdict.rings]
    assert plain["within"]["3000.0"]["n"] == 50
    assert plain["clipped"]["count"] == int(flights.clipped.sum())
    assert plain["hole"]["count"] == int(flights.hole.sum())


def test_the_verdict_counts_lost_flights_as_infinitely_far(make_flights: FlightMaker) -> None:
    lost = list(range(0, 100, 25))
    flights = make_flights(100, status=statuses(100, lost))
    verdict = judge(flights)
    arrived = np.delete(flights.miss, lost)
    assert verdict.misses == Sizes.of(np.r_[arrived, np.full(4, np.inf)])
    assert (verdict.misses.lost, verdict.misses.worst_mean.value) == (4, np.inf)
    assert verdict.misses.median.value > verdict.miss.median
    assert verdict.containment is not None
    assert (verdict.containment.holds, verdict.containment.n) == (95, 100)
    for name in ("saturation", "activity"):
        assert verdict.means[name].value == pytest.approx(getattr(flights, name).mean())
    assert sum(share.count for share in verdict.classes.values()) == 100
    assert verdict.classes["NONE"].count == verdict.passed.count
    assert verdict.classes["GROUND"].count == 2  # of four lost flights, by turns
    plain = verdict.as_dict()
    assert plain["misses"]["median"]["value"] == verdict.misses.median.value
    assert plain["containment"]["semi_axes"] == list(verdict.containment.semi_axes)
    assert plain["means"]["saturation"]["low"] < flights.saturation.mean()


# --- footprints -----------------------------------------------------------------------------------


@laws
@given(
    semi_axes=st.tuples(st.floats(1.0, 1e5), st.floats(1.0, 1e5)),
    turn=st.floats(0.0, 6.3),
    shift=st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5)),
)
def test_the_ellipse_of_a_known_covariance(
    semi_axes: tuple[float, float], turn: float, shift: tuple[float, float]
) -> None:
    """Sample covariance exactly R diag(a², b²) Rᵀ: area χ²₀.₉₅ π a b, wherever and however turned."""
    a, b = semi_axes
    angle = 2.0 * np.pi * np.arange(12) / 12
    scale = np.sqrt(2.0 * 11 / 12)
    x, y = a * scale * np.cos(angle), b * scale * np.sin(angle)
    along = shift[0] + np.cos(turn) * x - np.sin(turn) * y
    across = shift[1] + np.sin(turn) * x + np.cos(turn) * y
    expected = -2.0 * np.log(0.05) * np.pi * a * b
    slack = 1e-9 * max(a, b) / min(a, b) + 1e-12 * (np.hypot(*shift) / min(a, b)) ** 2 + 1e-9
    assert ellipse_area(along, across) == pytest.approx(expected, rel=slack * 10)


def test_the_ellipse_holds_95_percent_of_a_normal() -> None:
    rng = np.random.default_rng(4)
    points = np.array([[3.0, 0.0], [1.0, 0.5]]) @ rng.standard_normal((2, 20000))
    area = ellipse_area(*points)
    covariance = np.cov(points)
    squared = np.einsum("in,ij,jn->n", points, np.linalg.inv(covariance), points)
    inside = squared <= area / (np.pi * np.sqrt(np.linalg.det(covariance)))
    assert stats.binomtest(int(inside.sum()), 20000, 0.95).pvalue > 0.01


def test_fewer_than_three_points_have_no_ellipse() -> None:
    assert np.isnan(ellipse_area(np.array([0.0, 1.0]), np.array([2.0, 5.0])))


def test_points_on_a_line_have_no_area() -> None:
    along = np.arange(8.0)
    assert ellipse_area(along, 2.0 * along) == pytest.approx(0.0, abs=1e-6)


def test_a_campaign_over_itself_is_exactly_one(make_flights: FlightMaker) -> None:
    flights = make_flights(60)
    got = footprint_ratio(flights, flights)
    assert (got.ratio, got.low, got.high) == (1.0, 1.0, 1.0)
    assert str(got) == "100 % [100, 100]"


def test_scaling_both_directions_scales_the_ratio(make_flights: FlightMaker) -> None:
    baseline = make_flights(80)
    smaller = make_flights(80, along=0.2 * baseline.along, across=0.5 * baseline.across)
    got = footprint_ratio(smaller, baseline)
    assert (got.ratio, got.low, got.high) == pytest.approx((0.1, 0.1, 0.1), rel=1e-9)
    back = footprint_ratio(baseline, smaller)
    assert back.ratio == pytest.approx(10.0, rel=1e-9)


def test_only_draws_that_arrive_in_both_campaigns_count(make_flights: FlightMaker) -> None:
    baseline = make_flights(50, status=statuses(50, [3, 4]))
    wild = baseline.along.copy()
    wild[[3, 4, 9]] = 1e9
    other = make_flights(50, along=wild, status=statuses(50, [9]))
    got = footprint_ratio(other, baseline)
    assert (got.ratio, got.low, got.high) == (1.0, 1.0, 1.0)


def test_the_bootstrap_interval_holds_the_ratio_and_repeats_itself(
    make_flights: FlightMaker,
) -> None:
    baseline, other = make_flights(120, 1), make_flights(120, 2)
    first, second = footprint_ratio(other, baseline), footprint_ratio(other, baseline)
    assert first == second
    assert first.low < first.ratio < first.high
    assert first.low > 0.4
    assert first.high < 2.5


def test_the_bootstrap_interval_is_of_95_percent(make_flights: FlightMaker) -> None:
    """The 2.5th and 97.5th percentile of 2000 resamplings, drawn here again from the same seed."""
    baseline, other = make_flights(120, 1), make_flights(120, 2)
    rng = np.random.default_rng(np.random.SeedSequence(other.seed, spawn_key=(0,)))
    ratios = np.empty(2000)
    for i in range(len(ratios)):
        pick = rng.integers(0, 120, 120)
        one, two = (ellipse_area(f.along[pick], f.across[pick]) for f in (other, baseline))
        ratios[i] = one / two
    got = footprint_ratio(other, baseline)
    assert np.mean(ratios < got.low) == pytest.approx(0.025, abs=1e-3)
    assert np.mean(ratios > got.high) == pytest.approx(0.025, abs=1e-3)


def test_unpaired_draws_are_refused(make_flights: FlightMaker) -> None:
    flights = make_flights(30)
    entries = flights.parameters.copy()
    entries[7, 2] = np.nextafter(entries[7, 2], 1.0)
    for other in (make_flights(31), make_flights(30, parameters=entries)):
        with pytest.raises(ValueError, match="not flown on the same draws"):
            footprint_ratio(flights, other)


@pytest.mark.parametrize("failed", [31, 40, 60])
def test_too_few_common_flights_are_refused(make_flights: FlightMaker, failed: int) -> None:
    """29, 20 and none of 60: the bootstrap would draw degenerate ellipses."""
    flights = make_flights(60)
    other = make_flights(60, status=statuses(60, list(range(failed))))
    message = f"{60 - failed} common flights are too few, 30 are needed"
    with pytest.raises(ValueError, match=message):
        footprint_ratio(other, flights)
    assert (
        footprint_ratio(flights, make_flights(60, status=statuses(60, list(range(30))))).ratio == 1
    )


def test_nominal_tracking_is_that_of_the_same_law_world_and_draws(
    make_flights: FlightMaker,
) -> None:
    """Whatever else lies in the file, and in whatever order."""
    flights = make_flights(60, 1)
    own = make_flights(60, 2, mode=Mode.NOMINAL, status=statuses(60, [5, 6]))
    others = {
        "law": make_flights(60, 3, mode=Mode.NOMINAL, law="drag_sliding_mode"),
        "world": make_flights(60, 4, mode=Mode.NOMINAL, world_sha256="f" * 64),
        "cycle": make_flights(60, 5, mode=Mode.NOMINAL, cycle=0.1),
        "draws": make_flights(60, 6, mode=Mode.NOMINAL, parameters=flights.parameters + 1.0),
        "truth": make_flights(60, 7, mode=Mode.NOMINAL, numbers=flights.numbers + 1.0),
        "mode": make_flights(60, 8, mode=Mode.MPI),
    }
    assert paired_with_nominal(flights, others, (1e3,)) is None
    assert ratio_to_nominal(flights, others) is None
    every = {**others, "own": own, "flights": flights}
    lost = np.where(own.reached, own.miss, np.inf)
    expected = paired(
        Flown(flights.parameters, flights.miss), Flown(own.parameters, lost), (5e3, 25e3)
    )
    assert paired_with_nominal(flights, every, (5e3, 25e3)) == expected
    assert ratio_to_nominal(flights, every) == footprint_ratio(flights, own)
    assert paired_with_nominal(own, every, (5e3,)) is None


def test_two_schemes_are_compared_on_what_was_true_of_both(
    make_flights: Callable[..., Flights],
) -> None:
    near, far = make_flights(60, seed=1), make_flights(60, seed=1)
    far = replace(far, miss=near.miss + 30e3)
    found = compare(near, far)
    assert found.median.value == pytest.approx(-30e3)
    assert found.within[25e3].difference.value == pytest.approx(np.mean(near.miss < 25e3))
    with pytest.raises(ValueError, match="same draws"):
        compare(near, replace(far, seeds=far.seeds + np.uint64(1)))
