"""Units in mission files: a number with a dimension carries its unit in its key.

`altitude_km = 100.1` fills the field `altitude` with 100,100 m. A key without a unit, or with a
unit of another dimension, is an error that lists the units that would do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Annotated, Any, Self, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

DEGREE = float(np.pi / 180.0)

UNITS: dict[str, dict[str, float]] = {
    "length": {"m": 1.0, "km": 1e3},
    "angle": {"rad": 1.0, "deg": DEGREE},
    "speed": {"m_per_s": 1.0, "km_per_s": 1e3},
    "time": {"s": 1.0},
    "mass": {"kg": 1.0},
    "area": {"m2": 1.0},
    "angular rate": {"rad_per_s": 1.0, "deg_per_s": DEGREE},
    "acceleration": {"m_per_s2": 1.0},
    "angular acceleration": {"rad_per_s2": 1.0, "deg_per_s2": DEGREE},
    "pressure": {"Pa": 1.0, "kPa": 1e3},
    "heat flux": {"W_per_m2": 1.0, "kW_per_m2": 1e3, "MW_per_m2": 1e6},
    "load factor": {"g": 1.0},
    "inverse angle squared": {"per_rad2": 1.0, "per_deg2": DEGREE**-2},
    "inverse length squared": {"per_m2": 1.0, "per_km2": 1e-6},
    "inverse speed squared": {"per_m2_s2": 1.0},
}


USUAL = {  # what a mission is written in; of the others the SI unit
    "length": "km",
    "angle": "deg",
    "angular rate": "deg_per_s",
    "angular acceleration": "deg_per_s2",
    "pressure": "kPa",
    "heat flux": "kW_per_m2",
    "inverse angle squared": "per_deg2",
}


@dataclass(frozen=True)
class Dimension:
    """Marks a field as a physical quantity; one number may stand for a range [least, greatest].

    A circular angle is the same modulo a turn: longitude, azimuth, bank angle; latitude is not. One
    number may also stand for a list whose numbers are all the same.
    """

    name: str
    is_range: bool = False
    is_circular: bool = False
    is_list: bool = False  # that one number may stand for


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
LengthRange = Annotated[tuple[float, float], Dimension("length", is_range=True)]
SpeedRange = Annotated[tuple[float, float], Dimension("speed", is_range=True)]
AngleRange = Annotated[tuple[float, float], Dimension("angle", is_range=True)]
CircularRange = Annotated[tuple[float, float], Dimension("angle", is_range=True, is_circular=True)]
Lengths = Annotated[tuple[float, ...], Dimension("length")]
Speeds = Annotated[tuple[float, ...], Dimension("speed")]


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


def _wanted(name: str, dimension: str, how: str = "") -> str:
    """A quantity in words: a length (altitude_m or altitude_km)."""
    article = "an" if dimension[0] in "aei" else "a"
    keys = " or ".join(f"{name}_{unit}" for unit in UNITS[dimension])
    return f"{article} {dimension}{how} ({keys})"


def key_given(name: str, dimension: str, data: Mapping[str, Any]) -> str | None:
    """The key, with its unit, under which `data` has the quantity `name`; None if it has not.

    Raises
    ------
    ValueError
        If it has it without a unit, or under two.
    """
    if name in data:
        wanted = _wanted(name, dimension, " with its unit in the key")
        raise ValueError(f"{name}: expected {wanted}, got {name} = {data[name]!r}")
    given = [key for unit in UNITS[dimension] if (key := f"{name}_{unit}") in data]
    if len(given) > 1:
        raise ValueError(f"{name}: given more than once, as {' and '.join(given)}")
    return given[0] if given else None


def si_key(dimension: str) -> str:
    """The SI unit of a dimension as it stands in keys: m_per_s, W_per_m2."""
    return next(unit for unit, factor in UNITS[dimension].items() if factor == 1.0)


def in_units(dimension: str, value: Any) -> tuple[str, Any]:
    """Unit and number, or numbers, of a mission file that are exactly `value` (SI).

    In the usual unit where each is, to the bit, some decimal times the unit; else in the SI unit, where
    it always is: a product of floats does not reach every float.
    """
    unit = USUAL.get(dimension, si_key(dimension))
    try:
        return unit, _divided(value, UNITS[dimension][unit])
    except (ArithmeticError, TypeError):  # of what is no number the section will tell
        return si_key(dimension), value


def _divided(value: Any, factor: float) -> Any:
    """The shortest decimals that times `factor` are `value`."""
    if isinstance(value, tuple):
        return [_divided(item, factor) for item in value]
    exact = value / factor
    near = (float(f"{exact:.15g}"), float(f"{exact:.16g}"), exact)
    for number in (*near, math.nextafter(exact, -math.inf), math.nextafter(exact, math.inf)):
        if number * factor == value and math.isfinite(number):
            return number
    raise ArithmeticError(f"{value!r} is no float times {factor!r}")


def symbol(unit: str) -> str:
    """A unit of a key as it is printed: m/s, W/m2."""
    return unit.replace("_per_", "/").replace("per_", "1/")


def dimension_of(info: FieldInfo) -> Dimension | None:
    """The dimension of a field, `Length` and `Length | None` alike; None of a plain number."""
    marks = [*info.metadata, *(m for a in get_args(info.annotation) for m in get_args(a)[1:])]
    return next((mark for mark in marks if isinstance(mark, Dimension)), None)


@lru_cache
def _fields(section: type[BaseModel]) -> tuple[tuple[str, FieldInfo, Dimension | None], ...]:
    """Name, field and dimension of all that a section may hold."""
    return tuple((name, info, dimension_of(info)) for name, info in section.model_fields.items())


class Section(BaseModel):
    """A table of a mission file: frozen, no unknown keys, quantities converted to SI and radians."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _to_si(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        data, faults = dict(data), list[str]()
        for name, info, dimension in _fields(cls):
            if dimension is None:
                continue
            try:
                key = key_given(name, dimension.name, data)
                if key is not None:
                    factor = UNITS[dimension.name][key[len(name) + 1 :]]
                    data[name] = _convert(key, data.pop(key), factor)
            except ValueError as error:
                faults.append(str(error))
                continue
            if key is None and info.is_required():
                others = {o for o in cls.model_fields if o != name and o.startswith(name)}
                near = [
                    key
                    for key in data
                    if key.startswith(f"{name}_") and not any(key.startswith(o) for o in others)
                ]
                came = near[0] if near else "nothing"
                faults.append(f"{name}: expected {_wanted(name, dimension.name)}, got {came}")
        if faults:
            raise ValueError("\n".join(faults))
        return data

    def as_written(self) -> dict[str, Any]:
        """What would make this section: its fields as a mission file has them, without defaults."""
        written: dict[str, Any] = {}
        for name, info, dimension in _fields(type(self)):
            value, default = getattr(self, name), info.default
            if value is default or (
                isinstance(value, float | str) and repr(value) == repr(default)
            ):
                continue  # not where −0 stands for 0
            if dimension is not None:
                ends = set(map(repr, value)) if isinstance(value, tuple) else ()
                if len(ends) == 1 and (
                    dimension.is_range or (dimension.is_list and len(value) == 1)
                ):
                    value = value[0]
                unit, value = in_units(dimension.name, value)
                name = f"{name}_{unit}"
            written[name] = _as_written(value)
        return {name: value for name, value in written.items() if value != {}}

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with other fields, unchecked.

        Raises
        ------
        ValueError
            If the section has no such field.
        """
        fields = type(self).model_fields
        unknown = [name for name in update or () if name not in fields]
        if unknown:
            raise ValueError(
                f"update: expected fields of {type(self).__name__} ({', '.join(fields)}), "
                f"got {', '.join(unknown)}"
            )
        copied = super().model_copy(update=update, deep=deep)
        for derived in [name for name in copied.__dict__ if name not in fields]:
            del copied.__dict__[derived]
        return copied

    @cached_property
    def own_faults(self) -> tuple[str, ...]:
        """Why no mission file could have made this section: a sentence each, none if one could."""
        return tuple(self.faults())

    def faults(self, path: tuple[str, ...] = (), unit: str | None = None) -> list[str]:
        """`own_faults`, the number at `path` told in `unit` of its key."""
        data = self.as_written()
        if unit is not None:
            _tell_in(data, path, unit)
        try:
            found = type(self).model_validate(data)
        except ValidationError as error:
            return [line for fault in error.errors() for line in sentences(fault, data)]
        given = {
            name: (getattr(self, name), getattr(found, name)) for name in type(self).model_fields
        }
        return [
            f"{name}: expected what a mission file can say, {read!r}, got {value!r}"
            for name, (value, read) in given.items()
            if unit is None and value != read
        ]


def _as_written(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_as_written(item) for item in value]
    return value.as_written() if isinstance(value, Section) else value


_FACTORS = {unit: factor for units in UNITS.values() for unit, factor in units.items()}
_BOUNDS = {  # of pydantic: kind of fault → its key and words
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "greater than or equal to"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "less than or equal to"),
}


def sentences(fault: ErrorDetails, data: Any) -> list[str]:
    """Place, what was expected and what came of a fault of `data`, in the unit of the key there."""
    where = ".".join(str(part) for part in fault["loc"])
    unit, came = _given(fault, data)
    if fault["type"] in _BOUNDS:
        key, words = _BOUNDS[fault["type"]]
        name = f" {symbol(unit)}" if unit else ""
        bound = fault["ctx"][key] / _FACTORS.get(unit, 1.0)
        most = f"{bound:.10g}{name}" if bound else "0"
        return [f"{where}: Input should be {words} {most} (got {came:.10g}{name})"]
    shown = "" if isinstance(fault["input"], dict) else f" (got {came!r})"
    message = fault["msg"].removeprefix("Value error, ")
    return [f"{where + ': ' if where else ''}{line}{shown}" for line in message.split("\n")]


def _given(fault: ErrorDetails, data: Any) -> tuple[str, Any]:
    """Unit, if any, and value of the faulty field as they stand in `data`."""
    unit = ""
    for part in fault["loc"]:
        if isinstance(data, dict) and part not in data:
            keys = [key for key in data if key.removeprefix(f"{part}_") in _FACTORS]
            if not keys:  # the name of a model, or nothing is there
                continue
            unit = keys[0].removeprefix(f"{part}_")
            part = keys[0]
        data = data[part]
    return unit, fault["input"] if isinstance(data, dict) else data


def _tell_in(data: dict[str, Any], path: tuple[str, ...], unit: str) -> None:
    """Give the number at `path` of what was written under a key in `unit`, whatever its own."""
    *above, name = (part for part in path if not part.isdigit())  # all of a range
    for part in above:
        data = data[part]
    for key in [key for key in data if key.removeprefix(f"{name}_") in _FACTORS]:
        value, factor = data.pop(key), _FACTORS[key.removeprefix(f"{name}_")] / _FACTORS[unit]
        data[f"{name}_{unit}"] = (
            [v * factor for v in value] if isinstance(value, list) else value * factor
        )
