"""What a command prints: words and tables for eyes, JSON for programs, one sentence for an error."""

from __future__ import annotations

import json
import math
import numbers
import sys
from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.text import Text

# paths and titles are data: no markup, no :names: of pictures; and where there is no terminal nobody
# knows how wide it is, and no number may be cut
PLAIN: dict[str, Any] = {"markup": False, "emoji": False, "highlight": False, "soft_wrap": True}
out = Console(**PLAIN, width=None if sys.stdout and sys.stdout.isatty() else 160)
error_out = Console(**PLAIN, stderr=True)


def print_error(sentence: str) -> None:
    """One sentence on standard error, marked as what ends the command."""
    error_out.print(Text.assemble(("error:", "bold red"), " ", sentence))


def escaped(value: object) -> str:
    """On one line, as it is, but for characters that would move the cursor: those as in Python."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in str(value))


def print_json(value: Any) -> None:
    """As JSON: what is no number is null, for JSON has no word for it and strict readers refuse NaN."""
    text = json.dumps(_without_nan(value), indent=1, default=float, allow_nan=False)
    sys.stdout.write(text + "\n")


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    if isinstance(value, numbers.Real) and not math.isfinite(value):
        return None
    return value


def print_summary(summary: Mapping[str, str | float]) -> None:
    """A line for each number of a trajectory's summary."""
    for key, value in summary.items():
        out.print(f"  {key:34} {value if isinstance(value, str) else known(value, '.8g')}")


def known(value: float, digits: str = ".3g") -> str:
    """The number, or a dash where there is none; "inf" of a flight with no end."""
    return "–" if math.isnan(value) else f"{value:{digits}}"
