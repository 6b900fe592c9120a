"""Angles that are the same modulo a turn: longitude, azimuth, bank angle.

A stored angle may lie on any turn; what compares, subtracts or interpolates two of them takes them to
the same one first.
"""

from __future__ import annotations

from typing import Any

import numpy as np

TURN = 2.0 * np.pi


def wrapped(angle: Any) -> Any:
    """`angle` (rad) in [−π, π): of a difference of two angles, the short way round."""
    return np.mod(angle + np.pi, TURN) - np.pi


def on_turn_of(angle: Any, reference: Any) -> Any:
    """`angle` (rad) plus the whole turns that bring it nearest to `reference`.

    An angle that needs no turn comes back as it is, to the bit; one that is no number stays none.
    """
    return angle - TURN * np.round((angle - reference) / TURN)
