"""All that estimates and corrects on board: the model of vehicle and air, the target, the settings."""

from __future__ import annotations

from dataclasses import dataclass, field

from ampi.correction.settings import CorrectorSettings
from ampi.estimation.settings import EstimatorSettings
from ampi.onboard.flight_model import FlightModelData

NO_AXIS = -1


@dataclass(frozen=True, eq=False, kw_only=True)
class Correction:
    """What a guidance needs to correct its plan in flight."""

    model: FlightModelData
    target: tuple[float, ...]  # h (m), θ, φ (rad), V (m/s)
    target_axes: tuple[int, ...] = (NO_AXIS,) * 4  # which parameters they are
    estimator: EstimatorSettings = field(default_factory=EstimatorSettings)
    corrector: CorrectorSettings = field(default_factory=CorrectorSettings)

    @property
    def name(self) -> str:
        """By what it corrects."""
        return "bank_and_angle" if self.corrector.change > 0.0 else "bank"
