"""Functional mock-up units flown by FMPy, of either standard by the same calls."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
TOLD, REAL_OUTPUTS, ENUMERATIONS, PARAMETERS = range(1, 12), range(12, 15), range(15, 17), 17


class Unit:
    """One instance, from an archive."""

    def __init__(
        self,
        path: Path,
        folder: Path,
        name: str,
        *,
        token: str | None = None,
        damage: Callable[[bytes], bytes] = lambda blob: blob,
    ) -> None:
        import fmpy
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        described = fmpy.read_model_description(str(path))
        self.version = described.fmiMajorVersion
        # of its own, a library that is loaded must stay; 2.0 tells the space and the % as a URI
        own = fmpy.extract(str(path), tempfile.mkdtemp(prefix=f"{name} 50%", dir=folder))
        table = Path(own) / "resources" / "ampi_table.bin"
        table.write_bytes(damage(table.read_bytes()))
        self.fmu: Any = (FMU3Slave if self.version == 3 else FMU2Slave)(
            guid=token or described.guid,
            unzipDirectory=own,
            modelIdentifier=described.modelIdentifier,
            instanceName=name,
        )
        self.n_parameters = len(self.variables(path, "parameter"))
        self.fmu.instantiate()

    @staticmethod
    def variables(path: Path, causality: str) -> list[Any]:
        """Of the model description."""
        import fmpy

        found = fmpy.read_model_description(str(path)).modelVariables
        return [variable for variable in found if variable.causality == causality]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.fmu.freeInstance()

    def get_real(self, references: Any) -> list[float]:
        get = self.fmu.getFloat64 if self.version == 3 else self.fmu.getReal
        return [float(value) for value in get(references)]

    def set_real(self, references: Any, values: Any) -> None:
        (self.fmu.setFloat64 if self.version == 3 else self.fmu.setReal)(references, values)

    def parameters(self) -> list[float]:
        return self.get_real(range(PARAMETERS, PARAMETERS + self.n_parameters))

    def set_parameters(self, p: Array) -> None:
        self.set_real(range(PARAMETERS, PARAMETERS + len(p)), p.tolist())

    def begin(self, p: Array) -> None:
        """Through initialization, with p set."""
        self.set_parameters(p)
        if self.version == 2:
            self.fmu.setupExperiment()
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def step(self, time: float, cycle: float) -> None:
        self.fmu.doStep(time, cycle)

    def command(self) -> list[float]:
        get = self.fmu.getInt64 if self.version == 3 else self.fmu.getInteger
        return [*self.get_real(REAL_OUTPUTS), *get(ENUMERATIONS)]

    def flown(self, times: Array, told: Array, cycle: float) -> Array:
        """Commands (n, 5) at `times` (n,), told (11, n)."""
        commands = []
        for time, inputs in zip(times.tolist(), told.T.tolist(), strict=True):
            self.set_real(TOLD, inputs)
            self.step(time, cycle)
            commands.append(self.command())
        return np.array(commands)

    def get_state(self) -> Any:
        return self.fmu.getFMUState() if self.version == 3 else self.fmu.getFMUstate()

    def set_state(self, state: Any) -> None:
        (self.fmu.setFMUState if self.version == 3 else self.fmu.setFMUstate)(state)

    def free_state(self, state: Any) -> None:
        (self.fmu.freeFMUState if self.version == 3 else self.fmu.freeFMUstate)(state)
