"""What a value says of itself in a few lines: a title, a sentence, and a table of words.

Degrees and kilometres, and every share and estimate with its 95 % interval. Nothing here draws.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.onboard.reference import Reference
from ampi.onboard.row_layout import RowKind
from ampi.physics.angles import wrapped
from ampi.physics.state import ANGLE_OF_ATTACK
from ampi.report.cells import estimate_cell, number
from ampi.report.quantities import DEGREES, KILO, MEGA
from ampi.report.scheme_groups import reference_words, words
from ampi.report.verdict_tables import requirement
from ampi.simulation.estimates.paired import PairedDifference
from ampi.simulation.estimates.proportions import Fraction
from ampi.simulation.flights import Flights
from ampi.simulation.statistics import Verdict
from ampi.trajectory import Trajectory

Row = tuple[str, str]


@dataclass(frozen=True)
class Sheet:
    """A title, what stands under it, and rows of a name and a value."""

    title: str
    sentence: str
    rows: tuple[Row, ...]
    figure: str  # what the sketch beside it shows, for who cannot see it


@singledispatch
def sheet_of(value: Any) -> Sheet:
    """The sheet of a value of any class that shows itself."""
    raise TypeError(f"value: expected one that shows itself, got {type(value).__name__}")


@sheet_of.register
def _of_mission(mission: Mission) -> Sheet:
    entry, target, limits, vehicle = mission.entry, mission.target, mission.limits, mission.vehicle
    grid = (
        (f"grid: {p.key}", ", ".join(f"{offset:+g}" if offset else "0" for offset in p.offsets))
        for p in mission.parameters
    )
    cases = int(np.prod([len(axis) for axis in mission.grid_axes]))
    rows = (
        ("vehicle", f"{vehicle.mass:g} kg, {vehicle.reference_area:g} m²"),
        ("entry", f"{_place(entry)}; {entry.altitude * KILO:g} km, {entry.speed:.6g} m/s"),
        ("entry path", f"γ {entry.flight_path_angle * DEGREES:.4g}°, ψ {_degrees(entry.azimuth)}"),
        ("target", f"{_place(target)}; {target.altitude * KILO:g} km, {target.speed:.6g} m/s"),
        ("passed", requirement(mission)),
        (
            "limits",
            f"{limits.dynamic_pressure * KILO:g} kPa, {limits.heat_flux * MEGA:g} MW/m², "
            f"{limits.load_factor:g} g₀; bank {limits.bank_angle * DEGREES:g}°, "
            f"{limits.bank_rate * DEGREES:g}°/s{_steered(mission)}",
        ),
        *grid,
        ("cases", f"{cases:,}, on {mission.pseudospectral_mesh.n_nodes} nodes each"),
    )
    return Sheet(
        mission.title,
        f"{mission.name}, SHA-256 {mission.digest[:12]}",
        rows,
        "Map of the entry points of the grid, the target and the zones not to be flown through.",
    )


def _steered(mission: Mission) -> str:
    """The bounds of the angle of attack, where it is a control."""
    control = mission.angle_of_attack
    if control is None:
        return ""
    low, high = min(control.lower) * DEGREES, max(control.upper) * DEGREES
    return f"; angle of attack {low:g}° to {high:g}°, {control.rate * DEGREES:g}°/s"


@sheet_of.register
def _of_trajectory(optimum: Trajectory) -> Sheet:
    statistics, end = optimum.statistics, optimum.states[:, -1]
    rows: list[Row] = [
        ("final time", f"{optimum.final_time:.2f} s"),
        ("end", _end(end)),
        *_angles(optimum.states[ANGLE_OF_ATTACK:]),
        ("cost", f"{optimum.cost:.6g}"),
        ("mesh", f"{optimum.mesh.n_nodes} nodes"),
        ("solve", f"{statistics.iterations} iterations, {statistics.solve_seconds:.2g} s"),
    ]
    flight = statistics.flight
    if flight is not None:
        rows.append(("re-integrated", f"{number(flight.position_error)} m from the nodes at most"))
        rows += [(f"use of {words(limit)}", f"{100 * u:.1f} %") for limit, u in flight.use.items()]
    return Sheet(
        f"Trajectory: {words(optimum.status.name)}",
        optimum.status.sentence,
        tuple(rows),
        "Altitude over speed, and bank angle over time, of the nodes and between them.",
    )


@sheet_of.register
def _of_reference(reference: Reference) -> Sheet:
    clipped = [str(axis) for axis, out in enumerate(reference.clipped) if out]
    rows = (
        ("final time", f"{reference.final_time:.2f} s"),
        ("end", _end(reference.states[:, -1])),
        *_angles(reference.rows[reference.layout.of(RowKind.ANGLE)]),
        ("parameters (SI, rad)", ", ".join(f"{p:.6g}" for p in reference.parameters)),
        ("cell", ", ".join(map(str, reference.cell))),
        ("outside on axis", ", ".join(clipped) or "none"),
        ("points", f"{len(reference.times)} from {reference.nodal.shape[1]} nodes"),
    )
    return Sheet(
        f"Reference: {words(reference.health.name)}",
        reference.health.sentence,
        rows,
        "Altitude over speed, and bank angle over time, of the reference.",
    )


@sheet_of.register
def _of_flights(flights: Flights) -> Sheet:
    miss = np.where(flights.reached, flights.miss, np.inf)
    lost = ((words(reason), hits) for reason, hits in flights.faults.items() if np.any(hits))
    rows = (
        ("passed", _share(flights.passed)),
        ("target speed reached", _share(flights.reached)),
        *((f"within {r * KILO:g} km", _share(miss < r)) for r in flights.radii.tolist()),
        *((f"failed by {reason}", _share(hits)) for reason, hits in lost),
        ("outside the hypercube", _share(flights.clipped)),
        ("draws", f"{flights.pool}, seed {flights.seed}"),
        ("cycle", f"{flights.cycle:g} s, {flights.engine} engine"),
    )
    return Sheet(
        f"{flights.n:,} flights of {flights.mission}",
        f"{words(flights.law)}, {reference_words(flights)}, in the world {flights.world}",
        rows,
        "End points around the target with their 95 percent ellipse, and the share of the flights "
        "within a distance of it.",
    )


@sheet_of.register
def _of_verdict(verdict: Verdict) -> Sheet:
    misses = verdict.misses
    estimates = {
        "median miss": misses.median,
        "95 % miss within": misses.percentile_95,
        "99 % miss within": misses.percentile_99,
        "mean of the worst 5 %": misses.worst_mean,
    }
    failed = ((words(reason), f) for reason, f in verdict.failed_by.items() if f.count)
    rows = (
        ("passed", _fraction(verdict.passed)),
        ("target speed reached", _fraction(verdict.reached)),
        ("limits kept", _fraction(verdict.limits_kept)),
        *((f"within {r * KILO:g} km", _fraction(f)) for r, f in verdict.within.items()),
        *((name, f"{_cell(one, KILO)} km") for name, one in estimates.items()),
        *((f"failed by {reason}", _fraction(f)) for reason, f in failed),
    )
    return Sheet(
        f"Verdict on {verdict.n:,} flights",
        f"{words(verdict.law)}, {verdict.mode}, in the world {verdict.world}; intervals hold 95 %",
        rows,
        "Shares of the flights within each radius, with their intervals.",
    )


@sheet_of.register
def _of_difference(difference: PairedDifference) -> Sheet:
    rows: list[Row] = [("median miss", f"{_cell(difference.median, KILO)} km")]
    for radius, share in difference.within.items():
        told = f"{_cell(share.difference, 100.0)} % points, p {_p(share.p_value)}"
        rows.append((f"within {radius * KILO:g} km", told))
    rows.append(("signed ranks", f"p {_p(difference.p_value)}"))
    return Sheet(
        f"Difference on {difference.n:,} draws",
        "The first campaign less the second, flight by flight; intervals hold 95 %",
        tuple(rows),
        "Differences of the shares within each radius, with their intervals, against none.",
    )


def _angles(rows: NDArray[np.float64]) -> list[Row]:
    """The range of the angle of attack, of a vehicle that steers it."""
    if not len(rows):
        return []
    return [("angle of attack", f"{_degrees(rows.min())} to {_degrees(rows.max())}")]


def _end(state: NDArray[np.float64]) -> str:
    altitude, longitude, latitude, speed = state[:4].tolist()
    return f"{_on_globe(longitude, latitude, '.3f')}; {altitude * KILO:.2f} km, {speed:.1f} m/s"


def _place(section: Any) -> str:
    return _on_globe(section.longitude, section.latitude, ".6g")


def _on_globe(longitude: float, latitude: float, digits: str) -> str:
    """Latitude and longitude (rad) in degrees, by hemispheres."""
    north, east = latitude * DEGREES, wrapped(longitude) * DEGREES
    return (
        f"{abs(north):{digits}}° {'N' if north >= 0.0 else 'S'}, "
        f"{abs(east):{digits}}° {'E' if east >= 0.0 else 'W'}"
    )


def _degrees(angle: float) -> str:
    return f"{angle * DEGREES:.5g}°"


def _share(hits: NDArray[np.bool_]) -> str:
    return _fraction(Fraction.of(hits))


def _fraction(fraction: Fraction) -> str:
    return f"{fraction.count:,}: {fraction}"


def _cell(estimate: Any, per_si: float) -> str:
    cell = estimate_cell(estimate, per_si)
    return f"{cell.value} {cell.interval}".strip()


def _p(value: float) -> str:
    return f"{value:.2g}" if value >= 1e-3 else "< 0.001"
