"""Figures, sheets and datasets of flights whose angle of attack is steered."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from ampi.loading import segments_of
from ampi.missions.loading import load_mission
from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode, ReferenceGenerator
from ampi.onboard.row_layout import LINEAR_TRACKING
from ampi.onboard.table import GuidanceTable
from ampi.report.figures.database import database_constraints, database_controls
from ampi.report.figures.single import reference_figure, trajectory_figure
from ampi.report.html import mission_statement
from ampi.report.notebook.sheets import sheet_of
from ampi.report.quantities import ANGLE_OF_ATTACK, ANGLE_OF_ATTACK_RATE, BANK_RATE
from ampi.trajectory import Trajectory
from database.file.writer import high_density_times
from tests.support.steered import steered_flight, steered_mission

OVER_SPEED = """[angle_of_attack]
lower_deg = [10.0, 20.0]
upper_deg = [40.0, 44.0]
over = "speed"
at = [1500.0, 4000.0]
rate_deg_per_s = 5.0
acceleration_deg_per_s2 = 4.0

"""


@pytest.fixture(scope="module")
def mission() -> Mission:
    return steered_mission()


@pytest.fixture(scope="module")
def flight(mission: Mission) -> Trajectory:
    return steered_flight(mission)


@pytest.fixture(scope="module")
def table(flight: Trajectory) -> GuidanceTable:
    """Of one case, without gains."""
    fixed, free = high_density_times(flight.mesh, flight.final_time)
    times = fixed + free * flight.final_time
    states, gains = flight.states, np.zeros((7, flight.mesh.n_nodes))
    rows = np.vstack([states[:7], flight.bank_rate, gains, states[7:]])
    return GuidanceTable(
        axes=(np.array([4712.26]), np.array([-0.18])),
        values=rows[None, None],
        final_time=np.array([[flight.final_time]]),
        segments=segments_of(flight.mesh),
        conversion=np.ascontiguousarray(flight.mesh.conversion(times, flight.final_time).T),
        high_density_time=(fixed, free),
        centre=(0, 0),
        layout=LINEAR_TRACKING.with_angle_of_attack,
    )


def drawn(figure: Figure, label: str) -> list[tuple[str, np.ndarray]]:
    """Marker or dashes, and ordinates, of the lines of a panel."""
    (panel,) = [axes for axes in figure.axes if axes.get_ylabel() == label]
    return [
        (str(line.get_linestyle()) + str(line.get_marker()), np.asarray(line.get_ydata(), float))
        for line in panel.lines
    ]


def test_an_optimum_is_drawn_with_both_angles_and_both_rates(
    mission: Mission, flight: Trajectory
) -> None:
    figure = trajectory_figure(mission, flight)
    angle = [y for _, y in drawn(figure, ANGLE_OF_ATTACK.label)]
    assert angle[1] == pytest.approx(np.degrees(flight.states[7]))
    assert [y[0] for y in angle[2:]] == pytest.approx([10.0, 42.0])
    rate = [y for _, y in drawn(figure, ANGLE_OF_ATTACK_RATE.label)]
    assert rate[1] == pytest.approx(np.degrees(flight.controls[1]))
    assert [y[0] for y in rate[2:]] == pytest.approx([-5.0, 5.0])


def test_bounds_over_speed_are_drawn_along_the_flight(flight: Trajectory) -> None:
    lines = drawn(trajectory_figure(steered_mission(OVER_SPEED), flight), ANGLE_OF_ATTACK.label)
    low, high = lines[2][1], lines[3][1]
    assert (low[0], low[-1], high[0], high[-1]) == pytest.approx((20.0, 10.0, 44.0, 40.0))


def test_a_reference_is_drawn_as_the_optimum_that_it_is(
    mission: Mission, flight: Trajectory, table: GuidanceTable
) -> None:
    reference = ReferenceGenerator(table, Mode.NOMINAL).reference([4712.26, -0.18])
    figure = reference_figure(mission, reference)
    rate = drawn(figure, ANGLE_OF_ATTACK_RATE.label)[0][1]
    expected = flight.controls_at(reference.times)[1]
    assert rate[20:-1] == pytest.approx(np.degrees(expected)[20:-1], abs=1e-6)
    assert len(drawn(figure, BANK_RATE.label)) == 3


def test_a_database_is_drawn_with_its_own_angles_and_their_bounds(
    mission: Mission, flight: Trajectory, table: GuidanceTable
) -> None:
    lines = drawn(database_controls(mission, table), ANGLE_OF_ATTACK.label)
    assert lines[0][1][[0, -1]] == pytest.approx(np.degrees(flight.states[7, [0, -1]]))
    assert [y[0] for _, y in lines[1:]] == pytest.approx([10.0, 42.0])
    assert len(drawn(database_controls(steered_mission(OVER_SPEED), table), "Bank angle (deg)")) > 1
    assert database_constraints(mission, table).axes


def test_the_report_says_by_what_it_is_steered(mission: Mission, table: GuidanceTable) -> None:
    assert "steered by both angles" in mission_statement(mission, table)
    scheduled = load_mission("shefex3")
    assert "steered by bank angle alone" in mission_statement(scheduled, table)


def test_sheets_and_datasets_tell_of_it(mission: Mission, flight: Trajectory) -> None:
    assert dict(sheet_of(flight).rows)["angle of attack"].startswith("20")
    assert dict(sheet_of(mission).rows)["limits"].endswith("; angle of attack 10° to 42°, 5°/s")
    found = flight.to_xarray()
    assert list(found)[-3:] == ["angle_of_attack", "bank_rate", "angle_of_attack_rate"]
    assert found["angle_of_attack_rate"].attrs["units"] == "rad/s"
    assert flight.summary()["greatest_angle_of_attack_deg"] == pytest.approx(
        np.degrees(flight.states[7].max())
    )
    assert "α" in flight._repr_html_()
