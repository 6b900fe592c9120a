"""From a mission to what judges its references on board: its physics, parameters and limits as numbers.

What a form on board cannot express is refused here, on the ground.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ampi.correction.onboard_correction import NO_AXIS, Correction
from ampi.correction.settings import CorrectorSettings
from ampi.estimation.settings import EstimatorSettings
from ampi.missions.mission import Mission
from ampi.missions.parameters import at
from ampi.missions.path_limits import PathLimits
from ampi.onboard.aerodynamic_forms import AerodynamicForm, NewtonianForm, PolarForm, SplineForm
from ampi.onboard.certificate import Certifier, Thresholds
from ampi.onboard.flight_model import Air, AltitudeCurve, FlightModelData, Limits, Schedule
from ampi.onboard.flight_numbers import TARGET, UNMOVED, VARIED, FlightNumbers
from ampi.onboard.segments import Segments
from ampi.physics.aerodynamics import (
    Aerodynamics,
    ModifiedNewtonian,
    PolynomialDragPolar,
    TabulatedAerodynamics,
)
from ampi.physics.atmosphere import (
    AIR_GAS_CONSTANT,
    SPECIFIC_HEAT_RATIO,
    Atmosphere,
    ExponentialAtmosphere,
    SmoothTable,
    StandardAtmosphere1976,
    TableAtmosphere,
)
from ampi.physics.vehicle import AngleOfAttackSchedule

Array = NDArray[np.float64]

LINE_TOP = 1e5  # m: an exponential atmosphere is one straight line, within and beyond any top
# what no flight of a reference depends on, beside the objective
NOT_FLOWN = (
    ("limits", "bank_acceleration"),
    ("limits", "bank_angle_minimum"),
    *(("limits", f"angle_of_attack_{part}") for part in ("change", "rate")),
    *(("target", name) for name in ("flight_path_angle", "azimuth")),
    *(("target", f"{name}_tolerance") for name in ("altitude", "speed", "position")),
)


def flight_model_of(mission: Mission) -> FlightModelData:
    """The flight model of a mission as data.

    Raises
    ------
    ValueError
        If its air or its aerodynamics have no form on board, or wind blows.
    """
    model, limits = mission.flight_model, PathLimits.of(mission)
    planet, vehicle = model.planet, model.vehicle
    if model.wind is not None or model.angle_of_attack_offset is not None:
        raise ValueError("mission: expected still air and the scheduled angle of attack on board")
    if vehicle.angle_of_attack is None:
        raise ValueError(
            "mission: expected a schedule of the angle of attack on board, got a control"
        )
    q, heat_flux, load = limits.loads
    return FlightModelData(
        equatorial_radius=planet.equatorial_radius,
        gravitational_parameter=planet.gravitational_parameter,
        j2=planet.j2,
        rotation_rate=planet.rotation_rate,
        load_factor_gravity=planet.load_factor_gravity,
        air=_air(model.atmosphere),
        aerodynamics=_aerodynamics(vehicle.aerodynamics),
        angle_of_attack=_schedule(vehicle.angle_of_attack),
        lift_factor=vehicle.lift_factor,
        drag_factor=vehicle.drag_factor,
        mass=vehicle.mass,
        reference_area=vehicle.reference_area,
        heat_flux_constant=vehicle.heat_flux_constant,
        heat_flux_speed_exponent=vehicle.heat_flux_speed_exponent,
        load_factor_is_total=vehicle.load_factor == "total",
        limits=Limits(
            dynamic_pressure=q,
            heat_flux=heat_flux,
            load_factor=load,
            bank_angle=limits.bank_angle,
            bank_rate=limits.bank_rate,
            drag_floor=limits.drag_floor,
            no_fly_zones=limits.no_fly_zones,
        ),
    )


def _air(atmosphere: Atmosphere) -> Air:
    match atmosphere:
        case StandardAtmosphere1976():
            squared = SPECIFIC_HEAT_RATIO * AIR_GAS_CONSTANT  # c² = κ R T
            return Air(
                _curve(atmosphere.log_density, plus=np.log(atmosphere.density_factor)),
                _curve(atmosphere.temperature, times=squared),
                sound_is_squared=True,
            )
        case TableAtmosphere():
            return Air(
                _curve(atmosphere.log_density, plus=np.log(atmosphere.density_factor)),
                _curve(atmosphere.log_speed_of_sound),
                sound_is_squared=False,
            )
        case ExponentialAtmosphere():
            surface = np.log(atmosphere.density_factor * atmosphere.surface_density)
            sound = float(np.log(atmosphere.speed_of_sound(0.0)))
            slope = -1.0 / atmosphere.scale_height
            return Air(_line(surface, slope), _line(sound, 0.0), sound_is_squared=False)
    raise ValueError(
        "atmosphere: expected us76, exponential or table, which have a form on board, got "
        f"{type(atmosphere).__name__}"
    )


def _curve(table: SmoothTable, *, times: float = 1.0, plus: float = 0.0) -> AltitudeCurve:
    """`table` · times + plus."""
    terms = np.zeros((max(len(table.even), len(table.odd)), 2))
    terms[: len(table.even), 0], terms[: len(table.odd), 1] = table.even, table.odd
    terms *= times
    terms[0, 0] += plus
    below, above = table.edge_slopes
    return AltitudeCurve(table.top, terms, (times * below, times * above))


def _line(surface: float, slope: float) -> AltitudeCurve:
    """surface + slope · h."""
    half = 0.5 * slope * LINE_TOP
    return AltitudeCurve(LINE_TOP, np.array([[surface + half, half]]), (slope, slope))


def _aerodynamics(aerodynamics: Aerodynamics) -> AerodynamicForm:
    match aerodynamics:
        case ModifiedNewtonian(normal_quadratic=a, normal_linear=b, axial=axial):
            return NewtonianForm(normal_quadratic=a, normal_linear=b, axial=axial)
        case PolynomialDragPolar(lift=lift, drag=drag):
            return PolarForm(lift=np.array(lift), drag=np.array(drag))
        case TabulatedAerodynamics():
            knots, machs, *tables = (np.array(w) for w in aerodynamics.weights)
            return SplineForm(angle_of_attack=knots, mach=machs, lift=tables[0], drag=tables[1])
    raise ValueError(
        "vehicle.aerodynamics: expected modified_newtonian, polynomial or table, which have a form on "
        f"board, got {type(aerodynamics).__name__}"
    )


def _schedule(schedule: AngleOfAttackSchedule) -> Schedule:
    return Schedule(
        over_time=schedule.variable == "time",
        start=schedule.start,
        end=schedule.end,
        start_angle=schedule.start_angle,
        end_angle=schedule.end_angle,
        is_parabola=schedule.shape == "parabola",
        smoothing=schedule.smoothing / (schedule.end - schedule.start),
    )


def flight_numbers_of(mission: Mission) -> FlightNumbers:
    """Which numbers of a flight the parameters of the mission's grid are.

    Raises
    ------
    ValueError
        If a parameter moves what the model on board holds fixed.
    """
    places = []
    for parameter in mission.parameters:
        path = parameter.number.path
        if path in VARIED:
            places.append(VARIED.index(path))
        elif path[0] == "objective" or path in NOT_FLOWN:
            places.append(UNMOVED)
        else:
            raise ValueError(
                f"grid.{parameter.key}: expected a number of the entry, the target or the limits, the "
                "mass, or a factor of density, lift or drag, which alone may differ from flight to "
                f"flight on board, got {parameter.name}"
            )
    nominal = np.array([at(mission, path) for path in VARIED], dtype=float)
    return FlightNumbers(nominal, tuple(places), flight_model_of(mission).limits)


def certifier_of(mission: Mission, segments: Segments) -> Certifier:
    """What certifies the references of a table of the mission, with the segments of the table.

    A reference is rejected beyond the mission's tolerances of position and altitude.

    Raises
    ------
    ValueError
        If the model on board cannot express the mission, or one of its parameters.
    """
    target = mission.target
    return Certifier.of(
        flight_model_of(mission),
        flight_numbers_of(mission),
        Thresholds(horizontal=target.position_tolerance, altitude=target.altitude_tolerance),
        segments,
        position_is_free=target.position == "free",
    )


def correction_of(
    mission: Mission,
    *,
    angle_of_attack: bool = True,
    corrector: CorrectorSettings | None = None,
    estimator: EstimatorSettings | None = None,
) -> Correction:
    """What corrects plans of the mission in flight, by bank and, where it may be changed, by α.

    `change` and `change_rate` of the corrector's settings are the mission's; with `angle_of_attack`
    false it is corrected by bank alone.

    Raises
    ------
    ValueError
        If the model on board cannot express the mission, or its target's position is free.
    """
    target, limits = mission.target, mission.limits
    if target.position == "free":
        raise ValueError(
            "target.position: expected fixed, there is nothing to correct towards, got free"
        )
    change = limits.angle_of_attack_change if angle_of_attack else None
    own = replace(
        corrector or CorrectorSettings(),
        change=change or 0.0,
        change_rate=limits.angle_of_attack_rate or 0.0,
    )
    paths = [parameter.number.path for parameter in mission.parameters]
    axes = tuple(
        paths.index(("target", name)) if ("target", name) in paths else NO_AXIS for name in TARGET
    )
    return Correction(
        model=flight_model_of(mission),
        target=(target.altitude, target.longitude, target.latitude, target.speed),
        target_axes=axes,
        estimator=estimator or EstimatorSettings(),
        corrector=own,
    )
