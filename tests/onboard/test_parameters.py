"""Every p that a vehicle may be told: where it lies, on which turn, and what is made of nonsense."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.onboard.health import Health
from ampi.onboard.reference import FAR, Mode, Reference, ReferenceGenerator
from ampi.onboard.table import GuidanceTable

Array = NDArray[np.float64]
TableMaker = Callable[..., GuidanceTable]

laws = settings(deadline=None, max_examples=60)
DEGREE = np.pi / 180.0
TURN = 2.0 * np.pi
AZIMUTH = -85.92
NAN = float("nan")

# a turn rounds: half-way between two points the nearest may be the other
CONTINUOUS = [mode for mode in Mode if mode is not Mode.NEAREST]


@pytest.fixture(scope="module")
def placed(make_table: TableMaker) -> GuidanceTable:
    """Speed (m/s), azimuth (rad, circular) and density factor; the nominal one is no middle."""
    axes = (
        np.array([4642.26, 4712.26, 4782.26]),
        AZIMUTH * DEGREE + np.array([-0.5, 0.0, 0.5]) * DEGREE,
        np.array([0.9, 1.0, 1.05, 1.1]),
    )
    return replace(make_table(axes, (1, 1, 1)), circular=(1,))


def rows(reference: Reference) -> Array:
    return np.vstack([reference.states, reference.bank_rate, reference.gains, reference.times])


def made(table: GuidanceTable, p: object, mode: Mode = Mode.AMPI) -> Reference:
    return ReferenceGenerator(table, mode).reference(p)  # type: ignore[arg-type]


# --- how far outside ------------------------------------------------------------------------------


@laws
@given(
    beyond=st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=2), mode=st.sampled_from(list(Mode))
)
def test_the_excess_is_a_share_of_the_axis_range(
    placed: GuidanceTable, beyond: list[float], mode: Mode
) -> None:
    """Share −s below the low edge, s − 1 above the high one, where 0 ≤ s ≤ 1 is inside."""
    p = np.array([4642.26 + beyond[0] * 140.0, AZIMUTH * DEGREE, 0.9 + beyond[1] * 0.2])
    reference = made(placed, p, mode)
    expected = [max(-beyond[0], beyond[0] - 1.0, 0.0), 0.0, max(-beyond[1], beyond[1] - 1.0, 0.0)]
    assert reference.excess == pytest.approx(expected, abs=1e-12)
    if mode is Mode.NOMINAL:
        assert reference.inside
    else:
        assert reference.clipped == tuple(e > 0.0 for e in reference.excess)
    far = max(expected) > FAR
    near = Health.GOOD if reference.inside else Health.BOUNDARY_REFERENCE
    assert reference.health is (Health.FAR_OUTSIDE if far else near)


def test_a_parameter_in_another_unit_is_far_outside(placed: GuidanceTable) -> None:
    nominal = [4712.26, AZIMUTH * DEGREE, 1.0]
    for i, wrong in ((0, 4.71226), (1, AZIMUTH), (2, 100.0)):
        p = nominal.copy()
        p[i] = wrong
        assert made(placed, p).health is Health.FAR_OUTSIDE
        assert max(made(placed, p).excess) > 10.0


def test_outside_an_axis_of_one_point_is_infinitely_far(make_table: TableMaker) -> None:
    table = make_table((np.array([5.0]), np.array([0.0, 1.0])))
    assert made(table, [5.0, 0.5]).health is Health.GOOD
    assert made(table, [5.1, 0.5]).excess == (np.inf, 0.0)


# --- the edge of the grid -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("nominal", "offset", "per_unit"),
    [
        ("100.10", "0.25", 1e3),
        ("-11.60", "0.5", DEGREE),
        ("71.89", "0.5", DEGREE),
        ("4712.26", "70", 1.0),
        ("-10.31", "0.5", DEGREE),
        ("-85.92", "0.5", DEGREE),
    ],
)
@pytest.mark.parametrize("sign", [-1, 1])
def test_the_edge_typed_in_the_missions_unit_is_inside(
    make_table: TableMaker,
    nominal: str,
    offset: str,
    per_unit: float,
    sign: int,
) -> None:
    """The axis is nominal + offset in SI, the edge a decimal number in the file's unit."""
    axis = float(nominal) * per_unit + float(offset) * per_unit * np.array([-1.0, 0.0, 1.0])
    edge = float(Decimal(nominal) + sign * Decimal(offset)) * per_unit
    table = make_table((axis,))
    reference = made(table, [edge])
    assert (reference.inside, reference.excess, reference.health) == (True, (0.0,), Health.GOOD)
    here = rows(reference).copy()
    exact = rows(made(table, [axis[0] if sign < 0 else axis[-1]]))
    assert here == pytest.approx(exact, rel=1e-11, abs=1e-11)


@pytest.mark.parametrize("end", [0, -1])
def test_sixteen_last_digits_beyond_are_inside_and_more_are_not(
    make_table: TableMaker, end: int
) -> None:
    axis = np.array([-3.0, 0.5, 2.5])
    outwards = -1.0 if end == 0 else 1.0
    unit = 3.0 * np.finfo(float).eps
    table = make_table((axis,))
    assert made(table, [axis[end] + outwards * 15.0 * unit]).inside
    assert not made(table, [axis[end] + outwards * 20.0 * unit]).inside


# --- angles ---------------------------------------------------------------------------------------


@laws
@given(share=st.floats(-0.5, 1.5), turns=st.integers(-3, 3), mode=st.sampled_from(CONTINUOUS))
def test_whole_turns_of_an_azimuth_do_not_matter(
    placed: GuidanceTable, share: float, turns: int, mode: Mode
) -> None:
    axis = placed.axes[1]
    here = float(axis[0] + share * (axis[-1] - axis[0]))
    expected = made(placed, [4700.0, here, 1.02], mode).copy()
    assume(
        min(abs(share - 1.2), abs(share + 0.2)) > 1e-9
    )  # a turn rounds: far outside, or just not
    got = made(placed, [4700.0, here + turns * TURN, 1.02], mode)
    assert rows(got) == pytest.approx(rows(expected), rel=1e-10, abs=1e-10)
    assert got.excess == pytest.approx(expected.excess, abs=1e-11)
    assert (got.health, got.clipped) == (expected.health, expected.clipped)


def test_27408_degrees_are_the_nominal_azimuth_and_its_edges_are_inside(
    placed: GuidanceTable,
) -> None:
    for degrees in (274.08, 273.58, 274.58, -85.42, -86.42, 634.08):
        assert made(placed, [4712.26, degrees * DEGREE, 1.0]).health is Health.GOOD
    assert made(placed, [4712.26, 274.6 * DEGREE, 1.0]).health is Health.BOUNDARY_REFERENCE


def test_the_edge_of_an_axis_over_the_meridian_is_inside_on_another_turn(
    make_table: TableMaker,
) -> None:
    """±0.5° around Greenwich, told as 359.5°: rounded with a number 700 times as large."""
    table = replace(make_table((np.array([-0.5, 0.0, 0.5]) * DEGREE,)), circular=(0,))
    for degrees in (359.5, -0.5, 0.5, 360.5, -359.5):
        assert made(table, [degrees * DEGREE]).health is Health.GOOD


def test_an_axis_across_the_date_line_takes_both_names_of_a_place(make_table: TableMaker) -> None:
    axis = np.array([-192.0, -190.0, -170.0]) * DEGREE
    table = replace(make_table((axis,)), circular=(0,))
    for one, other in ((-191.0, 169.0), (-175.0, 185.0), (-192.0, 168.0)):
        left = made(table, [one * DEGREE]).copy()
        right = made(table, [other * DEGREE])
        assert left.health is right.health is Health.GOOD
        assert rows(left) == pytest.approx(rows(right), rel=1e-11, abs=1e-11)


def test_other_parameters_have_no_turns(placed: GuidanceTable) -> None:
    assert not made(placed, [4712.26, AZIMUTH * DEGREE, 1.0 + TURN]).inside


# --- nonsense -------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", list(Mode))
@pytest.mark.parametrize(
    "p",
    [
        np.zeros(2),
        np.zeros(4),
        np.zeros((3, 1)),
        np.zeros((1, 3)),
        0.0,
        None,
        [],
        "4712",
        [[1.0], [2.0, 3.0]],
        [4712.26, "west", 1.0],
        [10**400, 0.0, 1.0],
        [NAN] * 3,
        [np.inf] * 3,
        [-np.inf] * 3,
        [1e300] * 3,
    ],
)
def test_what_is_no_vector_of_numbers_is_the_nominal_one_and_told(
    placed: GuidanceTable, p: object, mode: Mode
) -> None:
    expected = made(placed, [4712.26, AZIMUTH * DEGREE, 1.0], mode).copy()
    reference = made(placed, p, mode)
    assert reference.health is Health.BAD_PARAMETERS
    assert np.array_equal(rows(reference), rows(expected))
    assert len(reference.parameters) == len(reference.excess) == 3
    assert reference.inside is (mode is Mode.NOMINAL)


@pytest.mark.parametrize("mode", list(Mode))
@pytest.mark.parametrize("value", [NAN, np.inf, -np.inf])
@pytest.mark.parametrize("axis", range(3))
def test_one_number_that_is_none_is_nominal_and_the_others_as_told(
    placed: GuidanceTable, axis: int, value: float, mode: Mode
) -> None:
    told = [4750.0, (AZIMUTH + 0.2) * DEGREE, 0.93]
    nominal = [4712.26, AZIMUTH * DEGREE, 1.0]
    expected = made(placed, [*told[:axis], nominal[axis], *told[axis + 1 :]], mode).copy()
    reference = made(placed, [*told[:axis], value, *told[axis + 1 :]], mode)
    assert np.array_equal(rows(reference), rows(expected))
    assert reference.health is Health.BAD_PARAMETERS
    assert reference.excess == tuple(np.inf if i == axis else 0.0 for i in range(3))


def test_of_several_the_gravest_is_told(placed: GuidanceTable) -> None:
    solved = np.ones((3, 3, 4), dtype=bool)
    solved[2, 2, 3] = False
    table = replace(placed, solved=solved)
    azimuth = (AZIMUTH + 0.3) * DEGREE
    for p, health in (
        ([4750.0, azimuth, 0.95], Health.GOOD),
        ([4790.0, azimuth, 0.95], Health.BOUNDARY_REFERENCE),
        ([4790.0, azimuth, 1.07], Health.HOLE_REFERENCE),
        ([4830.0, azimuth, 1.07], Health.FAR_OUTSIDE),
        ([4830.0, NAN, 1.07], Health.BAD_PARAMETERS),
    ):
        assert made(table, p).health is health
    assert sorted(Health) == list(Health)
