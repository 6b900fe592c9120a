"""One flight whose plan is corrected, told correction by correction, beside what was true.

The flight is that of its campaign, to the bit: it is observed, and nothing of it is changed. What is
true of an estimate is on the model's air at the altitude that navigation tells (estimate_truth.py).
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from ampi.correction.corrector import CorrectionOutcome
from ampi.correction.plan import Plans
from ampi.correction.settings import N_ANGLES, N_BANKS
from ampi.correction.state import CorrectionState
from ampi.estimation.estimate import ESTIMATED
from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.outputs import written
from ampi.physics.state import ALTITUDE
from ampi.simulation.estimate_truth import EstimateCourse, true_estimate
from ampi.simulation.flights import Flights
from ampi.simulation.monte_carlo import CampaignOptions, Scheme, fly_one
from ampi.simulation.true_model import true_model

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

POSITION, EXCESS = slice(0, 3), slice(3, 6)  # of what is predicted to be missed
DEVIATIONS = 3.0
UNITS = dict(zip(ESTIMATED, ("", "", "", "_m_per_s", "_m_per_s", "_rad"), strict=True))
COLUMNS = (
    "time_s",
    "outcome",
    "reason",
    "iterations",
    "propagations",
    "predicted_miss_east_m",
    "predicted_miss_north_m",
    "predicted_miss_up_m",
    "least_margin_over_limit",
    "time_to_go_s",
    "first_equivalent_speed_m_per_s",
    "last_equivalent_speed_m_per_s",
    *(f"bank_angle_{i}_rad" for i in range(N_BANKS)),
    *(f"angle_of_attack_change_{i}_rad" for i in range(N_ANGLES)),
    *(
        f"{name}_{what}{UNITS[name]}"
        for name in ESTIMATED
        for what in ("estimate", "3_sigma", "truth")
    ),
)


@dataclass(frozen=True, eq=False, kw_only=True)
class CorrectionLog:
    """The k corrections of one flight, in order."""

    flight: Flights  # a campaign of one
    times: Array  # (k,), s since the entry interface
    outcome: Counts  # (k,), CorrectionOutcome
    iterations: Counts  # (k,)
    propagations: Counts  # (k,), flights that were predicted
    miss: Array  # (k, 3), m: east, north and up of the target, as predicted
    margin: (
        Array  # (k,), least of the path limits, over the limit; at most what plans are to keep free
    )
    to_go: Array  # (k,), s, as predicted
    plans: Plans  # k of them, as flown from then on
    estimates: EstimateCourse  # k of them

    def __len__(self) -> int:
        return len(self.times)


class CorrectionNotes:
    """Observes a flight, of one alone, and notes what has been corrected."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._states: list[CorrectionState] = []
        self._corrected, self._kept_free = 0, 0.0

    def __call__(self, time: float, guidance: Guidance) -> None:
        """After the commands of a cycle."""
        state = guidance.correction_state
        corrected = int(state.counts.sum())
        if corrected > self._corrected and guidance.correction is not None:
            self._times.append(time)
            self._states.append(state)
            self._corrected, self._kept_free = corrected, guidance.correction.corrector.margin

    def log(self, mission: Mission, flight: Flights) -> CorrectionLog:
        """All corrections of the flight, now that it has ended."""
        states, times = self._states, np.array(self._times)

        def each(name: str) -> NDArray[Any]:
            return np.array([getattr(state, name)[..., 0] for state in states])

        missed = each("missed").reshape(-1, 6)
        plans = [state.plans for state in states]
        return CorrectionLog(
            flight=flight,
            times=times,
            outcome=each("outcome").astype(np.int64),
            iterations=each("iterations").astype(np.int64),
            propagations=each("propagations").astype(np.int64),
            miss=missed[:, POSITION],
            margin=self._kept_free - missed[:, EXCESS].max(axis=1, initial=0.0),
            to_go=each("to_go").astype(float),
            plans=Plans(
                np.array([plan.fast[0] for plan in plans]),
                np.array([plan.slow[0] for plan in plans]),
                np.array([plan.values[:, 0] for plan in plans]).reshape(-1, N_BANKS + N_ANGLES).T,
            ),
            estimates=_estimates(mission, flight, times, states),
        )


def fly_logged(
    mission: Mission, scheme: Scheme, case: int, **options: Unpack[CampaignOptions]
) -> CorrectionLog:
    """Flight `case` of a campaign, as `fly_one` flies it, with its corrections.

    Raises
    ------
    ValueError
        If the scheme does not correct, or as `fly_one`.
    """
    require_corrected(scheme.guidance)
    notes = CorrectionNotes()
    return notes.log(mission, fly_one(mission, scheme, case, observer=notes, **options))


def require_corrected(guidance: Guidance) -> None:
    """Refuse, by ValueError, what has no corrections to tell of."""
    if guidance.correction is None:
        raise ValueError(
            "corrections: expected a scheme that corrects its plan in flight, by bank or "
            "bank_and_angle, got one that tracks its reference"
        )


def _estimates(
    mission: Mission, flight: Flights, times: Array, states: list[CorrectionState]
) -> EstimateCourse:
    """What was estimated at each correction, and what was true there."""
    at = np.rint(times / flight.cycle).astype(np.intp)  # every cycle is recorded
    truth = flight.truth_of([0] * len(times))
    flown = flight.states[0][:, at]
    true = true_model(mission.family(truth.parameters), truth)
    estimates = [state.estimate for state in states]
    n = len(ESTIMATED)
    return EstimateCourse(
        times=times,
        altitude=flown[ALTITUDE],
        truth=true_estimate(mission.flight_model, true, truth, flown).T,
        mean=np.array([own.mean[:, 0] for own in estimates]).reshape(-1, n),
        covariance=np.array([own.covariance[..., 0] for own in estimates]).reshape(-1, n, n),
    )


def write_correction_log(path: str | Path, log: CorrectionLog) -> None:
    """Write it as CSV, a row a correction; SI and rad."""
    with written(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows(_rows(log))


def _rows(log: CorrectionLog) -> Iterator[list[str]]:
    known = log.estimates
    wide = DEVIATIONS * known.deviation
    for k in range(len(log)):
        outcome = CorrectionOutcome(int(log.outcome[k]))
        thetas = np.stack([known.mean[k], wide[k], known.truth[k]], axis=1).ravel()
        plan = (log.plans.fast[k], log.plans.slow[k], *log.plans.values[:, k])
        numbers = (*log.miss[k], log.margin[k], log.to_go[k], *plan, *thetas)
        yield [
            f"{log.times[k]:.6f}",
            outcome.name,
            outcome.sentence,
            str(log.iterations[k]),
            str(log.propagations[k]),
            *(repr(float(value)) for value in numbers),
        ]
