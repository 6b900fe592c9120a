"""A section of a mission or world file as its author reads it: above each key what it is and may be.

All is from the fields of the sections (`Field(description=…)`, bounds, defaults). A field at its default
stands as a comment, ready to be taken in.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from textwrap import wrap
from types import UnionType
from typing import Any, Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic.fields import FieldInfo

from ampi.missions.text import assignment
from ampi.missions.units import (
    UNITS,
    USUAL,
    Dimension,
    Section,
    dimension_of,
    in_units,
    si_key,
    symbol,
)

WIDTH = 100  # of a comment
BOUNDS: dict[type, tuple[str, str]] = {
    Ge: ("ge", "≥"),
    Gt: ("gt", ">"),
    Le: ("le", "≤"),
    Lt: ("lt", "<"),
}


def opening(kind: str, source: str) -> list[str]:
    """The first lines of a file of some kind, "mission" say, that was made from another."""
    told = (
        f"A {kind}, made from {source}. Above each key stands what it is, its units, its bounds and its "
        "default; the unit is the end of the key, and any of those named will do. A key behind # is at "
        f"its default or absent. The first line lets an editor complete and check; ampi schema {kind} "
        "writes its file."
    )
    return [f"#:schema ./{kind}.schema.json", *comment(told), ""]


def explained(
    section: Section, path: str = "", *, again: bool = False, without: Collection[str] = ()
) -> Iterator[str]:
    """Lines of TOML with comments that make `section`; its tables stand below `path`.

    What stands `again`, the second phase of a mesh say, needs no words.
    """
    written, every = section.as_written(), type(section).model_fields
    fields = {name: info for name, info in every.items() if name not in without}
    for name, info in fields.items():
        if not is_table(getattr(section, name), info):
            line = _assignment(name, info, written)
            yield from () if again else comment(told(name, info))
            yield from () if again and line.startswith("#") else [line]
    for name, info in fields.items():
        value = getattr(section, name)
        if is_table(value, info):
            yield from _tables(value, info, f"{path}{name}")


def _tables(value: Any, info: FieldInfo, path: str) -> Iterator[str]:
    """The table, or tables, of one field; commented out where there is none."""
    sections = value if isinstance(value, tuple) else (value,)
    several = isinstance(value, tuple)
    yield ""
    yield from comment(info.description or "")
    if value in (None, ()):
        kind = section_type(info)
        yield f"# [[{path}]]" if several else f"# [{path}]"
        for name, field in kind.model_fields.items():
            yield from comment(told(name, field))
            yield f"# {_example(name, field)}"
        return
    for number, one in enumerate(sections):
        yield from [""] * (number > 0)
        if not all(is_table(getattr(one, name), f) for name, f in type(one).model_fields.items()):
            yield f"[[{path}]]" if several else f"[{path}]"
        yield from _table(one, path, again=number > 0)


def _table(section: Section, path: str, *, again: bool) -> Iterator[str]:
    """What stands below the head of a table: of the grid its axes, of another section its fields."""
    if type(section).model_fields.keys() == {"offsets"}:
        for key, axis in section.as_written().items():
            yield assignment(key, axis)
        if not section.as_written():
            yield "# altitude_m = [-250.0, 0.0, 250.0]"
        return
    yield from explained(section, f"{path}.", again=again)


def comment(text: str) -> Iterator[str]:
    """The text as lines of comment."""
    yield from (f"# {line}" for line in wrap(text, WIDTH - 2))


def _assignment(name: str, info: FieldInfo, written: dict[str, Any]) -> str:
    dimension = dimension_of(info)
    keys = [name] if dimension is None else [f"{name}_{unit}" for unit in UNITS[dimension.name]]
    given = [key for key in keys if key in written]
    return assignment(given[0], written[given[0]]) if given else f"# {_example(name, info)}"


def told(name: str, info: FieldInfo) -> str:
    """Meaning, unit, bounds and default of a field."""
    dimension = dimension_of(info)
    parts = [info.description or name]
    if dimension is not None:
        parts.append(f"in {' or '.join(symbol(unit) for unit in UNITS[dimension.name])}")
    choices = choices_of(info)
    if len(choices) > 1:
        parts.append(f"one of {', '.join(choices)}")
    if bounds := _bounds(info, dimension):
        parts.append(bounds)
    parts.append(_default(info, dimension))
    return f"{'; '.join(parts)}."


def choices_of(info: FieldInfo) -> tuple[str, ...]:
    """The words that a field may be; none of a number."""
    kinds = [info.annotation, *get_args(info.annotation)]  # itself, or of what is optional
    return next((get_args(kind) for kind in kinds if get_origin(kind) is Literal), ())


def _unit(dimension: Dimension | None) -> str:
    return "" if dimension is None else USUAL.get(dimension.name, si_key(dimension.name))


def _bounds(info: FieldInfo, dimension: Dimension | None) -> str:
    """≥ 0 and ≤ 130 km."""
    unit, found = _unit(dimension), []
    factor = 1.0 if dimension is None else UNITS[dimension.name][unit]
    for mark in info.metadata:
        if type(mark) in BOUNDS:
            attribute, sign = BOUNDS[type(mark)]
            found.append(f"{sign} {getattr(mark, attribute) / factor:.10g}")
    return f"{' and '.join(found)} {symbol(unit)}".rstrip() if found else ""


def _default(info: FieldInfo, dimension: Dimension | None) -> str:
    if info.is_required():
        return "required"
    if info.default is None:
        return "optional"
    value = info.default if dimension is None else in_units(dimension.name, info.default)[1]
    unit = "" if dimension is None else f" {symbol(in_units(dimension.name, info.default)[0])}"
    return f"default {value:g}{unit}" if isinstance(value, float) else f"default {value}"


def _example(name: str, info: FieldInfo) -> str:
    """An assignment of the default, or of some number where there is none."""
    dimension = dimension_of(info)
    value: Any = info.default
    if info.is_required() or value is None:
        value = (*choices_of(info), _some_value(info, dimension))[0]
        key = name if dimension is None else f"{name}_{_unit(dimension)}"
        return assignment(key, value)
    if dimension is None:
        return assignment(name, value)
    unit, number = in_units(dimension.name, value)
    return assignment(f"{name}_{unit}", number)


def _some_value(info: FieldInfo, dimension: Dimension | None) -> Any:
    if info.examples:
        return info.examples[0]
    one = dimension is not None and dimension.is_range  # a number stands for a range, too
    return [1.0] if "tuple" in str(info.annotation) and not one else 1.0


def is_table(value: Any, info: FieldInfo) -> bool:
    """Whether a field is a table, or tables, of its own."""
    return isinstance(value, Section) or section_type(info) is not Section


def section_type(info: FieldInfo) -> type[Section]:
    """The kind of section that a field holds: itself, one or none of it, or several; else `Section`."""
    kinds = [info.annotation]
    while kinds:
        kind = kinds.pop()
        if isinstance(kind, type) and issubclass(kind, Section):
            return kind
        if get_origin(kind) in (tuple, UnionType):
            kinds += get_args(kind)
    return Section
