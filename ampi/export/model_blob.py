"""Model, target and settings of a correction as the C flies them: one blob that checks itself.

    header   32 bytes: magic, byte-order mark, format, bytes of the body, CRC-32 of the body (zlib's),
             eight zeros
    body     float64, `ampi_model_data` of ampi_correction.h field by field: counts and switches too

All is little-endian; arrays are padded with zeros to the sizes of the C.
"""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from ampi.correction.onboard_correction import Correction
from ampi.correction.settings import CorrectorSettings
from ampi.estimation.settings import EstimatorSettings
from ampi.onboard.aerodynamic_forms import AerodynamicForm, NewtonianForm, PolarForm, SplineForm
from ampi.onboard.flight_model import AltitudeCurve, FlightModelData, Schedule

Array = NDArray[np.float64]

MAGIC = b"\x89AMPC\r\n\x1a"
BYTE_ORDER_MARK, FORMAT = 0x01020304, 1
TERMS, KNOTS = 16, 16  # AMPI_MAX_TERMS, AMPI_MAX_KNOTS
NEWTONIAN, POLAR, SPLINE = 0.0, 1.0, 2.0


def model_blob(correction: Correction) -> bytes:
    """What `ampi_model_open` opens.

    Raises
    ------
    ValueError
        If a curve or a table of the model is larger than the C has room for.
    """
    model = correction.model
    body = np.concatenate(
        [
            _planet_and_vehicle(model),
            _schedule(model.angle_of_attack),
            [*correction.target, *correction.target_axes],
            _aerodynamics(model.aerodynamics),
            _curve("density", model.air.log_density),
            _curve("speed of sound", model.air.sound),
            [float(model.air.sound_is_squared)],
            _estimator(correction.estimator),
            _corrector(correction.corrector, model),
        ]
    )
    content = body.astype("<f8").tobytes()
    head = struct.pack("<4I8x", BYTE_ORDER_MARK, FORMAT, len(content), zlib.crc32(content))
    return MAGIC + head + content


def _planet_and_vehicle(model: FlightModelData) -> list[float]:
    limits = model.limits
    return [
        model.equatorial_radius,
        model.gravitational_parameter,
        model.j2,
        model.rotation_rate,
        model.load_factor_gravity,
        model.reference_area / model.mass,
        model.lift_factor,
        model.drag_factor,
        model.heat_flux_constant,
        model.heat_flux_speed_exponent,
        float(model.load_factor_is_total),
        float(limits.dynamic_pressure),
        float(limits.heat_flux),
        float(limits.load_factor),
    ]


def _schedule(schedule: Schedule) -> list[float]:
    return [
        float(schedule.over_time),
        schedule.start,
        schedule.end,
        schedule.start_angle,
        schedule.end_angle,
        float(schedule.is_parabola),
        schedule.smoothing,
    ]


def _aerodynamics(form: AerodynamicForm) -> Array:
    attack, mach = np.zeros(KNOTS), np.zeros(KNOTS)
    tables = np.zeros((2, KNOTS, KNOTS))
    match form:
        case NewtonianForm():
            kind, counts = NEWTONIAN, (0, 0)
            attack[:3] = form.normal_quadratic, form.normal_linear, form.axial
        case PolarForm():
            kind, counts = POLAR, (_room("lift", form.lift), _room("drag", form.drag))
            attack[: counts[0]], mach[: counts[1]] = form.lift, form.drag
        case SplineForm():
            rows, columns = _room("angles", form.angle_of_attack), _room("Mach", form.mach)
            kind, counts = SPLINE, (rows, columns)
            attack[:rows], mach[:columns] = form.angle_of_attack, form.mach
            tables[0, :rows, :columns], tables[1, :rows, :columns] = form.lift, form.drag
    return np.concatenate([[kind, *counts], attack, mach, tables.ravel()])


def _room(name: str, values: Array, most: int = KNOTS) -> int:
    if len(values) > most:
        raise ValueError(f"{name}: expected at most {most} numbers, got {len(values)}")
    return len(values)


def _curve(name: str, curve: AltitudeCurve) -> Array:
    count, terms = _room(name, curve.terms, TERMS), np.zeros((TERMS, 2))
    terms[:count] = curve.terms
    return np.concatenate([[curve.top, *curve.edge_slopes, count], terms.T.ravel()])


def _estimator(own: EstimatorSettings) -> list[float]:
    return [
        *own.prior,
        *own.walk,
        own.length,
        own.wind_length,
        own.altitude,
        own.scale_height,
        own.speed,
        own.angle,
        own.relative,
        own.floor,
        own.weakest,
        own.gate,
        own.patience,
    ]


def _corrector(own: CorrectorSettings, model: FlightModelData) -> list[float]:
    return [
        own.start,
        own.period,
        own.last_minute,
        own.last_period,
        own.quiet,
        float(model.limits.bank_angle),
        own.change,
        own.change_rate,
        own.lead,
        own.stiffness,
        own.lag,
        own.step,
        own.tolerance,
        own.reach,
        *(own.position_weight,) * 2,
        own.altitude_weight,
        *(own.limit_weight,) * 3,
        own.margin,
        own.roughness,
        own.size,
        own.change_size,
        own.plan_roughness,
        own.plan_change,
        own.longest_step,
        own.iterations,
        own.propagations,
        own.longest,
    ]
