"""A model's numbers as inputs of what is traced: one trace for all of one structure."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.missions import Mission, load_mission
from ampi.missions.family import MissionFamily
from ampi.missions.parameters import Path, with_numbers
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.tracing.dynamics import NodeFunction, node_dynamics
from ampi.tracing.numbers import put_together, taken_apart

Array = NDArray[np.float64]
MOVED: tuple[tuple[Path, float], ...] = (
    (("atmosphere", "density_factor"), 1.07),
    (("vehicle", "mass"), 1234.5),
    (("vehicle", "aerodynamics", "normal_quadratic"), 2.1),
    (("limits", "heat_flux"), 5.1e6),
    (("limits", "load_factor"), 7.7),
    (("limits", "bank_rate"), 0.1),
)


@pytest.fixture(scope="module")
def mission() -> Mission:
    return load_mission("shefex3")


def points(problem: OptimalControlProblem, cases: int, n: int = 4) -> tuple[Array, Array, Array]:
    """Scaled states (7, c, n), û and times (c, n)."""
    rng, shape = np.random.default_rng(6), (cases, n)
    here = np.append(problem.entry.reshape(-1, 6)[0], 0.4)[:, None, None]
    x = here * rng.uniform(0.6, 1.0, (7, *shape))
    return x, rng.uniform(-1.0, 1.0, shape), rng.uniform(0.0, 500.0, shape)


def fresh(mission: Mission) -> tuple[OptimalControlProblem, NodeFunction]:
    """f and g of a trace of its own, with the numbers of the mission for constants."""
    problem = OptimalControlProblem.of(mission)
    x, u, t, p = ca.SX.sym("x", 7), ca.SX.sym("u"), ca.SX.sym("t"), ca.SX.sym("p", 1)
    scale, mode = np.array(problem.scaling.states), ca.GlobalOptions.getNumpyMode()
    ca.GlobalOptions.setNumpyMode(-1)
    try:
        physical = x * ca.DM(scale)
        model = mission.flight_model
        f = equations_of_motion(model, physical, u * problem.angles[0].rate_limit, t)
        g = problem.functions.path(model, physical, t)
    finally:
        ca.GlobalOptions.setNumpyMode(mode)
    outputs = [ca.densify(ca.vertcat(*f) / ca.DM(scale)), ca.densify(ca.vertcat(*g))]
    return problem, NodeFunction([x, u, t, p], outputs)


def test_one_trace_serves_missions_that_differ_in_numbers(mission: Mission) -> None:
    other = with_numbers(mission, MOVED)
    first = OptimalControlProblem.of(mission)
    traced = node_dynamics.cache_info().misses
    for one in (other, *(with_numbers(mission, [moved]) for moved in MOVED)):
        assert OptimalControlProblem.of(one).dynamics is first.dynamics
    assert OptimalControlProblem.of(MissionFamily.of([mission, other])).dynamics is first.dynamics
    assert node_dynamics.cache_info().misses == traced
    for one in (mission, other):
        problem, constant = fresh(one)
        at, values = points(problem, 1), problem.dynamics.values
        for name in ("together", "one_by_one"):
            got = getattr(values, name)(*at, problem.numbers)
            expected = getattr(constant, name)(*at, [0.0])
            for a, b in zip(got, expected, strict=True):
                assert a == pytest.approx(b, rel=1e-13, abs=1e-13 * np.abs(b).max())


def test_a_family_gives_every_case_its_own_numbers(mission: Mission) -> None:
    members = [mission, with_numbers(mission, MOVED), with_numbers(mission, MOVED[:3])]
    problem = OptimalControlProblem.of(MissionFamily.of(members))
    x, u, t = points(problem, 3)
    for name in ("together", "one_by_one"):
        found = getattr(problem.dynamics.values, name)(x, u, t, problem.numbers)
        for k, one in enumerate(members):
            single, cut = OptimalControlProblem.of(one), np.s_[:, k : k + 1]
            own = getattr(single.dynamics.values, name)(
                x[cut], u[k : k + 1], t[k : k + 1], single.numbers
            )
            for whole, part in zip(found, own, strict=True):
                assert np.array_equal(whole[cut], part)


def structure(mission: Mission | MissionFamily) -> Any:
    """Which trace it has."""
    return OptimalControlProblem.of(mission).dynamics


def test_a_number_that_is_zero_is_structure(mission: Mission) -> None:
    """A term that is not there; in a family it is there where one case has it."""
    plain = structure(mission)
    ranged = with_numbers(mission, [(("objective", "ground_range"), -1e-3)])
    assert structure(ranged) is not plain
    still = with_numbers(mission, [(("vehicle", "angle_of_attack", "smoothing"), 5.0)])
    assert structure(still) is not plain
    mixed = MissionFamily.of([mission, ranged])
    assert structure(mixed) is structure(ranged)
    assert structure(mixed.take([0])) is structure(ranged)  # whatever its company


def test_what_is_taken_apart_is_put_together(mission: Mission) -> None:
    for name in ("shefex3", "cavh_wang2020", "rlv_liu2024"):
        model = load_mission(name).flight_model
        shape, numbers = taken_apart(model)
        again = put_together(shape, iter(numbers))
        assert again == model
        assert taken_apart(again)[0] == shape
        hash(shape)


@pytest.mark.parametrize(
    "path",
    [
        ("vehicle", "aerodynamics", "lift", "1", "2"),
        ("vehicle", "aerodynamics", "drag", "0", "0"),
        ("vehicle", "aerodynamics", "mach", "3"),
    ],
)
def test_a_family_may_move_an_entry_of_a_table(path: Path) -> None:
    """Then the entries of that table are numbers; the others of its mission stay constants."""
    mission = load_mission("cavh_wang2020")
    here: Any = mission
    for part in path:
        here = here[int(part)] if isinstance(here, tuple) else getattr(here, part)
    members = [with_numbers(mission, [(path, factor * here)]) for factor in (1.0, 1.02, 0.97)]
    problem = OptimalControlProblem.of(MissionFamily.of(members))
    x, u, t = points(problem, 3)
    found = problem.dynamics.values.together(x, u, t, problem.numbers)
    for k, one in enumerate(members):
        single = OptimalControlProblem.of(one)
        cut = np.s_[:, k : k + 1]
        own = single.dynamics.values.together(x[cut], u[k : k + 1], t[k : k + 1], single.numbers)
        for whole, part_ in zip(found, own, strict=True):
            assert whole[cut] == pytest.approx(part_, rel=1e-9, abs=1e-9 * np.abs(part_).max())
