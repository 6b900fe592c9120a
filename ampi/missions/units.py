"""Units in mission files: a number with a dimension carries its unit in its key.

`altitude_km = 100.1` fills the field `altitude` with 100,100 m. A key without a unit, or with a
unit of another dimension, is an error that lists the units that would do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic.fields import FieldInfo

DEGREE = float(np.pi / 180.0)

UNITS: dict[str, dict[str, float]] = {
    "length": {"m": 1.0, "km": 1e3},
    "angle": {"rad": 1.0, "deg": DEGREE},
    "speed": {"m_per_s": 1.0, "km_per_s": 1e3},
    "time": {"s": 1.0},
    "mass": {"kg": 1.0},
    "area": {"m2": 1.0},
    "angular rate": {"rad_per_s": 1.0, "deg_per_s": DEGREE},
    "angular acceleration": {"rad_per_s2": 1.0, "deg_per_s2": DEGREE},
    "pressure": {"Pa": 1.0, "kPa": 1e3},
    "heat flux": {"W_per_m2": 1.0, "kW_per_m2": 1e3, "MW_per_m2": 1e6},
    "load factor": {"g": 1.0},
    "inverse angle squared": {"per_rad2": 1.0, "per_deg2": DEGREE**-2},
    "inverse length squared": {"per_m2": 1.0, "per_km2": 1e-6},
    "inverse speed squared": {"per_m2_s2": 1.0},
}


@dataclass(frozen=True)
class Dimension:
    """Marks a field as a physical quantity; one number may stand for a range [least, greatest].

    A circular angle is the same modulo a turn: longitude, azimuth, bank angle; latitude is not.
    """

    name: str
    is_range: bool = False
    is_circular: bool = False


Length = Annotated[float, Dimension("length")]
Angle = Annotated[float, Dimension("angle")]
CircularAngle = Annotated[float, Dimension("angle", is_circular=True)]
Speed = Annotated[float, Dimension("speed")]
Time = Annotated[float, Dimension("time")]
Mass = Annotated[float, Dimension("mass")]
Area = Annotated[float, Dimension("area")]
AngularRate = Annotated[float, Dimension("angular rate")]
AngularAcceleration = Annotated[float, Dimension("angular acceleration")]
Pressure = Annotated[float, Dimension("pressure")]
HeatFlux = Annotated[float, Dimension("heat flux")]
LoadFactor = Annotated[float, Dimension("load factor")]
PerAngleSquared = Annotated[float, Dimension("inverse angle squared")]
PerLengthSquared = Annotated[float, Dimension("inverse length squared")]
PerSpeedSquared = Annotated[float, Dimension("inverse speed squared")]
AngleRange = Annotated[tuple[float, float], Dimension("angle", is_range=True)]
CircularRange = Annotated[tuple[float, float], Dimension("angle", is_range=True, is_circular=True)]
Lengths = Annotated[tuple[float, ...], Dimension("length")]


Number = Annotated[float, Field(strict=True)]


def _convert(key: str, value: Any, factor: float) -> Any:
    if isinstance(value, (list, tuple)):
        return [_convert(key, item, factor) for item in value]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError(f"{key}: expected a number, got {value!r}")
    try:
        return float(value) * factor
    except OverflowError:
        raise ValueError(f"{key}: expected a number that fits a float") from None


def si_key(dimension: str) -> str:
    """The SI unit of a dimension as it stands in keys: m_per_s, W_per_m2."""
    return next(unit for unit, factor in UNITS[dimension].items() if factor == 1.0)


def si_symbol(dimension: str) -> str:
    """The SI unit of a dimension as it is printed: m/s, W/m2."""
    return si_key(dimension).replace("_per_", "/").replace("per_", "1/")


def dimension_of(info: FieldInfo) -> Dimension | None:
    """The dimension of a field, `Length` and `Length | None` alike; None of a plain number."""
    marks = [*info.metadata, *(m for a in get_args(info.annotation) for m in get_args(a)[1:])]
    return next((mark for mark in marks if isinstance(mark, Dimension)), None)


class Section(BaseModel):
    """A table of a mission file: frozen, no unknown keys, quantities converted to SI and radians."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _to_si(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        data = dict(data)
        for name, info in cls.model_fields.items():
            dimension = dimension_of(info)
            if dimension is None:
                continue
            units = UNITS[dimension.name]
            wanted = f"{'an' if dimension.name[0] in 'aei' else 'a'} {dimension.name}"
            keys = [f"{name}_{unit}" for unit in units]
            given = [key for key in keys if key in data]
            if name in data:
                raise ValueError(
                    f"{name}: expected {wanted} with its unit in the key "
                    f"({' or '.join(keys)}), got {name} = {data[name]!r}"
                )
            if len(given) > 1:
                raise ValueError(f"{name}: given more than once, as {' and '.join(given)}")
            if given:
                unit = given[0][len(name) + 1 :]
                data[name] = _convert(given[0], data.pop(given[0]), units[unit])
            elif info.is_required():
                others = {o for o in cls.model_fields if o != name and o.startswith(name)}
                near = [
                    key
                    for key in data
                    if key.startswith(f"{name}_") and not any(key.startswith(o) for o in others)
                ]
                came = near[0] if near else "nothing"
                raise ValueError(f"{name}: expected {wanted} ({' or '.join(keys)}), got {came}")
        return data

    def as_written(self) -> dict[str, Any]:
        """What would make this section: its fields under keys in SI units."""
        written: dict[str, Any] = {}
        for name, info in type(self).model_fields.items():
            value, dimension = getattr(self, name), dimension_of(info)
            if value is None:
                continue
            if isinstance(value, Section):
                value = value.as_written()
            elif isinstance(value, tuple):
                value = [v.as_written() if isinstance(v, Section) else v for v in value]
            written[f"{name}_{si_key(dimension.name)}" if dimension else name] = value
        return written

    def check(self) -> None:
        """Raise ValueError if no mission file could have made this section."""
        try:
            type(self).model_validate(self.as_written())
        except ValidationError as error:
            fault = error.errors()[0]
            where = ".".join(str(part) for part in fault["loc"])
            got = (
                "" if isinstance(fault["input"], dict) else f" (got {fault['input']!r} in SI units)"
            )
            message = fault["msg"].removeprefix("Value error, ")
            raise ValueError(f"{where + ': ' if where else ''}{message}{got}") from None
