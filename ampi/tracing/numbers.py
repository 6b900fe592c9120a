"""A model taken apart: its structure, which is traced once, and its numbers, which are inputs.

A density factor, a mass, a coefficient, a limit may change from case to case and in flight; what the
expressions are built of does not. Two numbers belong to the structure: one that is exactly zero is a
term that is not there, and the numbers of a table are its shape, unless a family moves one of them.

A number of a family is an array over its cases, (c,).
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.physics.aerodynamics import TabulatedAerodynamics
from ampi.physics.atmosphere import SmoothTable

Numbers = list[Any]  # floats; arrays over cases where a family's members differ

TABLES = (SmoothTable, TabulatedAerodynamics)


@dataclass(frozen=True)
class _Number:
    """Stands in a structure where a number was."""


@dataclass(frozen=True)
class _Record:
    """A dataclass without its numbers."""

    type: type
    fields: tuple[tuple[str, Hashable], ...]


NUMBER = _Number()


def is_zero(value: Any) -> bool:
    """Whether a number is structurally zero: for every case, and known when the model is traced."""
    return isinstance(value, float | int) and value == 0.0


def taken_apart(value: Any) -> tuple[Hashable, Numbers]:
    """The structure of a model (dataclasses, tuples, numbers) and its numbers in order."""
    numbers: Numbers = []
    return _structure(value, numbers), numbers


def _structure(value: Any, numbers: Numbers) -> Hashable:
    if isinstance(value, np.ndarray) or (isinstance(value, float) and value != 0.0):
        numbers.append(value)
        return NUMBER
    if isinstance(value, tuple):
        return tuple(_structure(part, numbers) for part in value)
    if is_dataclass(value) and not (isinstance(value, TABLES) and _is_fixed(value)):
        parts = ((f.name, _structure(getattr(value, f.name), numbers)) for f in fields(value))
        return _Record(type(value), tuple(parts))
    found: Hashable = value
    return found


def _is_fixed(table: Hashable) -> bool:
    """Whether no number of a table is an array over cases: those have no hash."""
    try:
        hash(table)
    except TypeError:
        return False
    return True


def put_together(structure: Any, numbers: Iterator[Any]) -> Any:
    """The model of a structure with other numbers, such as symbols; they are not checked."""
    if structure is NUMBER or isinstance(structure, _Number):
        return next(numbers)
    if isinstance(structure, tuple):
        return tuple(put_together(part, numbers) for part in structure)
    if not isinstance(structure, _Record):
        return structure
    model: Any = object.__new__(structure.type)
    for name, part in structure.fields:
        object.__setattr__(model, name, put_together(part, numbers))
    return model


def at_cases(numbers: Numbers, cases: NDArray[np.intp] | int) -> Numbers:
    """The numbers of some cases of a family."""
    return [n[cases] if isinstance(n, np.ndarray) else n for n in numbers]
