"""When a reference is re-selected, and how much of what is estimated counts."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class ReselectionSettings:
    """Times, weights and shares; all [X], found on the tuning pool of `everything`."""

    first: float = 40.0  # s since the entry interface: the air is felt
    every: float = 10.0  # s
    rest: float = 40.0  # s before its end a reference is tracked and no longer re-selected
    matches: bool = True  # entry parameters are moved to the optimum that passes nearest
    altitude: float = 500.0  # m: what of a state's distance to an optimum weighs as much
    position: float = 1000.0  # m
    speed: float = 20.0  # m/s
    angle: float = 0.003  # rad, of flight-path angle and azimuth
    entry: float = 0.3  # of an axis' range: the entry parameters moved by that weigh as much
    steps: int = 4  # of Gauss–Newton
    local: float = 0.5  # of the estimate's local part, which belongs to the present altitude
    wind: float = 0.7  # of the estimated wind; it is seen badly
    calm: float = 50e3  # m above the target over which the drift that is expected falls e-fold

    def __post_init__(self) -> None:
        positive = ("every", "altitude", "position", "speed", "angle", "entry", "calm")
        for name in ("first", "rest", "steps", "local", "wind", *positive):
            value = getattr(self, name)
            if not 0.0 <= value < 1e12 or (name in positive and value == 0.0):
                least = "a positive number" if name in positive else "no negative number"
                raise ValueError(f"{name}: expected {least}, got {value!r}")
