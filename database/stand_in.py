"""An optimiser's stand-in: the output of a real one, without its work.

It measures what a build costs besides optimising: planning, processes, records, blocks, the file. It
solves the nominal problem; every other trajectory is its neighbour's, moved to its own entry state, so
the output is of the same size and compresses no better, and re-integration does all of its work. It is
no optimum, and a database made with it must not fly.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ampi.missions.mission import Mission
from ampi.scp.solve import solve
from ampi.trajectory import Statistics, Status, Trajectory


def neighbour_moved(mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
    """The guess from the mission's entry state; the difference fades towards the target."""
    if guess is None:
        return solve(mission)
    fading = np.linspace(1.0, 0.0, guess.states.shape[1]) ** 2
    states = guess.states.copy()
    states[:6] += np.outer(mission.entry_state - states[:6, 0], fading)
    states[:6, 0] = mission.entry_state
    return replace(guess, states=states, status=Status.SOLVED, statistics=Statistics(iterations=1))
