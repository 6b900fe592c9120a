"""Sobol indices of the miss over all that a world draws: the flights of a design, and their indices."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from typing import Any

import numpy as np

from ampi.missions.mission import Mission
from ampi.simulation.batches import MODULE, Batch
from ampi.simulation.estimates.sensitivity import SobolIndices, sobol_design, sobol_from
from ampi.simulation.monte_carlo import BATCH, DEFAULTS, Scheme
from ampi.workers.in_order import in_workers

NO_HISTORY = 1e9  # s between recorded points: one will do, histories are not looked at


def fly_sobol(
    mission: Mission,
    scheme: Scheme,
    n: int = 64,
    *,
    seed: int = 2016,
    cycle: float = DEFAULTS["cycle"],
    n_jobs: int = 2,
    client: Any = None,
    advance: Callable[[int], None] | None = None,
) -> SobolIndices:
    """Fly n (m + 2) entries for the m inputs of the world, and read the indices of ln miss.

    `n` is a power of 2. The design has a stream of its own: no flight of a campaign is in it. `advance`
    is called with the number of flights just flown; the other options are those of `CampaignOptions`.
    """
    world = scheme.loaded_world.checked(mission)
    guidance = scheme.guidance.at_cycle(cycle)
    design = sobol_design(n, world.inputs(mission), seed)
    count = len(design.uniforms)

    def job(first: int) -> Batch:
        truth = world.truth(mission, design.uniforms[first : first + BATCH])
        return Batch(mission, guidance, truth, NO_HISTORY, f"design from {first}", 0, None)

    misses = []
    jobs = (job(first) for first in range(0, count, BATCH))
    with closing(in_workers(MODULE, jobs, n_jobs, client)) as results:
        for batch in results:
            misses.append(np.where(batch["status"] == 0, batch["miss"], np.inf))
            if advance is not None:
                advance(len(batch["status"]))
    return sobol_from(design, np.concatenate(misses), seed=seed)


def flights_of_design(mission: Mission, scheme: Scheme, n: int) -> int:
    """How many flights `fly_sobol` flies."""
    return n * (scheme.loaded_world.dimension(mission) + 2)
