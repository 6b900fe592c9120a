"""The energy domain: sides of the bank angle, bounds of the guess, curvature, flights of a control."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.papers.liu2015 import liu2015_case
from ampi.scp.literature.chattering import positive_share, reversals
from ampi.scp.literature.energy_domain import EnergyDomain
from ampi.scp.literature.methods import METHODS
from ampi.scp.literature.starts import Start

Array = NDArray[np.float64]


@pytest.fixture(scope="module", params=("minimum time", "no-fly zones"))
def start(request: pytest.FixtureRequest) -> Start:
    found = METHODS["liu2015"].start(liu2015_case(request.param))
    assert found is not None
    return found


def domain(start: Start) -> EnergyDomain:
    assert isinstance(start.formulation, EnergyDomain)
    return start.formulation


def test_the_side_alternates_and_the_first_half_wave_is_halved(start: Start) -> None:
    form = domain(start)
    side = form.side(np.linspace(0.0, form.energy_range, 20001))
    assert set(side) == {1.0, -1.0} and side[0] == 1.0
    changes = np.flatnonzero(np.diff(side))
    assert len(changes) >= 4
    # in ln V a half-wave of constant L/D has one length: the first is half of the second
    fine = np.linspace(0.0, form.energy_range, 20001)
    turned = form._turn(fine)[changes]
    assert turned[0] == pytest.approx(0.5 * form.half_wave, rel=1e-2)
    assert np.diff(turned) == pytest.approx(form.half_wave, rel=1e-2)


def test_the_guess_lies_within_the_bounds_and_ends_at_the_target(start: Start) -> None:
    form, at = domain(start), start.iterate
    s = at.mesh.times(at.final)
    altitude = at.states[:, 0] * form.state_scale[0]
    assert np.all(altitude >= form.altitude_floors(s).max(axis=0))
    ceiling = form.altitude_ceiling(s)
    assert ceiling is None or np.all(altitude <= ceiling + 1e-6)
    target = form.mission.target
    assert at.states[0] == pytest.approx(form.entry)
    assert altitude[-1] == pytest.approx(target.altitude)
    assert at.states[-1, 1:3] == pytest.approx([target.longitude, target.latitude], abs=1e-9)


def test_the_curvature_is_the_second_derivative_of_the_lagrangian(start: Start) -> None:
    form, at = domain(start), start.iterate
    generator = np.random.default_rng(1)
    s, n = at.mesh.times(at.final), len(at.states)
    u = generator.uniform(-0.7, 0.7, (n, 2))
    mu = generator.normal(size=(n, 5))
    found = form.curvature(at.mesh, at.states, u, at.final, mu, np.zeros((n, len(form.terms))))
    for state, step in ((0, 1e-3), (4, 1e-4)):
        move = np.zeros(5)
        move[state] = step
        f = [form.rates(at.states + k * move, u, s) for k in (-1.0, 0.0, 1.0)]
        second = np.sum(mu * (f[0] - 2.0 * f[1] + f[2]), axis=1) / step**2
        scale = np.abs(second).max()
        assert found[:, state] == pytest.approx(second, rel=1e-3, abs=1e-4 * scale)


def test_a_control_on_the_circle_is_flown_with_its_own_reversals() -> None:
    s = np.linspace(0.0, 1.0, 11)
    bank = np.radians(np.where(s < 0.45, 60.0, -60.0))
    first, turns = reversals(s, np.column_stack([np.cos(bank), np.sin(bank)]))
    assert first == 1.0
    assert turns == pytest.approx([0.45])


def test_a_relaxed_control_is_the_mean_of_both_sides() -> None:
    u = np.array([[0.5, 0.3], [0.5, -0.3], [0.2, 0.0]])
    share, reach = positive_share(u), np.sqrt(1.0 - u[:, 0] ** 2)
    assert share * reach - (1.0 - share) * reach == pytest.approx(u[:, 1])
