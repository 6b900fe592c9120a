"""What a functional mock-up unit of the guidance tells a simulator: FMI's modelDescription.xml.

Inputs are what navigation and accelerometers tell at the begin of a cycle, parameters what was measured
before the flight, outputs the command, what it steers by, and its health. A step from t to t + h is one
guidance cycle at t with the inputs that are set; the outputs then are to be reached at t + h, and depend
on no input of that instant: no algebraic loop. Before the first step they are the reference's own.

Value references are those of fmi/fmu.h.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.clock import NOMINAL_CYCLE
from ampi.onboard.health import Health, Steering
from ampi.onboard.row_layout import BANK_RATE, STATES
from ampi.onboard.table import GuidanceTable
from ampi.outcome import Outcome
from ampi.release import RELEASE

Array = NDArray[np.float64]
Version = Literal[2, 3]

# exponents of the SI base units; what is not here is told without a unit
UNITS: dict[str, dict[str, float]] = {
    "m": {"m": 1},
    "rad": {"rad": 1},
    "m/s": {"m": 1, "s": -1},
    "s": {"s": 1},
    "kg": {"kg": 1},
    "m2": {"m": 2},
    "rad/s": {"rad": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "rad/s2": {"rad": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "W/m2": {"kg": 1, "s": -3},
    "g": {"m": 1, "s": -2, "factor": 9.80665},
    "1/rad2": {"rad": -2},
    "1/m2": {"m": -2},
    "1/m2_s2": {"m": -2, "s": 2},
}
SENSED = ("along_velocity", "up", "right")
ENUMERATIONS: dict[str, type[Outcome]] = {"Steering": Steering, "Health": Health}


@dataclass(frozen=True)
class Measured:
    """A parameter p of the table: what an unsuspecting simulator sees of it."""

    name: str
    unit: str  # SI, of `UNITS`; anything else is dimensionless


@dataclass(frozen=True, eq=False)
class FmuModel:
    """What is described: a guidance table by the names of its parameters.

    Raises
    ------
    ValueError
        If there is not one different name for each axis of the table, or the model has no name.
    """

    name: str
    table: GuidanceTable
    parameters: tuple[Measured, ...]  # d, in the table's order
    cycle: float = NOMINAL_CYCLE  # s, proposed as communication step

    def __post_init__(self) -> None:
        names = {parameter.name for parameter in self.parameters}
        if len(names) != len(self.parameters) or len(names) != len(self.table.axes):
            raise ValueError(
                f"parameters: expected {len(self.table.axes)} different names, one for each axis of "
                f"the table, got {', '.join(p.name for p in self.parameters) or 'none'}"
            )
        if not any(character.isalnum() for character in self.name):
            raise ValueError(f"name: expected letters or digits, got {self.name!r}")

    @property
    def identifier(self) -> str:
        """The name of the binary: a C identifier."""
        own = "".join(c if c.isascii() and c.isalnum() else "_" for c in self.name)
        return f"ampi_{own}"

    @property
    def start(self) -> Array:
        """Of every value reference, those that are calculated zero: of fmi/fmu.h, FMU_START.

        Navigation is where the nominal reference begins; nothing is sensed.
        """
        begin = self.table.values[self.table.centre][..., 0]
        states = [*begin[self.table.layout.states], begin[self.table.layout.bank_rate]]
        nominal = [axis[i] for axis, i in zip(self.table.axes, self.table.centre, strict=True)]
        return np.array([0.0, *states, *[0.0] * len(SENSED), *[0.0] * 5, *nominal])


@dataclass(frozen=True)
class Variable:
    """One variable; its place in the list is its value reference."""

    name: str
    causality: str
    variability: str
    description: str
    unit: str | None = None
    start: float | None = None
    enumeration: str | None = None


def variables(model: FmuModel) -> list[Variable]:
    """All, in order of their value references."""
    start = model.start.tolist()
    found = [Variable("time", "independent", "continuous", "since the entry interface", "s")]
    for name, unit in [*((row.name, row.unit) for row in STATES), ("bank_rate", BANK_RATE.unit)]:
        told = "navigated at the begin of a cycle"
        found.append(_input(f"navigation.{name}", unit, told, start[len(found)]))
    for name in SENSED:
        force = f"sensed specific force, {name.replace('_', ' ')}; all zero: none is felt"
        found.append(_input(f"sensed.{name}", "m/s2", force, start[len(found)]))
    for name, unit, description in (
        ("bank_rate", "rad/s", "to be reached at the end of the cycle"),
        ("bank_angle", "rad", "to be reached at the end of the cycle"),
        ("angle_of_attack", "rad", "to be added to the schedule's; itself, where there is none"),
    ):
        found.append(Variable(f"command.{name}", "output", "discrete", description, unit))
    for name, description in (
        ("Steering", "by what the command steers: the mode"),
        ("Health", "of several that apply the greatest"),
    ):
        found.append(Variable(name.lower(), "output", "discrete", description, enumeration=name))
    for parameter, axis in zip(model.parameters, model.table.axes, strict=True):
        name = f"parameter.{parameter.name}"
        reach = f"measured before the flight; the table reaches from {axis[0]!s} to {axis[-1]!s}"
        known = parameter.unit if parameter.unit in UNITS else None
        found.append(Variable(name, "parameter", "fixed", reach, known, start[len(found)]))
    return found


def _input(name: str, unit: str, description: str, start: float) -> Variable:
    return Variable(name, "input", "continuous", description, unit, start)


def model_description(
    model: FmuModel, version: Version, *, token: str, sources: Sequence[str]
) -> bytes:
    """modelDescription.xml, UTF-8; `sources` are the C files to be compiled."""
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{version}.0",
            "modelName": model.name,
            "guid" if version == 2 else "instantiationToken": token,
            "description": "Entry guidance: each communication step is one guidance cycle.",
            "generationTool": f"ampi {RELEASE}",
        },
    )
    state = "canGetAndSetFMUstate" if version == 2 else "canGetAndSetFMUState"
    able = {"modelIdentifier": model.identifier, state: "true"}
    able["canHandleVariableCommunicationStepSize"] = "true"
    if version == 2:
        able["canNotUseMemoryManagementFunctions"] = "true"
    interface = ET.SubElement(root, "CoSimulation", able)
    if version == 2:
        files = ET.SubElement(interface, "SourceFiles")
        for name in sources:
            ET.SubElement(files, "File", name=name)
    all_variables = variables(model)
    _units(root, all_variables)
    _types(root, version)
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="why a call failed")
    end = float(model.table.final_time[model.table.centre])
    experiment = {"startTime": "0.0", "stopTime": repr(end), "stepSize": repr(float(model.cycle))}
    ET.SubElement(root, "DefaultExperiment", experiment)
    (_variables_2 if version == 2 else _variables_3)(root, all_variables)
    (_structure_2 if version == 2 else _structure_3)(root, all_variables)
    return document(root)


def document(root: ET.Element) -> bytes:
    """The text of a tree."""
    ET.indent(root)
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _units(root: ET.Element, all_variables: list[Variable]) -> None:
    definitions = ET.SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(v.unit for v in all_variables if v.unit is not None):
        unit = ET.SubElement(definitions, "Unit", name=name)
        ET.SubElement(unit, "BaseUnit", {key: str(value) for key, value in UNITS[name].items()})


def _types(root: ET.Element, version: Version) -> None:
    definitions = ET.SubElement(root, "TypeDefinitions")
    for name, outcomes in ENUMERATIONS.items():
        if version == 2:
            items = ET.SubElement(
                ET.SubElement(definitions, "SimpleType", name=name), "Enumeration"
            )
        else:
            items = ET.SubElement(definitions, "EnumerationType", name=name)
        for outcome in outcomes:
            item = {"name": outcome.name, "value": f"{outcome:d}", "description": outcome.sentence}
            ET.SubElement(items, "Item", item)


def _common(i: int, variable: Variable) -> dict[str, str]:
    return {
        "name": variable.name,
        "valueReference": str(i),
        "description": variable.description,
        "causality": variable.causality,
        "variability": variable.variability,
    }


def _of_its_type(variable: Variable) -> dict[str, str]:
    if variable.enumeration is not None:
        return {"declaredType": variable.enumeration}
    unit = {} if variable.unit is None else {"unit": variable.unit}
    return unit if variable.start is None else {**unit, "start": repr(variable.start)}


def _variables_2(root: ET.Element, all_variables: list[Variable]) -> None:
    parent = ET.SubElement(root, "ModelVariables")
    for i, variable in enumerate(all_variables):
        scalar = ET.SubElement(parent, "ScalarVariable", _common(i, variable))
        kind = "Real" if variable.enumeration is None else "Enumeration"
        ET.SubElement(scalar, kind, _of_its_type(variable))


def _variables_3(root: ET.Element, all_variables: list[Variable]) -> None:
    parent = ET.SubElement(root, "ModelVariables")
    for i, variable in enumerate(all_variables):
        kind = "Float64" if variable.enumeration is None else "Enumeration"
        ET.SubElement(parent, kind, {**_common(i, variable), **_of_its_type(variable)})


def _places(all_variables: list[Variable], causality: str) -> list[int]:
    return [i for i, variable in enumerate(all_variables) if variable.causality == causality]


def _structure_2(root: ET.Element, all_variables: list[Variable]) -> None:
    """Here a variable is told by its place, from one."""
    structure = ET.SubElement(root, "ModelStructure")
    parameters = " ".join(str(i + 1) for i in _places(all_variables, "parameter"))
    for kind, dependencies in (("Outputs", ""), ("InitialUnknowns", parameters)):
        parent = ET.SubElement(structure, kind)
        for i in _places(all_variables, "output"):
            ET.SubElement(parent, "Unknown", index=str(i + 1), dependencies=dependencies)


def _structure_3(root: ET.Element, all_variables: list[Variable]) -> None:
    structure = ET.SubElement(root, "ModelStructure")
    parameters = " ".join(map(str, _places(all_variables, "parameter")))
    for kind, dependencies in (("Output", ""), ("InitialUnknown", parameters)):
        for i in _places(all_variables, "output"):
            ET.SubElement(structure, kind, valueReference=str(i), dependencies=dependencies)
