"""Laws of the transcriptions as linear operators."""

from __future__ import annotations

import numpy as np
import pytest

from ampi.pseudospectral.mesh import Mesh, Phase
from ampi.scp.literature.collocation import Collocation, line_mesh, radau, trapezoid

FINAL = 7.0
MESHES = {
    "trapezoid": trapezoid(line_mesh(np.array([0.0, 0.1, 0.35, 0.5, 0.9, 1.0]))),
    "global": radau(Mesh((Phase((6,)),))),
    "hp": radau(Mesh((Phase((3, 4, 2), None, (0.0, 0.2, 0.7, 1.0)),))),
}


@pytest.mark.parametrize("rule", MESHES.values(), ids=MESHES)
def test_a_quadratic_satisfies_the_equations_and_is_integrated(rule: Collocation) -> None:
    s = rule.mesh.times(FINAL)
    x, rate = (2.0 - s + 0.5 * s**2)[:, None], (s - 1.0)[:, None]
    assert np.abs(rule.residual(x, rate, FINAL)).max() < 1e-12
    assert rule.weights(FINAL) @ rate[:, 0] == pytest.approx(x[-1, 0] - x[0, 0], abs=1e-12)
    assert rule.weights(FINAL).sum() == pytest.approx(FINAL)


@pytest.mark.parametrize("rule", MESHES.values(), ids=MESHES)
def test_the_final_value_enters_as_its_derivative_says(rule: Collocation) -> None:
    x, f = np.random.default_rng(1).standard_normal((2, rule.n_nodes, 3))
    step = 1e-4
    change = rule.residual(x, f, FINAL + step) - rule.residual(x, f, FINAL - step)
    expected = -rule.half_free[:, None] * (rule.right @ f)
    assert np.allclose(change / (2.0 * step), expected, atol=1e-9)


def test_radau_is_exact_to_its_degree() -> None:
    rule = MESHES["global"]
    s = rule.mesh.times(FINAL)
    x, rate = (s**6)[:, None], (6.0 * s**5)[:, None]
    assert np.abs(rule.residual(x, rate, FINAL)).max() < 1e-9 * FINAL**6
