"""Meshes: times affine in t_f, exact conversion of piecewise polynomials, refusals."""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ampi.pseudospectral.mesh import Mesh, Phase
from ampi.pseudospectral.radau import flipped_radau

laws = settings(deadline=None, max_examples=60)
final_times = st.floats(100.0, 3000.0)


@st.composite
def meshes(draw: st.DrawFn) -> Mesh:
    """One to four phases of one to three segments; all fixed ends below 90 s."""
    count = draw(st.integers(0, 3))
    gaps = draw(st.lists(st.floats(1.0, 30.0), min_size=count, max_size=count))
    phases = []
    for end in [*np.cumsum(gaps).tolist(), None]:
        segments = draw(st.lists(st.integers(1, 20), min_size=1, max_size=3))
        fractions = None
        if draw(st.booleans()):
            size = len(segments)
            parts = np.array(draw(st.lists(st.floats(0.1, 1.0), min_size=size, max_size=size)))
            inner = np.cumsum(parts)[:-1] / parts.sum()
            fractions = (0.0, *inner.tolist(), 1.0)
        phases.append(Phase(tuple(segments), end, fractions))
    return Mesh(tuple(phases))


@laws
@given(mesh=meshes())
def test_node_count(mesh: Mesh) -> None:
    degrees = [degree for phase in mesh.phases for degree in phase.degrees]
    assert mesh.n_nodes == 1 + sum(degrees)
    assert [s.rule.degree for s in mesh.segments] == degrees
    assert len(mesh.times(500.0)) == mesh.n_nodes
    collocated = np.concatenate([np.arange(mesh.n_nodes)[s.collocation] for s in mesh.segments])
    assert np.array_equal(collocated, np.arange(mesh.n_nodes - 1))


@laws
@given(mesh=meshes(), first=final_times, second=final_times, weight=st.floats(-1.0, 2.0))
def test_times_are_affine_in_the_final_time(
    mesh: Mesh, first: float, second: float, weight: float
) -> None:
    between = (1.0 - weight) * first + weight * second
    mixed = (1.0 - weight) * mesh.times(first) + weight * mesh.times(second)
    assert mesh.times(between) == pytest.approx(mixed, abs=1e-9)
    fixed, free = mesh.node_time
    assert mesh.times(first) == pytest.approx(fixed + free * first, rel=1e-15)


@laws
@given(mesh=meshes(), final_time=final_times)
def test_times_increase_from_zero_to_the_final_time_through_every_phase_end(
    mesh: Mesh, final_time: float
) -> None:
    times = mesh.times(final_time)
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(final_time, rel=1e-14)
    assert np.all(np.diff(times) > 0.0)
    for phase in mesh.phases[:-1]:
        assert np.abs(times - phase.end).min() < 1e-10


@laws
@given(mesh=meshes(), final_time=final_times)
def test_segments_are_mapped_radau_rules(mesh: Mesh, final_time: float) -> None:
    times = mesh.times(final_time)
    for s in mesh.segments:
        start = s.start[0] + s.start[1] * final_time
        half = s.half_length[0] + s.half_length[1] * final_time
        inside = times[s.nodes]
        assert inside[0] == pytest.approx(start, abs=1e-9)
        assert inside[-1] - inside[0] == pytest.approx(2.0 * half, rel=1e-9)
        tau = (inside - start) / half - 1.0
        assert tau == pytest.approx(flipped_radau(s.rule.degree).nodes, abs=1e-9)


@laws
@given(
    mesh=meshes(),
    final_time=final_times,
    fractions=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=30),
    seed=st.integers(0, 2**32 - 1),
)
def test_conversion_reproduces_piecewise_polynomials(
    mesh: Mesh, final_time: float, fractions: list[float], seed: int
) -> None:
    # A continuous function, on each segment its own Chebyshev series of the segment's degree.
    rng = np.random.default_rng(seed)
    ends = [s.start[0] + s.start[1] * final_time for s in mesh.segments] + [final_time]
    series, value = [], 0.0
    for s, (left, right) in zip(mesh.segments, pairwise(ends), strict=True):
        coefficients = rng.uniform(-1.0, 1.0, s.rule.degree + 1) / (s.rule.degree + 1)
        piece = np.polynomial.Chebyshev(coefficients, domain=[left, right])
        piece = piece + (value - piece(left))
        series.append(piece)
        value = piece(right)

    def function(times: np.ndarray) -> np.ndarray:
        index = np.clip(np.searchsorted(ends, times, side="right") - 1, 0, len(series) - 1)
        return np.array([series[k](t) for k, t in zip(index, times, strict=True)])

    times = np.array(fractions) * final_time
    nodal = np.empty(mesh.n_nodes)
    for s, piece in zip(mesh.segments, series, strict=True):
        nodal[s.nodes] = piece(mesh.times(final_time)[s.nodes])
    matrix = mesh.conversion(times, final_time)
    assert matrix.shape == (len(times), mesh.n_nodes)
    assert np.abs(matrix.sum(axis=1) - 1.0).max() < 1e-12
    assert np.abs(matrix @ nodal - function(times)).max() < 1e-10


def test_conversion_at_the_nodes_is_the_identity() -> None:
    mesh = Mesh((Phase((3, 5), 58.0), Phase((4,), 88.0), Phase((6, 7))))
    matrix = mesh.conversion(mesh.times(640.0), 640.0)
    assert matrix == pytest.approx(np.eye(mesh.n_nodes), abs=1e-9)


def test_a_boundary_is_the_first_node_of_its_segment_to_the_bit() -> None:
    mesh = Mesh((Phase((3, 5), 58.3, (0.0, 0.31, 1.0)), Phase((4,), 88.7), Phase((6, 7, 9))))
    for final_time in (451.7, 640.1, 1234.5):
        nodes = [s.nodes.start for s in mesh.segments]
        starts = np.array([s.start[0] + s.start[1] * final_time for s in mesh.segments])
        assert np.array_equal(mesh.conversion(starts, final_time), np.eye(mesh.n_nodes)[nodes])


def test_times_outside_go_on_with_the_first_and_the_last_segment() -> None:
    mesh = Mesh((Phase((3, 3), 50.0), Phase((3, 3))))
    nodal = np.abs(mesh.times(200.0) - 25.0) ** 3  # a cubic on each segment
    early, late = mesh.conversion(np.array([-5.0, 210.0]), 200.0) @ nodal
    assert early == pytest.approx(30.0**3)
    assert late == pytest.approx(185.0**3)


def test_one_free_phase_is_the_global_interval() -> None:
    mesh = Mesh((Phase((9,)),))
    assert mesh.times(2.0) == pytest.approx(1.0 + flipped_radau(9).nodes, abs=1e-15)


def test_equal_meshes_are_equal_values() -> None:
    first, second = (Mesh((Phase((3, 5), 58.0), Phase((6,)))) for _ in range(2))
    assert first == second
    assert hash(first) == hash(second)
    assert first != Mesh((Phase((3, 5), 58.0), Phase((7,))))


@pytest.mark.parametrize(
    ("degrees", "fractions", "message"),
    [
        (
            (),
            None,
            "mesh.phase.degrees: expected at least one segment of degree 1 or more, got []",
        ),
        (
            (0,),
            None,
            "mesh.phase.degrees: expected at least one segment of degree 1 or more, got [0]",
        ),
        (
            (3, 0, 4),
            None,
            "mesh.phase.degrees: expected at least one segment of degree 1 or more, got [3, 0, 4]",
        ),
        (
            (3, -1),
            None,
            "mesh.phase.degrees: expected at least one segment of degree 1 or more, got [3, -1]",
        ),
        (
            (3, 4),
            (0.0, 1.0),
            "mesh.phase.fractions: expected 3 increasing numbers from 0 to 1, got (0.0, 1.0)",
        ),
        (
            (3, 4),
            (0.1, 0.5, 1.0),
            "mesh.phase.fractions: expected 3 increasing numbers from 0 to 1, got (0.1, 0.5, 1.0)",
        ),
        (
            (3, 4),
            (0.0, 0.5, 0.9),
            "mesh.phase.fractions: expected 3 increasing numbers from 0 to 1, got (0.0, 0.5, 0.9)",
        ),
        (
            (3, 4),
            (0.0, 0.5, 1.1),
            "mesh.phase.fractions: expected 3 increasing numbers from 0 to 1, got (0.0, 0.5, 1.1)",
        ),
        (
            (3, 4),
            (-0.1, 0.5, 1.0),
            "mesh.phase.fractions: expected 3 increasing numbers from 0 to 1, got (-0.1, 0.5, 1.0)",
        ),
        (
            (3, 4),
            (1.0, 0.5, 0.0),
            "mesh.phase.fractions: expected 3 increasing numbers from 0 to 1, got (1.0, 0.5, 0.0)",
        ),
        (
            (3, 4),
            (0.0, 0.0, 1.0),
            "mesh.phase.fractions: expected 3 increasing numbers from 0 to 1, got (0.0, 0.0, 1.0)",
        ),
        (
            (3, 4),
            (0.0, 0.7, 0.7),
            "mesh.phase.fractions: expected 3 increasing numbers from 0 to 1, got (0.0, 0.7, 0.7)",
        ),
    ],
)
def test_bad_phases_are_named(
    degrees: tuple[int, ...], fractions: tuple[float, ...] | None, message: str
) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        Phase(degrees, None, fractions)


@pytest.mark.parametrize(
    ("ends", "message"),
    [
        ((), "mesh: every phase but the last needs an end time, the last must be free; got []"),
        ((58.0, 88.0), "the last must be free; got [58.0, 88.0]"),
        ((None, None), "the last must be free; got [None, None]"),
        ((88.0, 58.0, None), "mesh: phase ends must increase from zero, got [88.0, 58.0] s"),
        ((0.0, None), "mesh: phase ends must increase from zero, got [0.0] s"),
    ],
)
def test_bad_meshes_are_named(ends: tuple[float | None, ...], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        Mesh(tuple(Phase((3,), end) for end in ends))
