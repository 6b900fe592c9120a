"""What a mission says, as TOML: scalars first, then its tables, in the order of the sections.

Numbers are written so that they read back to the bit (`units.in_units`), so a text is its mission.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

WIDTH = 88  # of a line; a longer list of lists has a line for each


def toml_text(tables: Mapping[str, Any]) -> str:
    """The TOML of nested `tables` of strings, numbers, lists and lists of tables."""
    return "\n".join(_lines(tables, "")).strip("\n") + "\n"


def assignment(key: str, value: Any) -> str:
    """The line, or lines, that give a key its value."""
    return f"{_key(key)} = {_value(value, len(key))}"


def _lines(table: Mapping[str, Any], above: str) -> Iterator[str]:
    for key, value in table.items():
        if not _is_table(value):
            yield assignment(key, value)
    for key, value in table.items():
        path = f"{above}{_key(key)}"
        if isinstance(value, dict):
            if not all(map(_is_table, value.values())):
                yield from ("", f"[{path}]")
            yield from _lines(value, f"{path}.")
        elif _is_table(value):
            for item in value:
                yield from ("", f"[[{path}]]", *_lines(item, f"{path}."))


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (
        isinstance(value, list) and bool(value) and all(isinstance(item, dict) for item in value)
    )


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _string(key)


def _string(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: Any, before: int = 0) -> str:
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, dict):
        return f"{{ {', '.join(assignment(key, item) for key, item in value.items())} }}"
    if isinstance(value, list):
        items = [_value(item) for item in value]
        line = f"[{', '.join(items)}]"
        if len(line) + before <= WIDTH or not isinstance(value[0], list):
            return line
        return "[\n" + "".join(f"    {item},\n" for item in items) + "]"
    return repr(float(value)) if isinstance(value, float) else repr(value)
