"""Benchmarks as tests: run once by `make test`, timed by `pytest --benchmark-enable`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import ampi
from ampi.loading import segments_of
from ampi.onboard.reference import Mode, ReferenceGenerator
from ampi.onboard.row_layout import LINEAR_TRACKING
from ampi.onboard.table import GuidanceTable
from ampi.scp.condensed.iterate import Flight, RestorationSettings
from ampi.scp.guess import from_trajectory
from ampi.scp.problem.scaled_problem import OptimalControlProblem

Benchmark = Callable[..., Any]


@pytest.fixture(scope="module")
def table() -> GuidanceTable:
    """A table of the full size, with random content: the time does not depend on it."""
    rng = np.random.default_rng(0)
    axes = tuple(np.array([-1.0, 0.0, 1.0]) for _ in range(6))
    conversion = rng.uniform(size=(64, 601))
    conversion /= conversion.sum(axis=0)
    return GuidanceTable(
        axes=axes,
        values=rng.normal(size=(*(3,) * 6, len(LINEAR_TRACKING), 64)),
        final_time=rng.uniform(600.0, 700.0, size=(3,) * 6),
        segments=segments_of(ampi.load_mission("shefex3").pseudospectral_mesh),
        conversion=conversion,
        high_density_time=(np.zeros(601), np.linspace(0.0, 1.0, 601)),
        centre=(1,) * 6,
    )


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode is not Mode.HERMITE])
def test_one_reference_online(benchmark: Benchmark, table: GuidanceTable, mode: Mode) -> None:
    generator = ReferenceGenerator(table, mode)
    reference = benchmark(generator.reference, np.full(6, 0.3))
    assert np.all(np.isfinite(reference.states))


def test_nominal_solution(benchmark: Benchmark) -> None:
    optimum = benchmark(ampi.solve, ampi.load_mission("shefex3"))
    assert optimum.status.ok


def test_neighbour(benchmark: Benchmark) -> None:
    mission = ampi.load_mission("shefex3")
    nominal = ampi.solve(mission)
    corner = mission.with_entry([axis[-1] for axis in mission.grid_axes])
    optimum = benchmark(ampi.solve, corner, guess=nominal)
    assert optimum.status.ok


def test_linearise_and_condense(benchmark: Benchmark) -> None:
    mission = ampi.load_mission("shefex3")
    optimum = ampi.solve(mission)
    problem = OptimalControlProblem.of(mission)
    flight = Flight.of(problem, RestorationSettings())
    point = flight.first_point(from_trajectory(optimum, mission))
    assert point is not None
    condensed = benchmark(flight.linearise, point.iterate)
    assert np.all(np.isfinite(condensed.moving))
