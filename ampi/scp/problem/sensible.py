"""Settings are refused at birth where no iteration could make sense of them."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from math import isfinite
from typing import Any

MAY_BE_ZERO = ("corrections", "growths", "patience", "settled", "after")


def require_sensible(name: str, settings: Any) -> None:
    """Every number of a settings object, and of those inside, is a positive one of its kind.

    Raises
    ------
    ValueError
        Naming the field, what was expected and what came.
    """
    for field in fields(settings):
        value, where = getattr(settings, field.name), f"{name}.{field.name}"
        whole = field.type in ("int", int)
        if is_dataclass(value):
            require_sensible(where, value)
        elif value is None and field.default is None:
            continue
        elif field.type in ("int", int, "float", float, "float | None"):
            least = 0 if field.name in MAY_BE_ZERO else None
            is_number = isinstance(value, int if whole else int | float)
            if isinstance(value, bool) or not is_number or not isfinite(value):
                kind = "a whole number" if whole else "a finite number"
                raise ValueError(f"{where}: expected {kind}, got {value!r}")
            if value < 0 or (value == 0 and least is None):
                wanted = "at least 0" if least == 0 else "more than 0"
                raise ValueError(f"{where}: expected {wanted}, got {value!r}")
        elif not isinstance(value, tuple):
            raise ValueError(f"{where}: expected settings of its own, got {value!r}")
