"""From the entry state to the high-density reference: Eqs. (31)–(33), modes, memory."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from ampi.loading import segments_of
from ampi.onboard.reference import Mode, Reference, ReferenceGenerator
from ampi.onboard.row_layout import LINEAR_TRACKING
from ampi.onboard.table import GuidanceTable
from ampi.pseudospectral.mesh import Mesh, Phase
from database.file.writer import high_density_times

Array = NDArray[np.float64]
TableMaker = Callable[..., GuidanceTable]

laws = settings(deadline=None, max_examples=60)
shares = st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6)
anything = st.lists(st.floats(width=64), min_size=6, max_size=6)


def point_at(table: GuidanceTable, share: list[float]) -> Array:
    """A point of the hypercube at `share` of each axis."""
    return np.array(
        [min(a[0] + s * (a[-1] - a[0]), a[-1]) for a, s in zip(table.axes, share, strict=True)]
    )


def rows(reference: Reference) -> Array:
    """All 15 rows, stacked."""
    return np.vstack([reference.states, reference.bank_rate, reference.gains])


def product_form(nodes: Array, points: Array) -> Array:
    """P_FRP as printed: Eq. (32)."""
    matrix = np.ones((len(nodes), len(points)))
    for i, tau_i in enumerate(nodes):
        for k, tau_k in enumerate(nodes):
            if k != i:
                matrix[i] *= (points - tau_k) / (tau_i - tau_k)
    return matrix


# --- laws -----------------------------------------------------------------------------------------


@laws
@given(share=shares, seed=st.integers(0, 2**32 - 1))
def test_conversion_and_times_are_those_of_the_paper(share: list[float], seed: int) -> None:
    """One global interval of degree 6: Eqs. (30)–(33) written out."""
    rng = np.random.default_rng(seed)
    mesh = Mesh((Phase((6,)),))
    fixed, free = high_density_times(mesh, 500.0)
    assert (len(free), np.ptp(fixed)) == (601, 0.0)
    nodes, tau = mesh.segments[0].rule.nodes, np.linspace(-1.0, 1.0, len(fixed))
    axes = tuple(np.array([0.0, 1.0]) for _ in range(6))
    table = GuidanceTable(
        axes=axes,
        values=rng.standard_normal((2,) * 6 + (len(LINEAR_TRACKING), 7)),
        final_time=rng.uniform(400.0, 600.0, (2,) * 6),
        segments=segments_of(mesh),
        conversion=mesh.conversion(fixed + free * 500.0, 500.0).T.copy(),
        high_density_time=(fixed, free),
        centre=(0,) * 6,
    )
    expected = product_form(nodes, tau)
    assert table.conversion == pytest.approx(expected, abs=1e-11)
    generator = ReferenceGenerator(table, Mode.AMPI)
    reference = generator.reference(share)
    low = RegularGridInterpolator(axes, table.values)(share)[0]
    final_time = float(RegularGridInterpolator(axes, table.final_time)(share)[0])
    assert generator.nodal_values == pytest.approx(low, abs=1e-12)
    assert rows(reference) == pytest.approx(low @ expected, abs=1e-10)
    assert reference.final_time == pytest.approx(final_time, rel=1e-14)
    eq_33 = (final_time - 0.0) / 2.0 * tau + (final_time + 0.0) / 2.0
    assert reference.times == pytest.approx(eq_33, abs=1e-10)


@laws
@given(share=shares, mode=st.sampled_from(list(Mode)))
def test_inside_the_hypercube_nothing_is_flagged(
    table: GuidanceTable, share: list[float], mode: Mode
) -> None:
    reference = ReferenceGenerator(table, mode).reference(point_at(table, share))
    assert reference.inside
    assert not any(reference.clipped)
    assert reference.times[0] == 0.0
    assert reference.times[-1] == pytest.approx(reference.final_time, rel=1e-14)
    assert np.all(np.diff(reference.times) > 0.0)


@laws
@given(entry=anything, mode=st.sampled_from(list(Mode)))
def test_any_numbers_give_a_finite_reference(
    table: GuidanceTable, entry: list[float], mode: Mode
) -> None:
    reference = ReferenceGenerator(table, mode).reference(entry)
    assert np.all(np.isfinite(rows(reference)))
    assert np.all(np.isfinite(reference.times))
    outside = tuple(not (a[0] <= x <= a[-1]) for a, x in zip(table.axes, entry, strict=True))
    assert reference.clipped == ((False,) * 6 if mode is Mode.NOMINAL else outside)


@laws
@given(share=shares, mode=st.sampled_from([Mode.MPI, Mode.AMPI, Mode.QUADRATIC]), data=st.data())
def test_outside_flies_the_boundary_trajectory(
    table: GuidanceTable, share: list[float], mode: Mode, data: st.DataObject
) -> None:
    """Section V.A: no extrapolation."""
    generator = ReferenceGenerator(table, mode)
    boundary, outside = point_at(table, share), point_at(table, share)
    moved = data.draw(st.lists(st.integers(0, 5), min_size=1, unique=True))
    for i in moved:
        axis = table.axes[i]
        end, sign = data.draw(st.sampled_from([(axis[0], -1.0), (axis[-1], 1.0)]))
        boundary[i], outside[i] = end, end + sign * data.draw(st.floats(1e-6, 1e6))
    expected = generator.reference(boundary).copy()
    got = generator.reference(outside)
    assert np.array_equal(rows(got), rows(expected))
    assert np.array_equal(got.times, expected.times)
    assert got.clipped == tuple(i in moved for i in range(6))
    assert expected.inside


@pytest.mark.parametrize("mode", [Mode.AMPI, Mode.QUADRATIC])
def test_at_a_vertex_the_reference_is_that_vertex(table: GuidanceTable, mode: Mode) -> None:
    generator = ReferenceGenerator(table, mode)
    for index in [(0,) * 6, (1,) * 6, (2,) * 6, (0, 1, 2, 2, 1, 0)]:
        entry = [axis[i] for axis, i in zip(table.axes, index, strict=True)]
        reference = generator.reference(entry)
        assert np.array_equal(generator.nodal_values, table.values[index])
        assert reference.final_time == table.final_time[index]
        assert rows(reference) == pytest.approx(
            table.values[index] @ table.conversion, rel=1e-12, abs=1e-12
        )


@laws
@given(share=shares)
def test_mpi_is_multilinear_over_the_outer_vertices(
    table: GuidanceTable, share: list[float]
) -> None:
    ends = tuple(axis[[0, -1]] for axis in table.axes)
    corners = table.values[np.ix_(*[[0, -1]] * 6)]
    generator = ReferenceGenerator(table, Mode.MPI)
    generator.reference(point_at(table, share))
    expected = RegularGridInterpolator(ends, corners)(point_at(table, share))[0]
    assert generator.nodal_values == pytest.approx(expected, abs=1e-12)


@laws
@given(entry=anything)
def test_nominal_is_the_hypercentre_whatever_the_entry(
    table: GuidanceTable, entry: list[float]
) -> None:
    reference = ReferenceGenerator(table, Mode.NOMINAL).reference(entry)
    assert reference.final_time == table.final_time[table.centre]
    assert rows(reference) == pytest.approx(
        table.values[table.centre] @ table.conversion, rel=1e-12, abs=1e-12
    )


@pytest.mark.parametrize("mode", list(Mode))
def test_two_generators_and_two_calls_agree_to_the_bit(table: GuidanceTable, mode: Mode) -> None:
    one, two = ReferenceGenerator(table, mode), ReferenceGenerator(table, mode)
    entry = point_at(table, [0.1, 0.9, 0.3, 0.6, 0.5, 0.72])
    kept = one.reference(entry).copy()
    one.reference(point_at(table, [0.8] * 6))
    for other in (one, two):
        assert np.array_equal(rows(other.reference(entry)), rows(kept))


# --- memory ---------------------------------------------------------------------------------------


def test_a_reference_is_overwritten_by_the_next_and_a_copy_is_not(table: GuidanceTable) -> None:
    generator = ReferenceGenerator(table, Mode.AMPI)
    first = generator.reference(point_at(table, [0.2] * 6))
    copy = first.copy()
    before = rows(copy).copy(), copy.times.copy()
    second = generator.reference(point_at(table, [0.7] * 6))
    assert np.shares_memory(first.states, second.states)
    assert np.array_equal(rows(first), rows(second))
    assert np.array_equal(first.times, second.times)
    assert np.array_equal(rows(copy), before[0])
    assert np.array_equal(copy.times, before[1])
    assert not np.array_equal(rows(copy), rows(second))
    for a, b in pairwise([copy.times, copy.states, copy.bank_rate, copy.gains]):
        assert not np.shares_memory(a, b)
    for name in ("times", "states", "bank_rate", "gains"):
        assert not np.shares_memory(getattr(copy, name), getattr(second, name))
    assert (copy.final_time, copy.cell, copy.clipped, copy.inside) == (
        first.final_time,
        first.cell,
        first.clipped,
        True,
    )


WARM_UP = 2200  # calls; CPython keeps up to 2,000 freed tuples of one length for itself


def some_entries(table: GuidanceTable, n: int) -> list[Array]:
    """Entry states in and around the hypercube."""
    rng = np.random.default_rng(5)
    return [point_at(table, rng.uniform(-0.2, 1.2, 6).tolist()) for _ in range(n)]


@pytest.mark.parametrize("mode", list(Mode))
def test_references_allocate_nothing_that_lasts(table: GuidanceTable, mode: Mode) -> None:
    generator, entries = ReferenceGenerator(table, mode), some_entries(table, 100)
    tracemalloc.start()
    try:
        for k in range(WARM_UP):
            generator.reference(entries[k % 100])
        begin, _ = tracemalloc.get_traced_memory()
        for k in range(500):
            generator.reference(entries[k % 100])
        end, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert abs(end - begin) < 500  # bytes: less than one per call


@pytest.mark.parametrize("mode", list(Mode))
def test_a_reference_allocates_almost_nothing_in_passing(table: GuidanceTable, mode: Mode) -> None:
    generator, peaks = ReferenceGenerator(table, mode), []
    entries = some_entries(table, 100)
    generator.reference(entries[0])
    tracemalloc.start()
    try:
        for entry in entries:
            begin, _ = tracemalloc.get_traced_memory()
            tracemalloc.reset_peak()
            generator.reference(entry)
            peaks.append(tracemalloc.get_traced_memory()[1] - begin)
    finally:
        tracemalloc.stop()
    assert max(peaks) < 4096


# --- any number of parameters ---------------------------------------------------------------------


@pytest.mark.parametrize("d", [1, 2, 7, 10])
def test_any_number_of_parameters(make_table: Callable[..., GuidanceTable], d: int) -> None:
    """Multilinear in every direction: exact for a table that is, on uneven axes of two points."""
    rng = np.random.default_rng(d)
    axes = tuple(np.cumsum(rng.uniform(0.5, 1.5, 2)) for _ in range(d))
    table = make_table(axes)
    slopes = rng.standard_normal((d, *table.values.shape[-2:]))
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    plane = replace(table, values=np.tensordot(grid, slopes, axes=1))
    share = rng.uniform(0.0, 1.0, d)
    p = np.array([a[0] + s * (a[1] - a[0]) for a, s in zip(axes, share, strict=True)])
    generator = ReferenceGenerator(plane, Mode.AMPI)
    assert generator.reference(p).inside
    expected = np.tensordot(p, slopes, axes=1)
    assert generator.nodal_values == pytest.approx(expected, rel=1e-10, abs=1e-10)
