"""The closed loop in the compiled engine: what `closed_loop.fly_batch` does, in C.

The engine flies `LANES` flights abreast, each as if it were alone. Python prepares the entries, draws the
noise of the sensors, a block of samples at a time, and reads the records. Between two blocks it can be
interrupted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi._native.engine import core
from ampi.guidance import Guidance
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.physics.state import N_STATES
from ampi.simulation.closed_loop import Entries, FlightBatch, Rhythm, saturated_from
from ampi.simulation.native_program import native_plant
from ampi.simulation.plant import ANGLE, PLANT, RATE, InFlight
from ampi.simulation.sensors import BLOCK, NAVIGATED, SENSED
from ampi.simulation.truth import Truth

Array = NDArray[np.float64]


def fly_batch(
    family: MissionFamily[Mission],
    guidance: Guidance,
    truth: Truth,
    record_every: float = 5.0,
    instruction_set: str = "",
) -> FlightBatch:
    """Fly each mission of `family` in closed loop, as `closed_loop.fly_batch`, in the engine.

    `instruction_set` is the best of this processor, or one by its name; they give the same bits.
    """
    rhythm = Rhythm.of(guidance.cycle, record_every)
    with np.errstate(all="ignore"):  # an absurd entry is a record with a status, not a warning
        entries = Entries.of(family, guidance, truth)
        code = core().Guidance(guidance.blob, len(truth))
        code.begin(entries.parameters)
        fixed = _fixed(entries, guidance, truth)
        blocks = [
            _Block(entries, code, fixed, rhythm, slice(first, first + core().LANES))
            for first in range(0, len(truth), core().LANES)
        ]
        records = [block.flown(instruction_set) for block in blocks]
    return None


def _rows(table: dict[str, tuple[int, int]], name: str) -> slice:
    first, count = table[name]
    return slice(first, first + count)
