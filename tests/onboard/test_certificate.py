"""Certificates against flights, and what they say of optima, limits and nonsense."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.loading import load_guidance
from ampi.missions.loading import load_mission, parse_mission
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.onboard.certificate import Certifier, Thresholds, Verdict
from ampi.onboard.reference import Reference
from ampi.onboard_model import certifier_of
from ampi.physics.state import ALTITUDE, BANK, LATITUDE, LONGITUDE
from ampi.propagation.bank_profile import fly_to_speed
from ampi.report.figures.certificates import certificate_figure
from ampi.simulation.certificate_truth import (
    check_certificates,
    random_entries,
    rank_correlation,
)
from tests.support.databases import small_database
from tests.support.missions import small_mission, text_on_grid

Array = NDArray[np.float64]

ENTRIES = 60
MESH_ERROR = 20.0  # m: what the mesh leaves along an optimum, and a little more beside one


@pytest.fixture(scope="module")
def database_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_database(tmp_path_factory)


@pytest.fixture(scope="module")
def guidance(database_file: Path) -> Guidance:
    return load_guidance(database_file)


@pytest.fixture(scope="module")
def certifier(guidance: Guidance) -> Certifier:
    return certifier_of(small_mission(), guidance.table.segments)


def aside(guidance: Guidance, shares: tuple[float, float]) -> Reference:
    """The reference at shares of the ranges of both axes."""
    ends = [axis[[0, -1]] for axis in guidance.table.axes]
    return guidance.reference(
        [low + share * (high - low) for (low, high), share in zip(ends, shares, strict=True)]
    ).copy()


@pytest.mark.parametrize("mode", ["ampi", "quadratic", "nominal"])
def test_predicted_misses_are_those_of_flights(guidance: Guidance, mode: str) -> None:
    mission = small_mission()
    entries = random_entries(mission, ENTRIES, seed=3)
    checked = check_certificates(mission, guidance.in_mode(mode), entries)
    assert checked.flown.max() > 100.0 * MESH_ERROR
    assert checked.rank_correlation > 0.99
    assert np.all(checked.error < MESH_ERROR + 1e-3 * checked.flown)
    assert checked.right >= 0.95
    assert 0 < np.count_nonzero(checked.inside) <= ENTRIES
    assert certificate_figure({guidance.in_mode(mode).mode: checked}).axes


def test_the_truth_of_a_rank_correlation() -> None:
    values = np.array([3.0, 1.0, np.inf, 2.0, np.inf])
    assert rank_correlation(values, np.exp(-values)) == pytest.approx(-1.0)
    assert rank_correlation(values, values**3) == pytest.approx(1.0)
    assert abs(rank_correlation(np.arange(4.0), np.array([1.0, 0.0, 0.0, 1.0]))) < 1e-12


def test_an_optimum_is_a_flight_at_its_nodes(guidance: Guidance, certifier: Certifier) -> None:
    """Optima have no defect where they are collocated; what lies between two of them has."""
    optimum = certifier.certificate(aside(guidance, (0.5, 0.0)))
    between = certifier.certificate(aside(guidance, (0.25, 0.3)))
    assert optimum.verdict is between.verdict is Verdict.INSIDE
    assert optimum.defect[0] < 1e-3 < 0.1 * between.defect[0]
    assert np.all(optimum.defect_at_nodes < 0.1 * between.defect_at_nodes)
    assert optimum.horizontal_miss < MESH_ERROR < between.horizontal_miss
    assert np.all(optimum.defect_between > optimum.defect_at_nodes)


def test_defects_are_those_of_the_physics(guidance: Guidance, certifier: Certifier) -> None:
    """Midway between the nodes, by differences of the reference's own polynomials."""
    reference = aside(guidance, (0.4, 0.6))
    mesh, model = small_mission().pseudospectral_mesh, certifier.model
    nodes = mesh.times(reference.final_time)
    middle, step = 0.5 * (nodes[1:] + nodes[:-1]), 1e-3
    rows = [
        reference.nodal @ mesh.conversion(middle + shift, reference.final_time).T
        for shift in (-step, 0.0, step)
    ]
    slope = (rows[2][:7] - rows[0][:7]) / (2.0 * step)
    defect = np.abs(slope - model.rates(rows[1][:7], rows[1][7], middle)).max(axis=1)
    found = certifier.certificate(reference).defect_between
    np.testing.assert_allclose(found, defect, rtol=1e-3, atol=1e-9)


def test_margins_are_what_the_mission_s_limits_leave(
    guidance: Guidance, certifier: Certifier
) -> None:
    reference, mission = aside(guidance, (0.7, 0.1)), small_mission()
    limits = PathLimits.of(mission)
    use = limits.use(mission.flight_model, reference.states, reference.bank_rate, reference.times)
    found = certifier.certificate(reference)
    assert found.limits == limits.names
    np.testing.assert_allclose(found.margins, 1.0 - np.max(use, axis=1), atol=1e-9)
    # the same certificate where one limit is a little lower
    load = limits.loads[2] * (1.0 - found.margins[2])
    for share, verdict in ((1.0 / 1.03, Verdict.LIMIT_EXCEEDED), (1.0 / 1.01, Verdict.INSIDE)):
        lower = mission.model_copy(
            update={"limits": mission.limits.model_copy(update={"load_factor": share * load})}
        )
        assert (
            certifier_of(lower, guidance.table.segments).certificate(reference).verdict is verdict
        )


def test_many_certificates_are_those_of_each(guidance: Guidance, certifier: Certifier) -> None:
    references = [aside(guidance, (0.1 * i, 1.1 - 0.2 * i)) for i in range(7)]
    together = certifier.certificates(references)
    for i, reference in enumerate(references):
        alone, own = certifier.certificate(reference), together.of(i)
        assert own.verdict is alone.verdict
        np.testing.assert_allclose(own.miss, alone.miss, atol=1e-4)
        for name in ("defect", "defect_at_nodes", "defect_between", "margins", "flight_time"):
            np.testing.assert_allclose(
                getattr(own, name), getattr(alone, name), rtol=1e-9, atol=1e-9
            )


def test_outside_it_is_clipped_and_far_outside_rejected(
    guidance: Guidance, certifier: Certifier
) -> None:
    clipped = certifier.certificate(aside(guidance, (0.5, 1.1)))
    assert clipped.verdict is Verdict.CLIPPED and not clipped.verdict.rejected
    assert clipped.horizontal_miss > 1e3
    far = certifier.certificate(aside(guidance, (-4.0, 6.0)))
    assert far.verdict is Verdict.TARGET_MISSED and far.verdict.rejected
    strict = replace(certifier, thresholds=Thresholds(horizontal=1.0, altitude=1.0))
    assert strict.certificate(aside(guidance, (0.5, 1.1))).verdict is Verdict.TARGET_MISSED


@pytest.mark.parametrize(
    "parameters",
    [[np.nan, 0.0], [4700.0, np.inf], [-np.inf, np.nan], "word", [4700.0], [1e300, -0.18]],
)
def test_parameters_that_are_no_numbers_are_told(
    guidance: Guidance, certifier: Certifier, parameters: object
) -> None:
    found = certifier.certificate(guidance.reference(parameters).copy())  # type: ignore[arg-type]
    assert found.verdict is Verdict.BAD_PARAMETERS and found.verdict.rejected
    assert np.all(np.isfinite(found.margins))


@pytest.mark.parametrize("parameters", [[1e9, -0.18], [-4712.0, -10.31], [0.0, 0.0], [4712.0, 1.6]])
def test_nonsense_is_rejected_without_an_exception(
    guidance: Guidance, certifier: Certifier, parameters: list[float]
) -> None:
    found = certifier.certificate(guidance.reference(parameters).copy())
    assert found.verdict is Verdict.TARGET_MISSED
    assert np.all(np.isinf(found.miss)) or found.horizontal_miss > certifier.thresholds.horizontal


FACTORS = """[grid]
azimuth_deg = [-0.5, 0.0, 0.5]
density_factor = [-0.1, 0.0, 0.1]
vehicle.mass_kg = [-10.0, 0.0, 10.0]
target.latitude_deg = [-0.1, 0.0, 0.1]
limits.heat_flux_MW_per_m2 = [-0.5, 0.0, 0.5]
"""


def test_parameters_move_air_vehicle_target_and_limits_of_a_flight(guidance: Guidance) -> None:
    """The nominal optimum in another world, against the physics with those numbers."""
    mission = parse_mission(text_on_grid(FACTORS))
    certifier = certifier_of(mission, guidance.table.segments)
    optimum = aside(guidance, (0.5, 0.5))
    p = mission.nominal_parameters + np.array([2.0 * np.pi - 2e-3, 0.04, -5.0, 1e-3, -3e5])
    found = certifier.certificate(replace(optimum, parameters=tuple(p.tolist())))
    family = mission.family(p[None])
    truth = fly_to_speed(
        family.flight_model(),
        mission.pseudospectral_mesh,
        optimum.nodal[None, BANK],
        family.entry_states,
        np.array([optimum.final_time]),
        family.target("speed"),
        60.0,
    )[0]
    radius, target = certifier.model.equatorial_radius, mission.with_parameters(p).target
    miss = [
        radius * np.cos(target.latitude) * (truth[LONGITUDE] - target.longitude),
        radius * (truth[LATITUDE] - target.latitude),
        truth[ALTITUDE] - target.altitude,
    ]
    assert found.horizontal_miss > 5e3
    np.testing.assert_allclose(found.miss, miss, atol=3.0 * MESH_ERROR)
    use = PathLimits.of(mission.with_parameters(p)).use(
        mission.with_parameters(p).flight_model,
        optimum.states,
        optimum.bank_rate,
        optimum.times,
    )
    np.testing.assert_allclose(found.margins, 1.0 - np.max(use, axis=1), atol=1e-9)


def test_a_parameter_that_the_model_holds_fixed_is_refused_on_the_ground(
    guidance: Guidance,
) -> None:
    grid = "[grid]\nspeed_m_per_s = [0.0, 9.0]\nvehicle.angle_of_attack.end = [0.0, 4.0]\n"
    smooth = text_on_grid(grid).replace("smoothing = 0.0", "smoothing = 5.0")
    with pytest.raises(
        ValueError, match=r"grid\.vehicle\.angle_of_attack\.end: expected a number of"
    ):
        certifier_of(parse_mission(smooth), guidance.table.segments)


def test_a_free_position_has_no_horizontal_miss(guidance: Guidance) -> None:
    mission = small_mission()
    free = mission.model_copy(
        update={"target": mission.target.model_copy(update={"position": "free"})}
    )
    found = certifier_of(free, guidance.table.segments).certificate(aside(guidance, (0.2, 0.9)))
    assert found.horizontal_miss == 0.0 and abs(found.miss[2]) > 0.1


def test_random_entries_reach_a_fifth_of_a_range_outside_in_their_second_half() -> None:
    mission: Mission = load_mission("shefex3")
    entries = random_entries(mission, 400, seed=5)
    low, high = np.array([axis[[0, -1]] for axis in mission.grid_axes]).T
    excess = np.maximum(low - entries, entries - high) / (high - low)
    assert np.all(excess[:200] <= 0.0)
    assert 0.15 < excess[200:].max() <= 0.2
