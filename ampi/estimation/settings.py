"""Numbers that steer the estimator."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class EstimatorSettings:
    """Standard deviations of what may be wrong, of what is told, and when a measurement is used.

    The first five and their lengths are the uncertainties of the vehicle's project, here those of the
    `everything` world; the told altitude, speed and angles those of its navigation. Beyond that the
    numbers are tuned, so that NEES and NIS stay below their degrees of freedom at every time
    (scripts/check_estimates.py):

    - A flight that pulls up meets the air of some altitudes twice and learns nothing new of it; the
      local part is therefore given a quarter more than its 3.3 %.
    - The errors of the told angles are bias as well as noise, and a bias does not average out over
      thousands of samples; the angle is given twice their root sum of squares.
    - Of the altitude and of the speed only the noise counts: a bias of the altitude is part of k_D.

    Biases of speed and angles as four more states were tried: wind and ln k_D became better by a third,
    and no corrected flight ended nearer to its target.
    """

    log_drag: float = 0.08  # of ln k_D, constant part: density, drag coefficient and mass in one
    local_log_drag: float = 0.042  # of its part that changes with the altitude
    log_lift_to_drag: float = 0.05  # of ln (k_L / k_D)
    wind: float = 20.0  # m/s, of each component
    angle_of_attack: float = 0.006  # rad, of its error
    walk_factors: float = 4e-9  # 1/s, growth of the variances of both constant logarithms
    walk_angle: float = 1e-12  # rad²/s
    length: float = 10e3  # m of altitude over which the local part is correlated
    wind_length: float = 15e3  # m
    altitude: float = 34.0  # m, noise of the told altitude
    scale_height: float = 7e3  # m, over which the density falls e-fold
    speed: float = 0.17  # m/s, noise of the told speed
    angle: float = 3e-4  # rad, of flight-path angle, azimuth and bank angle
    relative: float = 3e-4  # of the sensed acceleration: scale factor of the accelerometer
    floor: float = 1e-3  # m/s²
    weakest: float = 0.05  # m/s², below which nothing is learnt
    gate: float = 25.0  # of νᵀ S⁻¹ ν: of χ² with three degrees of freedom one of 65,000 lies beyond
    patience: float = 3.0  # s of innovations beyond the gate, after which the prior spread returns

    @property
    def prior(self) -> tuple[float, ...]:
        """Standard deviations of (a, c, r, w_E, w_N, d) before anything is sensed."""
        return (
            self.log_drag,
            self.local_log_drag,
            self.log_lift_to_drag,
            self.wind,
            self.wind,
            self.angle_of_attack,
        )

    @property
    def walk(self) -> tuple[float, ...]:
        """Growth of the six variances (1/s); what fades over the altitude has its own."""
        return (self.walk_factors, 0.0, self.walk_factors, 0.0, 0.0, self.walk_angle)
