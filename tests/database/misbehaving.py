"""Optimisers that sleep, hang or kill their process, for workers to import."""

from __future__ import annotations

import os
import signal
import sys
import time

import database
from ampi.dataset import read_dataset
from ampi.missions.mission import Mission, load_mission
from ampi.trajectory import Trajectory
from database.stand_in import neighbour_moved


def moved(mission: Mission, guess: Trajectory | None) -> Trajectory:
    """The stand-in, spared the nominal solve: no honest call comes near a time limit of 1 s."""
    if guess is None:
        guess = read_dataset(os.environ["AMPI_TEST_DATABASE"]).trajectory(4)
    return neighbour_moved(mission, guess=guess)


def slow(mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
    time.sleep(0.02)
    return moved(mission, guess)


def _fast(mission: Mission) -> bool:
    return mission.entry_state[3] > load_mission("shefex3").entry.speed + 1.0


def _one_step(mission: Mission, guess: Trajectory | None) -> bool:
    """Whether the guess lies a whole grid step away in speed, and not a part of one."""
    return guess is not None and abs(guess.states[3, 0] - mission.entry_state[3]) > 69.0


def hangs_in_native_code(mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
    """At greater speeds, and in one step of speed only; the interpreter never gets a word in."""
    if _fast(mission) and _one_step(mission, guess):
        pow(3, 10**9)  # holds the interpreter's lock for hours
    return moved(mission, guess)


def always_hangs(mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
    if _fast(mission):
        time.sleep(3600.0)
    return moved(mission, guess)


def crashes(mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
    if _fast(mission):
        os.kill(os.getpid(), signal.SIGSEGV)
    return moved(mission, guess)


def main() -> None:
    """build MISSION PATH with the solver named by the third argument, or with the real one."""
    mission, path, *solver = sys.argv[1:]
    options = {"solver": globals()[solver[0]]} if solver else {}
    database.build(load_mission(mission), path, n_jobs=2, **options)
