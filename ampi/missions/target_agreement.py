"""What a target cannot tell alone: whether it fits the objective, the controls and their limits."""

from __future__ import annotations

from collections.abc import Iterator

from ampi.missions import units as u
from ampi.missions.flight_sections import GIVEN_STATES
from ampi.missions.sections import MissionSections


def final_states_are_told_once(mission: MissionSections) -> Iterator[str]:
    """A final state is weighted, free or in a range."""
    target, objective = mission.target, mission.objective
    for name in GIVEN_STATES:
        if not getattr(objective, f"{name}_weight"):
            continue
        if name in target.free_states:
            yield (
                f"target.free: expected no state with a weight in [objective], got {name}; make "
                f"objective.{name}_weight 0 or remove {name}"
            )
        elif getattr(target, f"{name}_range") is not None:
            yield (
                f"target.{name}_range: expected none beside objective.{name}_weight; make the weight 0 "
                "or remove the range"
            )


def objective_has_its_freedom(mission: MissionSections) -> Iterator[str]:
    """A final state that is met exactly is nothing to minimise, nor the rate of a schedule."""
    objective = mission.objective
    if objective.angle_of_attack_effort and mission.angle_of_attack is None:
        yield (
            "objective.angle_of_attack_effort: expected 0, for the angle of attack follows a schedule; "
            "[angle_of_attack] makes it a control"
        )
    for term, states in (("cross_range", ("longitude", "latitude")), ("final_speed", ("speed",))):
        if getattr(objective, term) and all(_is_met_exactly(mission, name) for name in states):
            yield (
                f"objective.{term}: expected target.{' or '.join(states)} to be free or in a range, got "
                "a target that is met exactly; name it in target.free"
            )


def _is_met_exactly(mission: MissionSections, name: str) -> bool:
    is_weighted = getattr(mission.objective, f"{name}_weight") is not None
    return mission.target.held_by(name) == name and not is_weighted


def final_angles_can_be_flown(mission: MissionSections) -> Iterator[str]:
    """Final bank angle and angle of attack, each within what the vehicle may fly."""
    target, control, limit = mission.target, mission.angle_of_attack, mission.limits.bank_angle
    if target.bank_angle is not None and max(map(abs, target.bank_angle)) > limit:
        yield (
            f"target.bank_angle: expected at most limits.bank_angle ({limit / u.DEGREE:.4g}°) in size, "
            f"got {_told(target.bank_angle)}"
        )
    if target.angle_of_attack is None:
        return
    if control is None:
        yield (
            "target.angle_of_attack: expected nothing, for the angle of attack follows a schedule; "
            "[angle_of_attack] makes it a control"
        )
        return
    low, high = min(control.lower), max(control.upper)
    if target.angle_of_attack[0] < low or target.angle_of_attack[1] > high:
        yield (
            f"target.angle_of_attack: expected {_told((low, high))}, the bounds of [angle_of_attack], "
            f"got {_told(target.angle_of_attack)}"
        )


def _told(span: tuple[float, float]) -> str:
    """10°, or 10° to 20°."""
    low, high = (f"{angle / u.DEGREE:.4g}°" for angle in span)
    return low if low == high else f"{low} to {high}"
