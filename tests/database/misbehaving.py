"""Optimisers that sleep, hang or kill their process, for workers to import."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import database
from ampi.dataset import read_dataset
from ampi.missions.loading import load_mission
from ampi.missions.mission import Mission
from ampi.trajectory import Status, Trajectory
from database.factory.jobs import Job, Kept
from database.factory.stand_in import neighbour_moved


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


def dawdles(mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
    """Where `hangs_in_native_code` would never end; it is over when no alarm comes."""
    if _fast(mission) and _one_step(mission, guess):
        time.sleep(10.0)
    return moved(mission, guess)


def stopped_once(mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
    """As an operator would stop the process, for longer than its time limit."""
    stop = Path(os.environ["AMPI_TEST_GATE"]) / "stop"
    if _fast(mission) and stop.exists():
        stop.unlink()
        again = f"sleep 2; kill -CONT {os.getpid()}"
        subprocess.Popen(["sh", "-c", again], start_new_session=True)
        os.kill(os.getpid(), signal.SIGSTOP)
        time.sleep(0.1)  # the alarm is due
    return moved(mission, guess)


def hangs_with_a_child(mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
    """Whoever waits until the child has ended by itself finds its mark."""
    if _fast(mission):
        if os.fork() == 0:  # with all that its parent has open
            time.sleep(10.0)
            (Path(os.environ["AMPI_TEST_GATE"]) / "grown up").touch()
            os._exit(0)
        time.sleep(3600.0)
    return moved(mission, guess)


def gated(mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
    """At greater speeds and of the lighter vehicle alone: waits until somebody says go."""
    gate = Path(os.environ["AMPI_TEST_GATE"])
    if _fast(mission) and mission.vehicle.mass < load_mission("shefex3").vehicle.mass:
        (gate / "waiting").touch()
        while not (gate / "go").exists():
            time.sleep(0.01)
    return neighbour_moved(mission, guess=guess)


def always_hangs(mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
    if _fast(mission):
        time.sleep(3600.0)
    return moved(mission, guess)


def crashes(mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
    if _fast(mission):
        os.kill(os.getpid(), signal.SIGSEGV)
    return moved(mission, guess)


def misses(mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
    """The target, at greater speeds."""
    status = Status.TARGET_MISSED if _fast(mission) else Status.SOLVED
    return replace(moved(mission, guess), status=status)


def roundabout(mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
    """At greater speeds: steep entries from anywhere, others from the next steeper at the same speed."""
    found = moved(mission, guess)
    steeper = mission.entry_state[4] - load_mission("shefex3").entry.flight_path_angle
    if not _fast(mission) or steeper < -1e-6:
        return found
    step = np.zeros(6) if guess is None else mission.entry_state - guess.states[:6, 0]
    beside = abs(step[3]) < 1e-6 and step[4] > 1e-6
    return found if beside else replace(found, status=Status.STALLED)


@dataclass(frozen=True)
class Marking(Job):
    """Leaves a mark in a folder at every turn; waits or dies where it is told to."""

    folder: Path
    name: str
    flush_waits_for: str = ""
    deaths: int = 0  # at its first turns, while it computes
    announces: bool = False  # an attempt, before it dies
    dies_flushing: bool = False  # always

    @property
    def result(self) -> Path:
        return self.folder / self.name

    def evidence(self, kept: Kept) -> Path:
        return self.result

    def compute(self, announce: Callable[[int], None]) -> Future[Kept]:
        turns = len(list(self.folder.glob(f"{self.name} *")))
        (self.folder / f"{self.name} {turns} by {os.getpid()}").touch()
        if self.announces:
            announce(0)
        if turns < self.deaths:
            os.kill(os.getpid(), signal.SIGKILL)
        return ThreadPoolExecutor(1).submit(self._flush)

    def _flush(self) -> Kept:
        if self.dies_flushing:
            time.sleep(0.2)  # until the supervisor knows that this is all that is left
            os.kill(os.getpid(), signal.SIGKILL)
        while self.flush_waits_for and not list(self.folder.glob(f"{self.flush_waits_for} *")):
            time.sleep(0.01)
        self.result.touch()
        return ()

    def without(self, attempt: int) -> Marking:
        raise AssertionError

    def give_up(self, reason: str) -> Kept:
        self.result.write_text(reason)
        return ()


def main() -> None:
    """build MISSION PATH with the solver named by the third argument, or with the real one."""
    mission, path, *solver = sys.argv[1:]
    options = {"solver": globals()[solver[0]]} if solver else {}
    database.build(load_mission(mission), path, n_jobs=2, **options)
