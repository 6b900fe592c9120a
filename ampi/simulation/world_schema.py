"""The JSON schema of a world file: its own sections, and a table for each section of the catalogue."""

from __future__ import annotations

from typing import Any

from pydantic_core import core_schema

from ampi.missions.json_schema import DRAFT_7, Schema, SectionsSchema, without_null
from ampi.simulation.uncertainties import CATALOGUE, SECTIONS, Uncertainty
from ampi.simulation.world_sections import WITH_PROFILE, WorldSections


def world_schema() -> Schema:
    """Of a world file."""
    found = WorldSections.model_json_schema(schema_generator=_WorldSchema)
    return {"$schema": DRAFT_7, **found, "title": "ampi world"}


class _WorldSchema(SectionsSchema):
    """Laws and profiles in the tables of the file that they stand in."""

    def model_schema(self, schema: core_schema.ModelSchema) -> Schema:
        """Of one section."""
        found = super().model_schema(schema)
        if not issubclass(schema["cls"], WorldSections):
            return found
        properties = dict(found["properties"])
        law = properties.pop("laws")["additionalProperties"]["additionalProperties"]
        del properties["profiles"]
        for section in SECTIONS:
            properties[section] = _table(section, law)
        return {**found, "properties": properties}

    def function_before_schema(self, schema: core_schema.BeforeValidatorFunctionSchema) -> Schema:
        """A law may be a plain number: the constant that it is."""
        found = super().function_before_schema(schema)
        if "discriminator" not in found:
            return found
        laws = {key: value for key, value in found.items() if key != "discriminator"}
        return {"anyOf": [{"type": "number"}, laws]}


def _table(section: str, law: Any) -> Schema:
    """The keys of a section of the catalogue, each a law."""
    keys: Schema = {}
    for uncertainty in (one for one in CATALOGUE if one.section == section):
        for key in uncertainty.keys:
            keys[key] = {**without_null(law), "description": told_of(uncertainty)}
    if section in WITH_PROFILE:
        keys["table"] = {"type": "string", "description": "CSV of a profile over altitude"}
    return {"type": "object", "properties": keys, "additionalProperties": False}


def told_of(uncertainty: Uncertainty) -> str:
    """Meaning, unit, bounds and nominal number of an uncertainty."""
    meaning = uncertainty.meaning[0].upper() + uncertainty.meaning[1:]
    unit = "" if uncertainty.dimension is None else f" {uncertainty.unit}"
    bounds = f"; {uncertainty.bounds}" if uncertainty.bounds else ""
    return f"{meaning}{bounds}; nominal {uncertainty.nominal:g}{unit}."
