"""Trust region on the change of the steered angles.

All nonlinearity of the problem enters through the steered angles y and the final time, so the box
|δy| ≤ Δ, |δt_f| ≤ Δ · (final-time scale) bounds what linearisation and curvature may neglect. The
radius follows Conn, Gould & Toint (2000), Algorithm 6.1.1, with one addition: right after a rejected
step it grows more slowly, or every other step would be rejected again. Near a solution the region is
never active.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class TrustRegionSettings:
    """Dimensionless constants of the radius update."""

    initial: float = 0.3  # rad
    estimate: float = 0.02  # rad: the step that only tells multipliers
    largest: float = 4.0  # rad
    smallest: float = 1e-6  # rad: below, the solve has stalled
    accept: float = 1e-3  # least ratio of actual to predicted reduction
    shrink_below: float = 0.25
    grow_above: float = 0.7
    shrink: float = 0.5
    shrink_rejected: float = 0.35
    grow: float = 2.5
    grow_after_shrink: float = 1.3


@dataclass
class TrustRegion:
    """Radius (rad) and whether it has just shrunk."""

    settings: TrustRegionSettings
    radius: float
    just_shrunk: bool = False

    def update(self, ratio: float, step: float) -> None:
        """After a step of size `step` (rad) that achieved `ratio`."""
        s = self.settings
        if ratio < s.shrink_below:
            factor = s.shrink_rejected if ratio < 0.0 else s.shrink
            self.radius = factor * min(self.radius, step)
            self.just_shrunk = True
        elif ratio > s.grow_above and step > 0.8 * self.radius:
            factor = s.grow_after_shrink if self.just_shrunk else s.grow
            self.radius = min(factor * self.radius, s.largest)
            self.just_shrunk = False

    @property
    def collapsed(self) -> bool:
        """Whether no useful step is left."""
        return self.radius < self.settings.smallest
