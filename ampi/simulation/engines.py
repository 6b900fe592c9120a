"""Which engine flies a batch: numpy, or the compiled one. They agree.

Where numpy takes sines and exponentials from the C library, as it does without AVX-512, the plant has
the same bits in both: every operation is repeated in its order (tracing/value_graph.py).
"""

from __future__ import annotations

from ampi.guidance import NATIVE, Guidance
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.simulation import closed_loop, native_loop
from ampi.simulation.closed_loop import FlightBatch, Observer
from ampi.simulation.truth import Truth


def fly_batch(
    family: MissionFamily[Mission],
    guidance: Guidance,
    truth: Truth,
    record_every: float = 5.0,
    *,
    observer: Observer | None = None,
) -> FlightBatch:
    """As `closed_loop.fly_batch`, by the engine of `guidance`."""
    loop = native_loop if guidance.engine == NATIVE else closed_loop
    return loop.fly_batch(family, guidance, truth, record_every, observer=observer)
