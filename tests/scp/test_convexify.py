"""Convexification on the tangent space of the target: what it leaves alone and what it gives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.scp.condensed.convexify import convexify_on_tangent

Array = NDArray[np.float64]
laws = settings(deadline=None, max_examples=100)
seeds = st.integers(0, 2**32 - 1)
SIZE, TARGETS, FLOOR = 15, 4, 1e-2


def symmetric(rng: np.random.Generator, eigenvalues: Array) -> Array:
    """A random symmetric matrix of given spectrum."""
    basis = np.linalg.qr(rng.normal(size=(len(eigenvalues),) * 2))[0]
    return basis @ np.diag(eigenvalues) @ basis.T


def tangent_of(target_map: Array) -> Array:
    """Orthonormal columns that span C z = 0."""
    return np.linalg.svd(target_map)[2][len(target_map) :].T


@laws
@given(seed=seeds)
def test_a_positive_definite_hessian_is_left_alone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    hessian = symmetric(rng, rng.uniform(0.1, 10.0, SIZE))
    target_map = rng.normal(size=(TARGETS, SIZE))
    convex = convexify_on_tangent(hessian, target_map, FLOOR)
    assert convex == pytest.approx(hessian, abs=1e-11)


@laws
@given(seed=seeds)
def test_the_result_is_symmetric_and_positive_definite(seed: int) -> None:
    rng = np.random.default_rng(seed)
    hessian = symmetric(rng, rng.uniform(-10.0, 10.0, SIZE))
    convex = convexify_on_tangent(hessian, rng.normal(size=(TARGETS, SIZE)), FLOOR)
    assert np.array_equal(convex, convex.T)
    assert np.linalg.eigvalsh(convex)[0] > 0.0


@laws
@given(seed=seeds)
def test_the_tangent_space_is_left_alone_where_it_is_convex(seed: int) -> None:
    # Indefinite by a curvature along the target's gradients only.
    rng = np.random.default_rng(seed)
    target_map = rng.normal(size=(TARGETS, SIZE))
    hessian = symmetric(rng, rng.uniform(0.1, 10.0, SIZE)) - 5.0 * target_map.T @ target_map
    assert np.linalg.eigvalsh(hessian)[0] < 0.0
    convex = convexify_on_tangent(hessian, target_map, FLOOR)
    tangent = tangent_of(target_map)
    assert tangent.T @ convex @ tangent == pytest.approx(tangent.T @ hessian @ tangent, abs=1e-9)
    assert np.linalg.eigvalsh(convex)[0] > 0.0
    # So a step with C z = 0 is Newton's: the reduced system is that of the Hessian itself.
    gradient = rng.normal(size=SIZE)
    steps = [
        np.linalg.solve(tangent.T @ h @ tangent, -tangent.T @ gradient) for h in (hessian, convex)
    ]
    assert steps[1] == pytest.approx(steps[0], rel=1e-6, abs=1e-9)


@laws
@given(seed=seeds)
def test_negative_curvature_on_the_tangent_space_is_reflected(seed: int) -> None:
    rng = np.random.default_rng(seed)
    target_map = rng.normal(size=(TARGETS, SIZE))
    tangent = tangent_of(target_map)
    known = np.array([-3.0, -1e-4, 0.5, *np.linspace(1.0, 9.0, SIZE - TARGETS - 3)])
    inside = symmetric(rng, known)
    normal = np.linalg.qr(target_map.T)[0]
    hessian = tangent @ inside @ tangent.T + 2.0 * normal @ normal.T
    convex = convexify_on_tangent(hessian, target_map, FLOOR)
    values = np.linalg.eigvalsh(tangent.T @ convex @ tangent)
    assert values == pytest.approx(np.sort(np.maximum(np.abs(known), FLOOR)), abs=1e-9)


@laws
@given(seed=seeds)
def test_the_schur_complement_reaches_the_floor(seed: int) -> None:
    # Eq. (2): where it is above the floor already, nothing is added.
    rng = np.random.default_rng(seed)
    target_map = rng.normal(size=(TARGETS, SIZE))
    tangent, normal = tangent_of(target_map), np.linalg.qr(target_map.T)[0]
    hessian = symmetric(rng, rng.uniform(0.1, 10.0, SIZE)) - 5.0 * target_map.T @ target_map
    convex = convexify_on_tangent(hessian, target_map, FLOOR)
    blocks = [
        [left.T @ convex @ right for right in (normal, tangent)] for left in (normal, tangent)
    ]
    schur = blocks[0][0] - blocks[0][1] @ np.linalg.solve(blocks[1][1], blocks[1][0])
    assert np.linalg.eigvalsh(schur)[0] == pytest.approx(FLOOR, rel=1e-5)
    added = normal.T @ (convex - hessian) @ normal
    before = np.linalg.eigvalsh(schur - added)
    assert np.linalg.eigvalsh(added) == pytest.approx(
        np.sort(np.maximum(FLOOR - before, 0.0)), abs=1e-6
    )
