"""Standard output and standard error as the caller left them: closed, full, or without UTF-8."""

from __future__ import annotations

import io
import os
from typing import Any

# of ours, where the encoding is not UTF-8; what else it lacks, a file's name say, is printed by its code
SIGNS: dict[str, str | int | None] = {
    **{"→": "->", "←": "<-", "…": "...", "–": "-", "−": "-", "·": "*", "×": "x", "½": "1/2"},
    **{"°": " deg", "²": "2", "³": "3", "±": "+/-", "σ": " sigma", "≤": "<=", "≥": ">=", "≈": "~"},
    **{"α": "alpha", "γ": "gamma", "δ": "delta", "θ": "theta", "π": "pi", "ρ": "rho", "φ": "phi"},
    **{"∫": "integral of ", "ψ": "psi", "τ": "tau", "∞": "inf", "√": "sqrt", "₀": "0"},
}


class PlainStream(io.TextIOWrapper):
    """A stream without UTF-8: our signs in ASCII, names as far as its encoding goes."""

    def write(self, text: str) -> int:
        """Write it; no encoding is a reason to lose a result."""
        return super().write(text.translate(str.maketrans(SIGNS)))


def standard_stream(stream: Any) -> Any:
    """The same stream, which never fails for want of a character, or of an open file."""
    if stream is None:  # closed by the caller
        return os.fdopen(os.open(os.devnull, os.O_WRONLY), "w")
    if not isinstance(stream, io.TextIOWrapper):
        return stream
    if stream.encoding.lower().startswith("utf"):
        stream.reconfigure(errors="backslashreplace")  # a file's name need not be UTF-8
        return stream
    return PlainStream(
        stream.buffer,
        stream.encoding,
        errors="backslashreplace",
        line_buffering=stream.line_buffering,
    )


def discard(stream: Any) -> None:
    """Send what is left in a stream that fails to nowhere: the interpreter flushes it at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
