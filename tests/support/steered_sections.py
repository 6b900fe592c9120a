"""SHEFEX-3 with a second control, as the literature's methods know it: one phase, an exact target."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any

from ampi.missions.loading import load_mission, parse_mission
from ampi.missions.mission import Mission
from ampi.missions.text import toml_text

CONTROL = {
    "lower_deg": 10.0,
    "upper_deg": 42.0,
    "rate_deg_per_s": 5.0,
    "acceleration_deg_per_s2": 4.0,
}


def steered_shefex3(**changes: Mapping[str, Any]) -> Mission:
    """With `changes` of sections: keys to add or to replace."""
    sections = tomllib.loads(load_mission("shefex3").toml)
    del sections["vehicle"]["angle_of_attack"], sections["grid"]
    for key in [key for key in sections["limits"] if key.startswith("angle_of_attack")]:
        del sections["limits"][key]
    sections["angle_of_attack"] = CONTROL
    sections["objective"] = {"bank_rate_effort": 1.0, "angle_of_attack_effort": 1.0}
    sections["mesh"] = {"phase": [{"degrees": [6, 6, 6, 6, 6, 6]}]}
    for name, lines in changes.items():
        sections[name] = sections[name] | lines
    return parse_mission(toml_text(sections))
