"""The figures of the report in order, each with title, caption and words for who cannot see it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from ampi.missions.mission import Mission
from ampi.onboard.table import GuidanceTable
from ampi.report.figures import campaign as over_time
from ampi.report.figures import database
from ampi.report.figures import footprint as at_the_end
from ampi.report.figures.runge import runge_phenomenon
from ampi.report.figures.style import ImageFormat
from ampi.report.scheme_groups import like_the_paper, scheme_groups, words
from ampi.simulation.flights import Flights


@dataclass(frozen=True)
class Exhibit:
    """A figure yet to be drawn, and what is said about it."""

    name: str  # anchor in the page
    title: str
    caption: str
    alternative: str  # the alt text
    draw: Callable[[], Figure]
    after: str = ""  # the figure of the paper that shows the same
    image_format: ImageFormat = ImageFormat.PNG


def database_exhibits(mission: Mission, table: GuidanceTable) -> tuple[Exhibit, ...]:
    """The trajectory database, Figs. 4–7, and the reason for its nodes, Figs. 9 and 10."""
    cases = int(np.count_nonzero(database.with_optimum(table)))
    shortest, longest = float(table.final_time.min()), float(table.final_time.max())
    return (
        Exhibit(
            "database-states",
            "Database: states",
            "Every optimum over time, the nominal one thick.",
            f"Six panels over time: altitude, longitude, latitude, speed, flight-path angle and "
            f"azimuth of {cases} optimal trajectories that last {shortest:.0f} to {longest:.0f} "
            "seconds, with the nominal one highlighted.",
            lambda: database.database_states(mission, table),
            "Fig. 4",
        ),
        Exhibit(
            "database-controls",
            "Database: controls",
            "Angle of attack follows its schedule, bank angle and rate are optimised.",
            f"Three panels over time: angle of attack, bank angle and bank rate of {cases} optimal "
            "trajectories between dashed limits.",
            lambda: database.database_controls(mission, table),
            "Fig. 5",
        ),
        Exhibit(
            "database-tracks",
            "Database: ground tracks",
            "From the entry points of the grid to the target; the window shows the last metres.",
            f"Map in longitude and latitude: {cases} ground tracks fan out from a grid of entry "
            "points and meet at the target; a window in kilometres shows where they end.",
            lambda: database.database_ground_tracks(mission, table),
            "Fig. 6",
        ),
        Exhibit(
            "database-constraints",
            "Database: path constraints",
            f"The loads on the path with their limits; {_unit_of_loads(mission)}.",
            "Panels over time: dynamic pressure, heat flux, load factor and what else is limited of "
            f"{cases} optimal trajectories against their dashed limits.",
            lambda: database.database_constraints(mission, table),
            "Fig. 7",
        ),
        Exhibit(
            "runge",
            "Why flipped Radau nodes",
            "Interpolants of 1/(1 + 25 τ²). Uniform nodes diverge towards the ends as their number "
            "grows, Radau nodes converge.",
            "Four panels: Runge's function interpolated through 11 and 25 nodes; through uniform "
            "nodes the interpolant swings out at both ends, through Radau nodes it does not.",
            runge_phenomenon,
            "Figs. 9 and 10",
            ImageFormat.SVG,
        ),
    )


def campaign_exhibits(mission: Mission, campaigns: Mapping[str, Flights]) -> tuple[Exhibit, ...]:
    """Figs. 11–19, of one law in one world: flights of several hide each other."""
    groups = scheme_groups(campaigns)
    group = like_the_paper(groups)
    exhibits = flight_exhibits(mission, group.campaigns)
    if len(groups) == 1:
        return exhibits
    of = f"World {group.world}, {words(group.law)} law."
    return tuple(replace(exhibit, caption=f"{exhibit.caption} {of}") for exhibit in exhibits)


def flight_exhibits(mission: Mission, campaigns: Mapping[str, Flights]) -> tuple[Exhibit, ...]:
    """Of campaigns that are drawn in the same panels."""
    pair = " and ".join(over_time.compared(campaigns))
    return (
        Exhibit(
            "campaign-states",
            "Flights: states",
            f"{pair}, closed loop; dotted: the target.",
            f"Six panels over time with the states of every flight of {pair}.",
            lambda: over_time.campaign_states(mission, campaigns),
            "Fig. 11",
        ),
        Exhibit(
            "campaign-errors",
            "Flights: tracking errors",
            "Flown state minus reference: what is left for feedback to remove.",
            f"Six panels over time with the difference between flown and reference states for "
            f"every flight of {pair}.",
            lambda: over_time.campaign_tracking_errors(mission, campaigns),
            "Fig. 12",
        ),
        Exhibit(
            "campaign-controls",
            "Flights: controls",
            "Angle of attack, bank angle and bank rate as flown, one column per mode.",
            f"One column each for {pair}: angle of attack, bank angle and bank rate over time "
            "between dashed limits.",
            lambda: over_time.campaign_controls(mission, campaigns),
            "Fig. 13",
        ),
        Exhibit(
            "campaign-tracks",
            "Flights: ground tracks",
            f"The window holds {over_time.WINDOW_PERCENTILE:g} % of the end points.",
            f"Map in longitude and latitude with the ground tracks of {pair} from the dispersed "
            "entry points to the target; a window in kilometres shows where they end.",
            lambda: over_time.campaign_ground_tracks(mission, campaigns),
            "Fig. 14",
        ),
        *_end_exhibits(mission, campaigns),
        Exhibit(
            "campaign-constraints",
            "Flights: path constraints",
            f"The loads on the path as flown, with their limits; {_unit_of_loads(mission)}.",
            "Panels over time: dynamic pressure, heat flux, load factor and what else is limited of "
            f"every flight of {pair} against their dashed limits.",
            lambda: over_time.campaign_constraints(mission, campaigns),
            "Fig. 19",
        ),
    )


def _unit_of_loads(mission: Mission) -> str:
    return f"g₀ = {mission.flight_model.planet.load_factor_gravity:.4g} m/s²"


def _end_exhibits(mission: Mission, campaigns: Mapping[str, Flights]) -> tuple[Exhibit, ...]:
    """Where the flights end, Figs. 15–18."""
    every = ", ".join(over_time.back_to_front(campaigns))
    return (
        Exhibit(
            "footprint",
            "Footprint",
            "End points across and along the nominal ground track, at several scales.",
            f"Scatter plots of end points around the target for {every}: with circles of the radii "
            "that are judged, with the 95 percent ellipses, and closer still.",
            lambda: at_the_end.campaign_footprint(mission, campaigns),
            "Fig. 15",
        ),
        Exhibit(
            "histograms",
            "Final errors",
            "On logarithmic axes: the modes lie decades apart.",
            f"Three histograms for {every}: final altitude error, final speed error, and range to "
            "go with the radii that are judged.",
            lambda: at_the_end.campaign_histograms(mission, campaigns),
            "Figs. 16 to 18",
        ),
    )
