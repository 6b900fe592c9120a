"""An optimiser's stand-in: the output of a real one, without its work.

It measures what a build costs besides optimising: planning, processes, records, blocks, the file. It
solves the nominal problem; every other trajectory is its neighbour's, moved to its own entry state and
roughened in the last digits, so that the output is of the same size, compresses no better than optima
do, and keeps re-integration as busy. It is no optimum: a database made with it says so in its attribute
`solver`, and must not fly.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ampi.missions.mission import Mission
from ampi.scp.solve import solve
from ampi.trajectory import Statistics, Status, Trajectory

ROUGHNESS = 1e-9  # relative


def neighbour_moved(mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
    """The guess from the mission's entry state; the difference fades towards the target."""
    if guess is None:
        return solve(mission)
    fading = np.linspace(1.0, 0.0, guess.states.shape[1]) ** 2
    rng = np.random.default_rng(np.frombuffer(mission.entry_state.tobytes(), np.uint32))
    states = guess.states * (1.0 + ROUGHNESS * rng.standard_normal(guess.states.shape))
    states[:6] += np.outer(mission.entry_state - states[:6, 0], fading)
    states[:6, 0] = mission.entry_state
    bank_rate, *others = (
        rate * (1.0 + ROUGHNESS * rng.standard_normal(len(fading))) for rate in guess.controls
    )
    return replace(
        guess,
        states=states,
        bank_rate=bank_rate,
        angle_of_attack_rate=others[0] if others else None,
        status=Status.SOLVED,
        statistics=Statistics(iterations=1),
    )
