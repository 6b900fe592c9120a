"""Every figure: units on every axis, finite data, the same bytes twice, settings left alone."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from ampi.cli.output_files import check_output
from ampi.missions.flight_sections import NoFlyZoneSection
from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode, ReferenceGenerator
from ampi.onboard.table import GuidanceTable
from ampi.physics.planet import destination
from ampi.report.figures.campaign import (
    campaign_constraints,
    campaign_controls,
    campaign_ground_tracks,
    campaign_states,
    campaign_tracking_errors,
    compared,
)
from ampi.report.figures.database import (
    HighDensityDatabase,
    database_constraints,
    database_controls,
    database_ground_tracks,
    database_states,
)
from ampi.report.figures.footprint import (
    campaign_footprint,
    campaign_histograms,
    footprint_ellipse,
    logarithmic_bins,
)
from ampi.report.figures.ground_track import (
    TrackBundle,
    draw_ground_tracks,
    draw_target_window,
    map_and_window,
    tangent_plane,
)
from ampi.report.figures.runge import runge_phenomenon
from ampi.report.figures.single import reference_figure, trajectory_figure
from ampi.report.figures.style import (
    INK,
    LIMIT_COLOUR,
    MODE_STYLES,
    ImageFormat,
    house_style,
    image_bytes,
    new_figure,
    save_figure,
)
from ampi.simulation.flights import Flights
from ampi.simulation.statistics import ellipse_area
from ampi.trajectory import Status, Trajectory

DATABASE = (database_states, database_controls, database_ground_tracks, database_constraints)
CAMPAIGN = (
    campaign_states,
    campaign_tracking_errors,
    campaign_controls,
    campaign_ground_tracks,
    campaign_constraints,
    campaign_footprint,
    campaign_histograms,
)


def nominal_trajectory(mission: Mission, table: GuidanceTable) -> Trajectory:
    """The table's nominal case as an optimum of the offline side."""
    row, final_time = table.values[table.centre], float(table.final_time[table.centre])
    return Trajectory(mission.pseudospectral_mesh, row[:7], row[7], final_time, 0.0, Status.SOLVED)


def assert_sound(figure: Figure) -> None:
    """Axis labels with units; only finite numbers drawn; limits that hold some data."""
    panels = [a for axes in figure.axes for a in (axes, *axes.child_axes)]
    assert panels
    bottom = {a.get_subplotspec().colspan.start: a for a in figure.axes}  # type: ignore[union-attr]
    for axes in panels:
        shares_time = axes in figure.axes and axes not in bottom.values()
        labels = [axes.get_ylabel()] + ([] if shares_time else [axes.get_xlabel()])
        for label in filter(None, labels):
            assert re.search(r"\(.+\)$", label), label
        assert np.all(np.isfinite([*axes.get_xlim(), *axes.get_ylim()]))
        for collection in axes.collections:
            for path in collection.get_paths():
                assert np.all(np.isfinite(path.vertices))
        for line in axes.lines:
            assert np.all(np.isfinite(np.asarray(line.get_xydata(), dtype=float)))
        assert axes.collections or axes.lines or axes.patches
    assert all(a.get_xlabel() for a in bottom.values())
    assert any(a.get_ylabel() for a in figure.axes)
    assert image_bytes(figure).startswith(b"\x89PNG")


@pytest.mark.parametrize("draw", DATABASE)
def test_database_figures_are_sound(
    draw: Callable[[Mission, GuidanceTable], Figure], mission: Mission, table: GuidanceTable
) -> None:
    assert_sound(draw(mission, table))


@pytest.mark.parametrize("draw", CAMPAIGN)
def test_campaign_figures_are_sound(
    draw: Callable[[Mission, dict[str, Flights]], Figure],
    mission: Mission,
    campaigns: dict[str, Flights],
) -> None:
    assert_sound(draw(mission, campaigns))


@pytest.mark.parametrize("draw", CAMPAIGN)
def test_one_campaign_alone_can_be_drawn(
    draw: Callable[[Mission, dict[str, Flights]], Figure],
    mission: Mission,
    campaigns: dict[str, Flights],
) -> None:
    assert_sound(draw(mission, {"only": campaigns["mpi"]}))


def test_single_figures_are_sound(mission: Mission, table: GuidanceTable) -> None:
    assert_sound(trajectory_figure(mission, nominal_trajectory(mission, table)))
    reference = ReferenceGenerator(table, Mode.AMPI).reference(mission.entry_state)
    assert_sound(reference_figure(mission, reference))


def test_trajectory_figure_shows_its_nodes(mission: Mission, table: GuidanceTable) -> None:
    trajectory = nominal_trajectory(mission, table)
    altitude = trajectory_figure(mission, trajectory).axes[0]
    dots = next(line for line in altitude.lines if line.get_marker() == "o")
    np.testing.assert_allclose(np.asarray(dots.get_ydata()), trajectory.states[0] / 1e3)


def test_runge_figure_is_sound_and_radau_wins(mission: Mission) -> None:
    figure = runge_phenomenon()
    assert_sound(figure)
    uniform, radau = (float(a.get_title().rsplit(" ", 1)[1]) for a in figure.axes[-2:])
    assert uniform > 100.0 > 0.1 > radau


def test_limits_stand_where_the_mission_says(mission: Mission, table: GuidanceTable) -> None:
    panels = database_controls(mission, table).axes
    dashed = [float(np.asarray(line.get_ydata())[0]) for line in panels[1].lines[1:]]
    np.testing.assert_allclose(dashed, [-60.0, 60.0])


def test_high_density_database_matches_the_flying_reference(
    mission: Mission, table: GuidanceTable
) -> None:
    database = HighDensityDatabase.of(table)
    reference = ReferenceGenerator(table, Mode.NOMINAL).reference(mission.entry_state)
    np.testing.assert_allclose(database.times[database.nominal], reference.times)
    np.testing.assert_allclose(
        database.states[:, database.nominal], reference.states, rtol=1e-12, atol=1e-12
    )


def test_angles_on_another_turn_are_drawn_where_the_flights_are(
    mission: Mission, campaigns: dict[str, Flights]
) -> None:
    turn, k = np.array([1, 5]), {"one": campaigns["mpi"]}
    far = k["one"].states.copy()
    far[:, turn] += 2.0 * np.pi
    flown = {"one": replace(k["one"], states=far)}
    for before, after in zip(
        campaign_tracking_errors(mission, k).axes,
        campaign_tracking_errors(mission, flown).axes,
        strict=True,
    ):
        assert after.get_ylim() == pytest.approx(before.get_ylim(), rel=1e-6, abs=1e-9)
    target = mission.target.model_copy(update={"longitude": mission.target.longitude + 2.0 * np.pi})
    other = mission.model_copy(update={"target": target})
    stars = [campaign_ground_tracks(m, k).axes[0].lines for m in (mission, other)]
    here, there = (
        next(np.asarray(line.get_xydata()) for line in lines if line.get_marker() == "*")
        for lines in stars
    )
    assert there == pytest.approx(here, rel=1e-12)
    level = [
        [np.asarray(a.lines[-1].get_ydata())[0] for a in campaign_states(m, k).axes[:4]]
        for m in (mission, other)
    ]
    assert level[0] == pytest.approx(level[1], rel=1e-12)


def test_offsets_from_a_target_are_true_at_any_latitude(mission: Mission) -> None:
    radius = mission.flight_model.planet.equatorial_radius
    for latitude in (0.0, 1.2, 0.5 * np.pi - 1e-3):
        target = mission.target.model_copy(update={"latitude": latitude, "longitude": 3.0})
        there = mission.model_copy(update={"target": target})
        azimuth, away = np.linspace(0.1, 6.2, 7), 0.02
        points = destination(3.0 - 2.0 * np.pi, latitude, azimuth, away)
        offsets = tangent_plane(there, *points) / (radius * away)
        expected = np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)
        assert offsets == pytest.approx(expected, abs=1e-9)


def test_ellipse_has_the_verdicts_area(mission: Mission, campaigns: dict[str, Flights]) -> None:
    flights = campaigns["mpi"]
    good = flights.reached
    ellipse = footprint_ellipse(flights)
    assert ellipse is not None
    area = ellipse_area(flights.along[good], flights.across[good])
    assert ellipse.area == pytest.approx(area)
    (edge,) = [
        patch
        for patch in campaign_footprint(mission, {"mpi": flights}).axes[1].patches
        if isinstance(patch, Polygon)
    ]
    x, y = edge.get_xy().T
    drawn = 0.5 * abs(np.sum(x[:-1] * np.diff(y) - y[:-1] * np.diff(x)))
    assert drawn == pytest.approx(1e-6 * area, rel=1e-3)


def test_bins_hold_every_positive_error() -> None:
    edges = logarithmic_bins([np.array([0.0, 2.0, 8.0]), np.array([500.0])])
    assert edges[0] <= 2.0
    assert edges[-1] == pytest.approx(500.0)
    assert np.all(np.diff(logarithmic_bins([np.zeros(3)])) > 0)


def test_comparison_takes_nominal_and_ampi_if_both_were_flown(
    campaigns: dict[str, Flights],
) -> None:
    assert list(compared(campaigns)) == ["nominal", "ampi"]
    assert list(compared({"mpi": campaigns["mpi"]})) == ["mpi"]


def test_every_mode_has_its_own_look() -> None:
    assert set(MODE_STYLES) == set(Mode)
    assert len({look.colour for look in MODE_STYLES.values()}) == len(Mode)
    assert len({look.marker for look in MODE_STYLES.values()}) == len(Mode)


@pytest.mark.parametrize("image_format", list(ImageFormat))
def test_same_figure_same_bytes_and_settings_untouched(image_format: ImageFormat) -> None:
    before = dict(matplotlib.rcParams)
    assert image_bytes(runge_phenomenon(), image_format) == image_bytes(
        runge_phenomenon(), image_format
    )
    assert dict(matplotlib.rcParams) == before


@house_style
def small_figure() -> Figure:
    figure = new_figure(2.0, 2.0)
    figure.subplots().plot([0.0, 1.0], [0.0, 1.0])
    return figure


def test_a_figure_is_matplotlibs_and_ours_alone(tmp_path: Path) -> None:
    own = image_bytes(small_figure())
    with matplotlib.rc_context(
        {"font.size": 30.0, "lines.linewidth": 9.0, "savefig.bbox": "tight"}
    ):
        assert image_bytes(small_figure()) == own
    for suffix in ("png", "svg", "pdf"):
        path = tmp_path / f"figure.{suffix}"
        save_figure(path, small_figure(), "ampi solve")
        first = path.read_bytes()
        check_output(path, made_by="ampi solve")
        save_figure(path, small_figure(), "ampi solve")
        assert path.read_bytes() == first


def test_the_angle_of_attack_follows_its_schedule_and_has_no_limit(
    mission: Mission, table: GuidanceTable, campaigns: dict[str, Flights]
) -> None:
    for figure in (database_controls(mission, table), campaign_controls(mission, campaigns)):
        panels = [a for a in figure.axes if a.get_ylabel().startswith("Angle of attack")]
        assert panels
        for axes in panels:
            assert not [line for line in axes.lines if line.get_color() == LIMIT_COLOUR]


def test_limits_lie_inside_their_panels(mission: Mission, campaigns: dict[str, Flights]) -> None:
    for figure in (campaign_controls(mission, campaigns), campaign_constraints(mission, campaigns)):
        for axes in figure.axes:
            low, high = axes.get_ylim()
            for line in axes.lines:
                level = float(np.asarray(line.get_ydata())[0])
                room = 0.02 * (high - low)
                assert low + room < level < high - room


def test_an_optimum_is_drawn_with_its_status_and_its_loads(
    mission: Mission, table: GuidanceTable
) -> None:
    trajectory = nominal_trajectory(mission, table)
    labels = [axes.get_ylabel() for axes in trajectory_figure(mission, trajectory).axes]
    assert {"Dynamic pressure (kPa)", "Heat flux (MW/m²)"} <= set(labels)
    assert "Load factor (g₀ = 9.782 m/s²)" in labels
    missed = replace(trajectory, status=Status.TARGET_MISSED)
    for one, colour in ((trajectory, INK), (missed, LIMIT_COLOUR)):
        title = trajectory_figure(mission, one).texts[0]
        assert one.status.name in title.get_text()
        assert title.get_color() == colour
    dear = mission.model_copy(update={"title": "a $vehicle$ for 5 $ [x] :100:"})
    assert dear.title in trajectory_figure(dear, trajectory).texts[0].get_text()


def test_a_private_mission_has_its_own_circles(
    mission: Mission, campaigns: dict[str, Flights]
) -> None:
    own = mission.target.model_copy(update={"position_tolerance": 2e3, "radii": (1e3, 8e3)})
    private = mission.model_copy(update={"name": "private", "target": own})
    figure = campaign_footprint(private, campaigns)
    drawn = {round(c.radius, 6) for c in figure.axes[0].patches if isinstance(c, Circle)}
    assert drawn == {1.0, 2.0, 8.0}
    assert figure.axes[0].get_title().startswith("Radii of the mission")
    assert campaign_footprint(mission, campaigns).axes[0].get_title().startswith("Circles of Table")
    lines = campaign_histograms(private, campaigns).axes[2].lines
    assert [float(np.asarray(line.get_xdata())[0]) for line in lines] == [1.0, 8.0]


def test_what_a_footprint_cuts_off_it_names(
    mission: Mission, campaigns: dict[str, Flights]
) -> None:
    near = campaign_footprint(mission, campaigns).axes[2]
    half = near.get_xlim()[1]
    beyond = sum(
        int(np.count_nonzero(np.maximum(np.abs(f.across), np.abs(f.along))[f.reached] > 1e3 * half))
        for f in campaigns.values()
    )
    title = near.get_title().splitlines()
    assert title[:2] == ["95 % ellipse of ampi", f"{beyond} end points outside"]
    assert title[2] == "ellipses cut off: nominal, mpi"


def test_no_track_lies_under_the_window(mission: Mission, campaigns: dict[str, Flights]) -> None:
    chart, window = campaign_ground_tracks(mission, campaigns).axes
    assert not chart.child_axes
    assert not chart.get_window_extent().overlaps(window.get_window_extent())


def crossing(mission: Mission, latitude: float) -> TrackBundle:
    """One track over the date line from 170° E to 170° W, kept on one turn."""
    longitude = np.radians(np.linspace(170.0, 190.0, 30))[None]
    return TrackBundle(
        longitude=longitude,
        latitude=np.full_like(longitude, np.radians(latitude)),
        final=np.array([[longitude[0, -1], np.radians(latitude)]]),
        colour="C0",
        marker="o",
    )


def test_a_map_has_no_line_across_the_date_line(mission: Mission) -> None:
    target = mission.target.model_copy(
        update={"longitude": np.radians(-170.0), "latitude": np.radians(60.0)}
    )
    zone = NoFlyZoneSection.model_validate(
        {"longitude_deg": -179.0, "latitude_deg": 61.0, "radius_km": 50.0}
    )
    here = mission.model_copy(update={"target": target, "no_fly_zone": (zone,)})
    figure, chart, window = map_and_window()
    draw_ground_tracks(chart, here, [crossing(here, 60.0)])
    draw_target_window(window, here, [crossing(here, 60.0)])
    edge, star = chart.lines[-2:]
    assert np.asarray(star.get_xdata()) == pytest.approx([190.0])
    x = np.asarray(edge.get_xdata(), dtype=float)
    assert x.mean() == pytest.approx(181.0, abs=0.1)
    assert np.ptp(x) < 3.0
    figure.draw_without_rendering()
    shown = [label.get_text() for label in chart.get_xticklabels()]
    assert "−170" in shown
    assert not [text for text in shown if text and float(text.replace("−", "-")) >= 180.0]


def test_a_track_near_a_pole_is_drawn_in_kilometres(mission: Mission) -> None:
    target = mission.target.model_copy(
        update={"longitude": np.radians(190.0), "latitude": np.radians(88.0)}
    )
    here = mission.model_copy(update={"target": target})
    _, chart, _ = map_and_window()
    draw_ground_tracks(chart, here, [crossing(here, 88.0)])
    assert chart.get_xlabel() == "East of target (km)"
    (track,) = chart.collections[0].get_paths()
    steps = np.hypot(*np.diff(np.asarray(track.vertices), axis=0).T)
    assert np.ptp(steps) < 1e-3 * steps.mean()  # even steps along the parallel stay even
    assert steps.mean() == pytest.approx(
        6378.137 * np.sin(np.radians(2.0)) * np.radians(20 / 29), rel=0.01
    )


def test_coincident_modes_are_drawn_around_each_other(
    mission: Mission, campaigns: dict[str, Flights]
) -> None:
    twins = {"nominal": replace(campaigns["ampi"], mode=Mode.NOMINAL), "ampi": campaigns["ampi"]}
    for axes in campaign_states(mission, twins).axes:
        widths = [float(collection.get_linewidths()[0]) for collection in axes.collections]
        assert widths[0] >= 2.0 * widths[1]
    points = campaign_footprint(mission, twins).axes[0].lines[:2]
    assert points[0].get_markersize() > points[1].get_markersize()
    assert {line.get_fillstyle() for line in points} == {"none"}
    assert len({look.dashes for look in MODE_STYLES.values()}) == len(Mode)


def test_a_hole_is_no_optimum(mission: Mission, table: GuidanceTable) -> None:
    solved = np.ones(table.final_time.shape, dtype=bool)
    solved.flat[[0, solved.size - 1]] = False
    holed, whole = HighDensityDatabase.of(replace(table, solved=solved)), table.final_time.size
    assert len(holed.times) == whole - 2
    every = HighDensityDatabase.of(table)
    np.testing.assert_array_equal(holed.times, every.times[1:-1])
    np.testing.assert_array_equal(holed.times[holed.nominal], every.times[every.nominal])
    figure = database_constraints(mission, replace(table, solved=solved))
    assert f"{whole - 2} optimal trajectories" in {t.get_text() for t in figure.legends[0].texts}
