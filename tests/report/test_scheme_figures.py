"""Figures over all schemes: staircases are the empirical distribution, ellipses hold, bars are ρ."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_hex

from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.physics.planet import great_circle_distance
from ampi.report.correlations import correlations
from ampi.report.figures.end_map import end_map, place_of, shown
from ampi.report.figures.misses import FARTHEST, NEAREST, distribution, miss_distributions
from ampi.report.figures.sensitivity import PALE, explained, sensitivity
from ampi.report.figures.style import MODE_STYLES, image_bytes
from ampi.report.figures.world_panels import columns_of, is_leftmost, is_lowest, world_panels
from ampi.simulation.estimates.ellipses import containing_ellipse, covariance_ellipse
from ampi.simulation.flights import Flights
from tests.report.conftest import TRACK

ABROAD = "linear_quadratic abroad, ampi"


# --- misses ---------------------------------------------------------------------------------------


def test_a_curve_is_the_share_of_flights_within_a_distance(many: dict[str, Flights]) -> None:
    flights = many[ABROAD]
    distance, share = distribution(flights)
    assert (distance[0], distance[-1]) == (NEAREST, FARTHEST)
    assert np.all(np.diff(distance) >= 0.0)
    for radius in (50.0, 1e3, 5e3, 25e3, 9e5):
        expected = np.mean(flights.reached & (flights.miss <= radius))
        at = share[np.searchsorted(distance, radius, side="right") - 1]
        assert at == pytest.approx(expected)
    assert share[-1] == np.mean(flights.reached) < 1.0


def test_flights_beyond_either_end_are_counted_where_they_belong(
    many: dict[str, Flights],
) -> None:
    miss = np.geomspace(1.0, 1e8, 60)
    _, share = distribution(replace(many[ABROAD], miss=miss))
    lost = 3  # the nearest ones
    assert share[0] == pytest.approx((np.sum(miss <= NEAREST) - lost) / 60)
    assert share[-1] == pytest.approx((np.sum(miss <= FARTHEST) - lost) / 60)
    nothing = replace(many[ABROAD], status=np.ones(60, dtype=np.int64))
    assert [a.tolist() for a in distribution(nothing)] == [[NEAREST, FARTHEST], [0.0, 0.0]]


def test_one_panel_per_world_and_one_curve_per_campaign(
    mission: Mission, many: dict[str, Flights]
) -> None:
    figure = miss_distributions(many)
    assert [axes.get_title() for axes in figure.axes] == ["everything", "entry"]
    for axes in figure.axes:
        assert axes.get_xscale() == "log"
        assert axes.get_xlim() == (0.01, 1000.0)
        curves = [line for line in axes.lines if len(line.get_xdata()) > 2]
        looks = {(to_hex(c.get_color()), c.get_linestyle()) for c in curves}
        assert len(curves) == len(looks) == 4
        assert {colour for colour, _ in looks} == {
            MODE_STYLES[mode].colour.lower() for mode in (Mode.NOMINAL, Mode.AMPI)
        }
        assert all(curve.get_ydata()[-1] == pytest.approx(95.0) for curve in curves)
    told = [text.get_text() for text in figure.legends[0].get_texts()]
    assert told == ["nominal", "ampi", "linear quadratic", "drag sliding mode", "1, 5, 25 km"]
    assert figure.axes[0].get_ylabel() == "Flights within it (%)"
    assert figure.axes[1].get_xlabel() == "Distance from the target (km)"
    assert image_bytes(figure).startswith(b"\x89PNG")


@pytest.mark.parametrize(("number", "columns"), [(1, 1), (2, 2), (3, 3), (4, 2), (5, 3), (7, 3)])
def test_panels_fill_their_rows(number: int, columns: int) -> None:
    assert columns_of(number) == columns
    _, panels = world_panels([f"w{i}" for i in range(number)], 2.0)
    below = [is_lowest(panels, i) for i in range(number)]
    assert sum(below) == columns
    assert sum(is_leftmost(panels, i) for i in range(number)) == -(-number // columns)


# --- sensitivity ----------------------------------------------------------------------------------


def test_ampis_flights_in_wrong_worlds_are_explained(
    many: dict[str, Flights], campaigns: dict[str, Flights]
) -> None:
    assert explained(many) == {"everything": many[ABROAD]}
    assert explained(campaigns) == {"entry": campaigns["ampi"]}
    assert explained({"n": campaigns["nominal"]}) == {"entry": campaigns["nominal"]}


def test_bars_are_the_correlations_with_their_intervals(
    mission: Mission, many: dict[str, Flights]
) -> None:
    figure = sensitivity(mission, many)
    found = correlations(mission, many[ABROAD])
    for axes, output in zip(figure.axes, ("miss", "along"), strict=True):
        estimates = [getattr(one, output) for one in found.values()]
        bars = [bar.get_width() for bar in axes.patches]
        assert bars == pytest.approx([estimate.value for estimate in estimates])
        intervals = [list(line.get_xdata()) for line in axes.lines[: len(found)]]
        assert intervals == [[pytest.approx(e.low), pytest.approx(e.high)] for e in estimates]
        pale = [to_hex(bar.get_facecolor()) == PALE.lower() for bar in axes.patches]
        assert pale == [e.low <= 0.0 <= e.high for e in estimates]
        assert axes.get_xlim() == (-1.0, 1.0)
        assert axes.get_xlabel().endswith("(–)")
    names = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert names == list(found)
    assert names[0] == "lift factor"
    assert figure.axes[0].get_title(loc="left").startswith("everything: linear quadratic, ampi")
    assert image_bytes(figure).startswith(b"\x89PNG")


def test_what_nobody_knows_is_said_to_be_unknown(
    mission: Mission, many: dict[str, Flights]
) -> None:
    lost = replace(many[ABROAD], status=np.ones(60, dtype=np.int64))
    for axes in sensitivity(mission, {"lost": lost}).axes:
        assert [text.get_text() for text in axes.texts] == ["unknown"]


# --- map ------------------------------------------------------------------------------------------


def test_the_track_over_the_target_is_found_in_the_misses(
    mission: Mission, many: dict[str, Flights], campaigns: dict[str, Flights]
) -> None:
    for flights in campaigns.values():
        azimuth = place_of(mission, flights).azimuth
        assert np.cos(azimuth - TRACK) == pytest.approx(1.0, abs=1e-9)


def test_a_map_shows_end_points_where_they_are(
    mission: Mission, campaigns: dict[str, Flights]
) -> None:
    """Every flight that arrived lies in the window or is counted outside."""
    figure = end_map(mission, campaigns)
    (axes,) = figure.axes
    target = mission.target
    own = [line for line in axes.lines if line.get_marker() in "so" and len(line.get_xdata()) > 2]
    drawn = 0
    for line, name in zip(own, ("nominal", "ampi"), strict=True):
        flights = campaigns[name]
        longitude, latitude = np.radians(line.get_xydata()).T
        radius = mission.flight_model.planet.equatorial_radius
        away = great_circle_distance(target.longitude, target.latitude, longitude, latitude, radius)
        known = np.sort(flights.miss[flights.reached])
        assert np.sort(away) == pytest.approx(known[: len(away)], rel=1e-6)
        drawn += len(away)
        ends = np.degrees(flights.final_states[flights.reached, 1:3])
        gaps = np.abs(line.get_xydata()[:, None] - ends[None]).max(axis=2).min(axis=1)
        assert np.max(gaps) < 1e-6
    outside = 2 * 60 - drawn
    assert axes.get_title() == f"entry\n{outside} flights outside"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("Longitude (deg)", "Latitude (deg)")
    assert axes.get_aspect() == pytest.approx(1.0 / np.cos(target.latitude))
    assert image_bytes(figure).startswith(b"\x89PNG")


def test_a_map_has_both_ellipses_of_each_scheme(
    mission: Mission, campaigns: dict[str, Flights]
) -> None:
    (axes,) = end_map(mission, campaigns).axes
    for name in ("nominal", "ampi"):
        flights = campaigns[name]
        ends = np.where(flights.reached, (flights.across, flights.along), np.nan)
        colour, place = MODE_STYLES[flights.mode].colour.lower(), place_of(mission, flights)
        edges = [
            line.get_xydata()
            for line in axes.lines
            if line.get_marker() == "None" and to_hex(line.get_color()) == colour
        ]
        expected = [find(*ends) for find in (covariance_ellipse, containing_ellipse)]
        for edge, ellipse in zip(edges, expected, strict=True):
            assert ellipse is not None
            assert pytest.approx(np.degrees(ellipse.on_map(place)), abs=1e-6) == edge.T


def test_circles_have_the_missions_radii_along_great_circles(
    mission: Mission, campaigns: dict[str, Flights]
) -> None:
    (axes,) = end_map(mission, campaigns).axes
    target, radius = mission.target, mission.flight_model.planet.equatorial_radius
    circles = [line for line in axes.lines if to_hex(line.get_color()) == "#888888"]
    found = []
    for line in circles:
        longitude, latitude = np.radians(line.get_xydata()).T
        away = great_circle_distance(target.longitude, target.latitude, longitude, latitude, radius)
        assert np.ptp(away) < 1e-3
        found.append(float(away.mean()))
    assert found == pytest.approx(target.judged_radii, rel=1e-6)


def test_each_world_has_nominal_tracking_and_ampi_of_the_first_law(
    mission: Mission, many: dict[str, Flights]
) -> None:
    worlds = shown(many)
    assert list(worlds) == ["everything", "entry"]
    for flown in worlds.values():
        assert [f.mode for f in flown.values()] == [Mode.NOMINAL, Mode.AMPI]
        assert {f.law for f in flown.values()} == {"linear_quadratic"}
    figure = end_map(mission, many)
    figure.draw_without_rendering()
    first, second = figure.axes
    assert not first.get_window_extent().overlaps(second.get_window_extent())


def test_a_map_near_a_pole_is_in_kilometres(
    mission: Mission, campaigns: dict[str, Flights]
) -> None:
    target = mission.target.model_copy(update={"latitude": np.radians(88.0)})
    there = mission.model_copy(update={"target": target})
    (axes,) = end_map(there, {"ampi": campaigns["ampi"]}).axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("East of target (km)", "North of target (km)")


def test_a_world_in_which_nothing_arrives_has_a_map(
    mission: Mission, campaigns: dict[str, Flights]
) -> None:
    nothing = np.full(60, np.nan)
    lost = replace(
        campaigns["ampi"],
        status=np.ones(60, dtype=np.int64),
        miss=nothing,
        along=nothing,
        across=nothing,
    )
    figure = end_map(mission, {"lost": lost})
    assert figure.axes[0].get_title() == "entry\n60 flights outside"
    assert image_bytes(figure).startswith(b"\x89PNG")
