"""A mission: planet, vehicle, boundary conditions, limits, objective, mesh and parameter grid."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import ValidationError, model_validator

from ampi.missions.agreement import another_structure, disagreements
from ampi.missions.family import MissionFamily
from ampi.missions.grid import GridSection
from ampi.missions.parameters import Parameter, Path, parameter_values, resolve, with_numbers
from ampi.missions.sections import MODEL_SECTIONS, MeshSection, MissionError, MissionSections
from ampi.missions.text import toml_text
from ampi.missions.units import sentences
from ampi.physics.state import ENTRY_STATES
from ampi.pseudospectral.mesh import Mesh
from ampi.shown import Shown


class Mission(MissionSections, Shown):
    """A whole mission, frozen. Everything in SI and radians; load one with `load_mission`."""

    @model_validator(mode="after")
    def _parts_fit(self) -> Mission:
        faults = disagreements(self)
        try:
            _ = self.parameters
        except ValueError as error:
            faults.append(str(error))
        faults = faults or self._grid_faults()
        if faults:
            raise ValueError("\n".join(faults))
        _ = (
            self.pseudospectral_mesh
        )  # made once, for this mission and for all that are moved from it
        return self

    def _grid_faults(self) -> list[str]:
        """A sentence for every axis with a point where the mission could not be."""
        found = []
        for parameter in self.parameters:
            number, sentence = parameter.number, None
            if np.any(np.diff(parameter.axis) <= 0):
                sentence = (
                    f"expected offsets that differ beside the nominal value, "
                    f"{number.nominal / number.per_unit:.9g}; got {list(parameter.offsets)}, of which "
                    "some are lost in its rounding"
                )
            for offset in (o for o in parameter.offsets if o != 0.0 and sentence is None):
                there = with_numbers(
                    self, [(number.path, number.nominal + offset * number.per_unit)]
                )
                faults = number.faults(there)
                faults = faults or disagreements(there) or another_structure(self, there)
                if faults:
                    sentence = f"at offset {offset:g}: {faults[0]}"
            if sentence is not None:
                found.append(f"grid.{parameter.key}: {sentence}")
        return found

    @cached_property
    def toml(self) -> str:
        """Its text, from which `parse_mission` makes the same mission, to the bit."""
        return toml_text(self.as_written())

    @cached_property
    def digest(self) -> str:
        """SHA-256 of its text: what a database and its flights belong to."""
        return hashlib.sha256(self.toml.encode()).hexdigest()

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """What the grid disperses: the d numbers of p, entry states first."""
        return resolve(self, dict(self.grid.offsets))

    @property
    def grid_axes(self) -> tuple[NDArray[np.float64], ...]:
        """Values (not offsets; SI, rad) along each axis of the parameter space."""
        return tuple(parameter.axis for parameter in self.parameters)

    @property
    def nominal_parameters(self) -> NDArray[np.float64]:
        """The nominal p (d,), SI and radians."""
        return np.array([parameter.number.nominal for parameter in self.parameters])

    def with_parameters(self, values: ArrayLike) -> Mission:
        """The same mission at another p (d,), SI and radians, in the order of `parameters`.

        Its numbers are not checked: they may stem from a measurement.
        """
        given = parameter_values(self.parameters, values)
        return with_numbers(self, zip(self._parameter_paths, given.tolist(), strict=True))

    def family(self, values: ArrayLike) -> MissionFamily[Mission]:
        """The mission at n vectors p (n, d), of any numbers whatever, for what works on many."""
        rows, paths = np.asarray(values, dtype=float), self._parameter_paths
        if rows.ndim != 2 or rows.shape[1] != len(paths):
            raise ValueError(f"values: expected shape (n, {len(paths)}), got {rows.shape}")
        return MissionFamily(self, paths, rows)

    @property
    def _parameter_paths(self) -> tuple[Path, ...]:
        return tuple(parameter.number.path for parameter in self.parameters)

    def with_entry(
        self,
        entry_state: ArrayLike,
        *,
        time: float = 0.0,
        bank_angle: float | None = None,
        bank_rate: float | None = None,
    ) -> Mission:
        """The same mission from another entry state (h, θ, φ, V, γ, ψ; m, rad, m/s), measured or not.

        A flight that is under way is there at `time` (s) since the entry interface, with a `bank_angle`
        (rad) and a `bank_rate` (rad/s) that are given; None leaves them free.
        """
        values = np.asarray(entry_state, dtype=float)
        if values.shape != (6,) or not np.all(np.isfinite(values)):
            raise ValueError(f"entry_state: expected 6 finite numbers {ENTRY_STATES}, got {values}")
        state = dict(zip(ENTRY_STATES, values.tolist(), strict=True))
        state |= {"time": float(time), "bank_angle": bank_angle, "bank_rate": bank_rate}
        return self.model_copy(update={"entry": self.entry.model_copy(update=state)})

    def with_mesh(self, mesh: Mesh) -> Mission:
        """The same mission on another pseudospectral mesh."""
        copied = self.model_copy(update={"mesh": MeshSection.of(mesh)})
        copied.__dict__["pseudospectral_mesh"] = mesh
        return copied

    def with_grid(self, offsets: Mapping[str, Sequence[float]]) -> Mission:
        """The same mission with another grid: offsets by key, in the unit of the key.

        Raises
        ------
        MissionError
            If an axis does not increase, has no nominal value or names no number of the mission.
        """
        try:
            grid = GridSection.model_validate(dict(offsets))
        except ValidationError as error:
            found = [line for fault in error.errors() for line in sentences(fault, {})]
            raise MissionError(f"{self.name}: grid: {'; '.join(found)}") from None
        return self.model_copy(update={"grid": grid}).checked()

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with other sections, unchecked; it keeps what it has derived of the others."""
        copied = super().model_copy(update=update, deep=deep)
        for derived, sections in DERIVED.items():
            alike = all(getattr(copied, name) is getattr(self, name) for name in sections)
            if derived in self.__dict__ and alike:
                copied.__dict__[derived] = self.__dict__[derived]
        mesh = self.__dict__.get("pseudospectral_mesh")
        time = getattr(copied.entry, "time", None)  # unchecked: it may be no section
        if mesh is not None and copied.mesh is self.mesh and time == self.entry.time:
            copied.__dict__["pseudospectral_mesh"] = mesh
        return copied


DERIVED = {  # what a mission may keep where these sections stay
    "flight_model": MODEL_SECTIONS,
    "parameters": tuple(name for name in Mission.model_fields if name != "mesh"),
}
