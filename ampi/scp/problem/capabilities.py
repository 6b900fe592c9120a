"""What a method can be asked for: constraints and objective terms of a mission, by name.

A method declares what it knows once; `check` compares that with what a mission asks for before anything
is computed, and names the methods that would do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ampi.missions.flight_sections import GIVEN_STATES
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.missions.sections import TARGET_WEIGHTS, TERMS

PLACE = {"longitude", "latitude"}
FINAL = {"free final state", "final range", "final bank_angle", "final angle_of_attack"}
STEERED = ("bank_angle", "bank_rate", "angle_of_attack", "angle_of_attack_rate")
GIVEN_AT_ENTRY = frozenset(f"entry.{name}" for name in STEERED)


class MethodError(ValueError):
    """A method was asked for what it does not know."""


@dataclass(frozen=True)
class Capabilities:
    """Names of what a method knows; see `asked_for`."""

    constraints: frozenset[str]
    terms: frozenset[str]
    constant_bank: bool = True  # whether it may start from a constant bank angle


def asked_for(mission: Mission) -> tuple[list[str], list[str]]:
    """Optional constraints and objective terms of a mission, by their names in its file."""
    limits, target, objective = mission.limits, mission.target, mission.objective
    free = set(target.free_states)
    constraints = {
        "bank_angle_minimum": limits.bank_angle_minimum > 0.0,
        "drag_floor": limits.drag_floor is not None,
        "no_fly_zone": bool(mission.no_fly_zone),
        "final flight_path_angle": target.flight_path_angle is not None,
        "final azimuth": target.azimuth is not None,
        "free position": free >= PLACE,
        "free final state": bool(free - PLACE) or len(free & PLACE) == 1,
        "final range": any(getattr(target, f"{name}_range") for name in GIVEN_STATES),
        "final bank_angle": target.bank_angle is not None,
        "final angle_of_attack": target.angle_of_attack is not None,
        "fixed phases": len(mission.mesh.phase) > 1,
        "angle_of_attack": mission.angle_of_attack is not None,
        "design margins": any(limits.share(name) < 1.0 for name in PathLimits.of(mission).names),
    }
    for name in STEERED:
        constraints[f"entry.{name}"] = getattr(mission.entry, name) is not None
    constraints["entry.time"] = mission.entry.time > 0.0
    terms = {name: getattr(objective, name) != 0.0 for name in TERMS}
    terms["target weights"] = getattr(objective, TARGET_WEIGHTS[0]) is not None
    return [n for n, asked in constraints.items() if asked], [
        n for n, asked in terms.items() if asked
    ]


CONDENSED = Capabilities(
    constraints=frozenset(
        {
            "drag_floor",
            "no_fly_zone",
            "final flight_path_angle",
            "final azimuth",
            "free position",
            "free final state",
            "final range",
            "final bank_angle",
            "final angle_of_attack",
            "fixed phases",
            "angle_of_attack",
            "design margins",
            "entry.time",
            *GIVEN_AT_ENTRY,
        }
    ),
    terms=frozenset({*TERMS, "target weights"}),
)

OVER_TIME = Capabilities(  # the literature's methods over time
    constraints=CONDENSED.constraints - {"fixed phases", "design margins", "entry.time"},
    terms=frozenset(TERMS),
)
OVER_ENERGY = Capabilities(
    constraints=OVER_TIME.constraints - {"angle_of_attack", *GIVEN_AT_ENTRY, *FINAL}
    | {"bank_angle_minimum"},
    # the bank-rate effort makes an optimum over time unique; over energy there is no bank rate, and
    # Liu 2015, Eq. (38) regularises by the heading instead
    terms=frozenset({"flight_time", "heat_load", "ground_range", "bank_rate_effort"}),
)

STRAIGHT_LINES = replace(  # until they begin, no bank angle is flown, and one angle of attack
    OVER_TIME,
    constraints=OVER_TIME.constraints - GIVEN_AT_ENTRY | {"entry.angle_of_attack"},
    terms=OVER_TIME.terms - {"cross_range", "final_speed"},  # far from them their price stops them
    constant_bank=False,
)

METHODS: Mapping[str, Capabilities] = {
    "exact_hessian": CONDENSED,
    "zhou2021": STRAIGHT_LINES,
    "zhou2021_fixed": STRAIGHT_LINES,
    "liu2015": replace(OVER_ENERGY, constant_bank=False),
    "wang2020_scp": OVER_TIME,
    "wang2020_pscp": OVER_TIME,
    "wang2020": OVER_TIME,
    "liu2024_hp": OVER_TIME,
    "liu2024": OVER_TIME,
}


def check(mission: Mission, method: str, methods: Mapping[str, Capabilities] = METHODS) -> None:
    """Refuse a method that is unknown, or that does not know what `mission` asks for.

    Raises
    ------
    MethodError
        One sentence: the constraint or term, the method, and the methods that know it.
    """
    if method not in methods:
        raise MethodError(f"method: expected one of {', '.join(methods)}, got {method!r}")
    for kind, names in zip(("constraints", "terms"), asked_for(mission), strict=True):
        for name in names:
            if name in getattr(methods[method], kind):
                continue
            able = [other for other, known in methods.items() if name in getattr(known, kind)]
            whose = (
                f"{', '.join(able)} know{'s' if len(able) == 1 else ''} it" if able else "none does"
            )
            raise MethodError(
                f"{name}: asked for by mission {mission.name}, not known to method {method!r} "
                f"({whose}); choose another method or remove it from the mission"
            )


def check_bank_angle(mission: Mission, method: str, bank_angle: float) -> None:
    """Refuse a first guess of constant `bank_angle` (rad) that a method or the mission has no use for.

    Raises
    ------
    MethodError
        If the method starts from straight lines, or the mission's vehicle may not bank so far.
    """
    if not METHODS[method].constant_bank:
        able = ", ".join(name for name, known in METHODS.items() if known.constant_bank)
        raise MethodError(
            f"guess: method {method!r} starts from straight lines to the target, not from a constant "
            f"bank angle; leave it out or choose one of {able}"
        )
    limit = mission.limits.bank_angle
    if not abs(bank_angle) <= limit:  # nan too
        raise MethodError(
            f"guess: expected a bank angle between ±{np.degrees(limit):.4g}°, the limit of mission "
            f"{mission.name}; got {np.degrees(bank_angle):.4g}°"
        )
