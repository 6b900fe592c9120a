"""The JSON schema of a mission file, from which editors complete and check.

All is from the sections: descriptions, bounds in the unit of each key, choices. Draft 7, which the TOML
editors know. What no schema can tell, whether the sections fit together, `load_mission` tells.
"""

from __future__ import annotations

from typing import Any

from pydantic.fields import FieldInfo
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import core_schema

from ampi.missions.flight_sections import EntrySection
from ampi.missions.grid import GridSection
from ampi.missions.model_sections import AtmosphereSection, TableSection
from ampi.missions.sections import MissionSections
from ampi.missions.units import UNITS, Dimension, Section, dimension_of
from ampi.physics.state import ENTRY_STATES

DRAFT_7 = "http://json-schema.org/draft-07/schema#"
Schema = dict[str, Any]
_BOUNDS = ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")
_AXIS: Schema = {"type": "array", "items": {"type": "number"}, "minItems": 1}
_FILES = {  # sections whose numbers may stand in a CSV
    AtmosphereSection: "altitude_m, density_kg_per_m3, speed_of_sound_m_per_s",
    TableSection: "angle_of_attack_deg, mach, lift, drag",
}


def mission_schema() -> Schema:
    """Of a mission file."""
    found = MissionSections.model_json_schema(schema_generator=SectionsSchema)
    return {"$schema": DRAFT_7, **found, "title": "ampi mission"}


class SectionsSchema(GenerateJsonSchema):
    """Sections with the keys of a file in the place of their fields: a key for each unit."""

    def model_schema(self, schema: core_schema.ModelSchema) -> Schema:
        """Of one section."""
        kind, found = schema["cls"], super().model_schema(schema)
        if issubclass(kind, GridSection):
            return _grid(found)
        if issubclass(kind, Section):
            found = _with_units(kind, found)
        if kind in _FILES:
            found = _with_file(kind, found)
        return found


def _with_units(kind: type[Section], schema: Schema) -> Schema:
    """Each quantity under a key for each unit, of which one is wanted if the quantity is."""
    properties: Schema = {}
    required, one_of = [], []
    for name, info in kind.model_fields.items():
        own, dimension = without_null(schema["properties"][name]), dimension_of(info)
        keys = {name: own}
        if dimension is not None:
            units = UNITS[dimension.name]
            keys = {f"{name}_{unit}": _in_unit(own, units[unit], dimension) for unit in units}
        properties |= keys
        if info.is_required():
            required += [name] if name in keys else []
            one_of += [] if name in keys else [[{"required": [key]} for key in keys]]
    found = {**schema, "properties": properties, "additionalProperties": False}
    found.pop("required", None)
    if required:
        found["required"] = required
    if one_of:
        found["allOf"] = [{"oneOf": ways} for ways in one_of]
    return found


def without_null(schema: Schema) -> Schema:
    """The schema of an optional field: TOML has no null, an absent key says it."""
    found = {key: value for key, value in schema.items() if value is not None}
    kinds = [kind for kind in found.pop("anyOf", ()) if kind.get("type") != "null"]
    if len(kinds) == 1:
        return {**kinds[0], **found}
    return {**found, "anyOf": kinds} if kinds else found


def _in_unit(schema: Schema, factor: float, dimension: Dimension) -> Schema:
    """Bounds and default over the unit; a range, or one number."""
    found = dict(schema)
    for key in (*_BOUNDS, "default"):
        if key in found:
            found[key] = float(f"{found[key] / factor:.15g}")
    if dimension.is_range or dimension.is_list:
        ends = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
        if dimension.is_list:
            ends = _AXIS
        told = {"description": schema["description"]} if "description" in schema else {}
        return {**told, "anyOf": [{"type": "number"}, ends]}
    return found


def _with_file(kind: type[Section], schema: Schema) -> Schema:
    """The numbers, or a file of them."""
    told = f"CSV beside this file, in the place of the numbers: columns {_FILES[kind]}"
    properties = {**schema["properties"], "file": {"type": "string", "description": told}}
    if kind is not TableSection:  # its numbers are optional: another model has none
        return {**schema, "properties": properties}
    numbers = [name for name in schema["required"] if name != "model"]
    inline = {"required": numbers, "allOf": schema.get("allOf", [])}
    rest = {key: value for key, value in schema.items() if key not in ("required", "allOf")}
    return {
        **rest,
        "properties": properties,
        "required": ["model"],
        "anyOf": [{"required": ["file"]}, inline],
    }


def _grid(schema: Schema) -> Schema:
    """Axes by key: those of the entry by name, the others by their paths, dotted or in tables."""
    fields: dict[str, FieldInfo] = dict(EntrySection.model_fields)
    axes: Schema = {}
    for name in ENTRY_STATES:
        dimension = dimension_of(fields[name])
        for unit in UNITS[dimension.name] if dimension else ():
            axes[f"{name}_{unit}"] = {**_AXIS, "description": fields[name].description}
    below = {"type": "object", "additionalProperties": {"anyOf": [_AXIS, {"type": "object"}]}}
    return {
        "title": schema["title"],
        "type": "object",
        "properties": axes,
        "additionalProperties": {"anyOf": [_AXIS, below]},
    }
