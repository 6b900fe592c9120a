"""A tracking law: what is made of the reference's rows and of what navigation and sensors tell.

A law is two functions. Offline, `ampi.tracker_design` computes its rows along every optimum; they
are stored, interpolated and converted like any state. On board, `command` turns the rows at the instant
of the look-up into a bank rate and a change of the angle of attack. It works on n flights at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.row_layout import RowLayout

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Told:
    """What guidance knows of n flights at one instant."""

    state: Array  # (7, n): h, θ, φ, V, γ, ψ, σ; SI, rad
    sensed: Array  # (3, n), m/s²: specific force along the velocity, up and to the right of it
    step: float  # s since the last command
    change: Array  # (n,), rad: of the angle of attack, as it was commanded last


class TrackingLaw(Protocol):
    """One law; frozen, its gains are its fields."""

    @property
    def name(self) -> str:
        """As it is asked for."""
        ...

    @property
    def layout(self) -> RowLayout:
        """Rows of the tables that it flies."""
        ...

    @property
    def senses(self) -> bool:
        """Whether it uses sensed accelerations."""
        ...

    @property
    def modulates(self) -> bool:
        """Whether it asks for changes of the angle of attack."""
        ...

    def memory(self, n: int) -> Array:
        """What n flights remember from command to command, at their begin: (k, n)."""
        ...

    def along(self, times: Array, rows: Array) -> Array | None:
        """What the look-up goes by, (n, m), increasing along each reference (times, rows (n, m, r)).

        None: the time itself.
        """
        ...

    def now(self, clock: Any, told: Told) -> Any:
        """Its present value for each flight: a number or (n,)."""
        ...

    def command(self, at: Array, told: Told, memory: Array) -> tuple[Array, Array]:
        """Bank rate (rad/s) and change of the angle of attack (rad) that it asks for, (n,) each.

        Limiters of guidance make of it what the vehicle can follow.

        Parameters
        ----------
        at
            Rows of the reference (r, n) where the look-up has found it.
        told
            State and accelerations.
        memory
            From `memory`; changed in place.
        """
        ...
