"""One cycle of a loop of one's own."""

from __future__ import annotations

from typing import Any

from ampi.guidance import Guidance
from ampi.onboard.command import Command
from ampi.onboard.reference import Reference


def command(guidance: Guidance, reference: Reference, time: Any, state: Any, rate: Any) -> Command:
    """That of one flight on `reference`, navigated as `state` (7,) and bank rate (rad/s)."""
    guidance.follow(reference)
    return guidance.step(time, [*state, rate])
