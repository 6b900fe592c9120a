"""Numbers that steer the corrector."""

from __future__ import annotations

from dataclasses import dataclass

N_BANKS, N_ANGLES = 13, 5  # values of a plan
N_PLAN = N_BANKS + N_ANGLES
N_MISSED = 6  # east, north, up; excess of dynamic pressure, heat flux, load factor


@dataclass(frozen=True, kw_only=True)
class CorrectorSettings:
    """When and how a plan is corrected. Of the vehicle: `change`, `change_rate`, `lag`, `delay`."""

    start: float = 40.0  # s since the entry interface: below, there is next to no air to learn from
    period: float = 10.0  # s between corrections
    last_minute: float = 60.0  # s to go, from which on they come more often
    last_period: float = 1.0  # s
    quiet: float = 1.0  # s to go, from which on there is none
    change: float = 0.0  # rad, ± of the angle of attack about its schedule; 0: bank alone
    change_rate: float = 0.0  # rad/s
    lead: float = 0.6  # s, of a command over what it becomes: delay and lag of the actuator
    stiffness: float = 0.6  # 1/s, with which the bank angle is brought to the plan
    lag: float = 0.5  # s, of the angle of attack behind its command
    step: float = 4.0  # s, of the prediction
    tolerance: float = 20.0  # m: a plan that is predicted to miss by less is kept
    reach: float = 300.0  # m: a plan that still misses by more ends at the nearest point in reach
    position_weight: float = 0.01  # 1/m
    altitude_weight: float = 0.005  # 1/m
    limit_weight: float = 200.0  # of a share of a limit
    margin: float = 0.05  # of each limit, that the plan keeps free
    roughness: float = 1.0  # of a step: second differences of the bank angle
    size: float = 0.2  # of the bank angle
    change_size: float = 20.0  # of the angle of attack
    plan_roughness: float = 0.0005  # the same of the plan itself
    plan_change: float = 0.02
    longest_step: float = 0.4  # rad, of a bank angle
    iterations: float = 4
    propagations: float = 80  # flights predicted in one correction, at the most
    longest: float = 1200.0  # s of a prediction
