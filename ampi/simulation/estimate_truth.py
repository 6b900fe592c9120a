"""Are estimates true? The estimator beside flights in a world, against what the world had drawn.

The truth of θ is on the model's air at the altitude that navigation tells, its noise left out: an
altitude that is told 33 m too high is air that is half a per cent thicker. The local part of ln k_D is
the world's profile of the density; where that is no noise about one but another season, only the sum of
both parts says something. So two errors e are judged by eᵀ C⁻¹ e (NEES): that of all six, and that of
the four that a flight is changed by, ln k_D, ln k_L and the winds where the vehicle is.

In a world of its own assumptions the filter has the NEES 6 and the NIS 3 of its degrees of freedom
(tests/estimation/test_consistency.py). The worlds here ask less of it, and it claims more error than it
makes: their profiles are straight from kilometre to kilometre where a Markov process is rough at any
scale, and their accelerometer tells components in the true axes, not in those that navigation believes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ampi.estimation.estimator import Estimator
from ampi.estimation.settings import EstimatorSettings
from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.onboard_model import flight_model_of
from ampi.physics.equations_of_motion import FlightModel, aerodynamic_acceleration
from ampi.physics.state import ALTITUDE
from ampi.simulation.actuator import Actuator
from ampi.simulation.closed_loop import Entries, Rhythm
from ampi.simulation.plant import ANGLE, RATE
from ampi.simulation.true_model import true_model
from ampi.simulation.truth import Truth

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

BATCH = 250  # flights at once
MEASURED = 3  # components of an acceleration
TOTALS = ("log_drag", "log_lift", "wind_east", "wind_north")
OF_TOTALS = np.array(  # θ → totals
    [[1, 1, 0, 0, 0, 0], [1, 1, 1, 0, 0, 0], [0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 0]], dtype=float
)


class Instant(NamedTuple):
    """One cycle of n flights: what is told, and what is true."""

    time: float  # s
    told: Array  # (8, n), navigation
    sensed: Array  # (3, n)
    change: Array  # (n,) of the angle of attack as flown, which its actuator tells, rad
    states: Array  # (7, n)
    flying: Mask  # (n,)


def instants(mission: Mission, guidance: Guidance, truth: Truth) -> Iterator[Instant]:
    """Every cycle of the flights of `truth`, guided as they will be, to their ends."""
    entries = Entries.of(mission.family(truth.parameters), guidance, truth)
    actuator = Actuator(truth, guidance.cycle, entries.steering)
    flights, plant, rhythm = entries.flights, entries.plant, Rhythm.of(guidance.cycle, 1.0)
    step, length = 0, rhythm.cycle / rhythm.parts
    while step == 0 or flights.flying.any():
        time, steering = step * rhythm.cycle, actuator.flown
        told = entries.sensors.navigation(flights.x, steering[RATE])
        model = plant.steered(steering[ANGLE])
        felt = np.stack(aerodynamic_acceleration(model, flights.x, time))
        sensed = entries.sensors.acceleration(felt)
        yield Instant(time, told, sensed, steering[ANGLE], flights.x, flights.flying.copy())
        command = guidance.step(time, told, sensed if guidance.senses else None)
        actuator.command(np.array([command.bank_rate, command.angle_of_attack]))
        for part in range(rhythm.parts):
            old, new = actuator.advance(part / rhythm.parts, (part + 1) / rhythm.parts)
            flights.advance(plant, old, new, time + part * length, length)
        step += 1


def true_estimate(nominal: FlightModel, true: FlightModel, truth: Truth, states: Array) -> Array:
    """θ (6, n) as it is at `states` (7, n)."""
    numbers, altitude = truth.numbers, states[ALTITUDE]
    told = altitude + numbers["navigation_altitude_bias"]
    factor, air = numbers["density_factor"], nominal.atmosphere
    local = np.log(true.atmosphere.density(altitude) / (factor * air.density(altitude)))
    constant = np.log(
        factor
        * numbers["drag_factor"]
        / numbers["mass_factor"]
        * (air.density(altitude) / air.density(told))
    )
    ratio = np.log(numbers["lift_factor"] / numbers["drag_factor"])
    still = np.zeros_like(altitude)
    wind = (still, still) if true.wind is None else true.wind.components(altitude)
    return np.stack([constant, local, ratio, *wind, numbers["angle_of_attack_error"]])


@dataclass(frozen=True, eq=False, kw_only=True)
class EstimateCourse:
    """Estimates along one flight, at k times, and what was true."""

    times: Array  # (k,), s
    altitude: Array  # (k,), m
    truth: Array  # (k, 6)
    mean: Array  # (k, 6)
    covariance: Array  # (k, 6, 6)

    @property
    def deviation(self) -> Array:
        """Standard deviations (k, 6)."""
        return np.sqrt(np.einsum("kii->ki", self.covariance))


@dataclass(frozen=True, eq=False)
class CheckedEstimates:
    """Estimates of n flights at k times against the truth; not-a-number after a flight's end."""

    counts: dict[str, NDArray[np.int64]]  # (n,) each
    times: Array  # (k,), s
    altitude: Array  # (k, n), m
    truth: Array  # (k, 6, n)
    mean: Array  # (k, 6, n)
    covariance: Array  # (k, 6, 6, n)
    nis: Array  # (k, n), mean of the innovations since the time before

    def along(self, flight: int) -> EstimateCourse:
        """Those of one flight, to its end."""
        flown = self.flying[:, flight]
        return EstimateCourse(
            times=self.times[flown],
            altitude=self.altitude[flown, flight],
            truth=self.truth[flown, :, flight],
            mean=self.mean[flown, :, flight],
            covariance=self.covariance[flown][..., flight],
        )

    @cached_property
    def error(self) -> Array:
        """(k, 6, n)."""
        return self.truth - self.mean

    @cached_property
    def flying(self) -> Mask:
        """(k, n)."""
        return np.isfinite(self.altitude)

    @cached_property
    def deviation(self) -> Array:
        """(k, 6, n)."""
        return np.sqrt(np.einsum("kiin->kin", self.covariance))

    @cached_property
    def total_error(self) -> Array:
        """Of `TOTALS` (k, 4, n)."""
        return np.einsum("ti,kin->ktn", OF_TOTALS, self.error)

    @cached_property
    def total_covariance(self) -> Array:
        """(k, 4, 4, n)."""
        return np.einsum("ti,kijn,uj->ktun", OF_TOTALS, self.covariance, OF_TOTALS)

    @cached_property
    def nees(self) -> Array:
        """Of all six (k, n)."""
        return _squared(self.error, self.covariance)

    @cached_property
    def total_nees(self) -> Array:
        """Of the totals (k, n)."""
        return _squared(self.total_error, self.total_covariance)

    def within(self, deviations: float = 3.0) -> Array:
        """(k, 4): share of the flights whose totals are within so many standard deviations."""
        own = np.sqrt(np.einsum("kttn->ktn", self.total_covariance))
        inside = np.abs(self.total_error) <= deviations * own
        counts = np.maximum(self.flying.sum(axis=1), 1)
        return np.asarray((inside & self.flying[:, None]).sum(axis=2) / counts[:, None])

    def bounds(self, degrees: int, share: float = 0.95) -> Array:
        """(k, 2): between which the mean of χ² of so many degrees lies, of those that fly."""
        flying = np.maximum(self.flying.sum(axis=1), 1)[:, None]
        tails = np.array([0.5 * (1.0 - share), 0.5 * (1.0 + share)])
        return np.asarray(chi2.ppf(tails, degrees * flying) / flying)


def check_estimates(
    mission: Mission,
    guidance: Guidance,
    truth: Truth,
    settings: EstimatorSettings,
    every: float = 5.0,
) -> CheckedEstimates:
    """Fly the flights of `truth`, the estimator beside them, and compare each `every` seconds."""
    batches = [truth.take(slice(i, i + BATCH)) for i in range(0, len(truth), BATCH)]
    with np.errstate(all="ignore"):  # flights that have ended
        return _joined([_checked(mission, guidance, own, settings, every) for own in batches])


def _checked(
    mission: Mission, guidance: Guidance, truth: Truth, settings: EstimatorSettings, every: float
) -> CheckedEstimates:
    n = len(truth)
    true = true_model(mission.family(truth.parameters), truth)
    estimator = Estimator(flight_model_of(mission), settings, n)
    stride, rows = max(1, round(every / guidance.cycle)), []
    nis, ended = np.zeros((2, n)), np.zeros(n, dtype=np.int64)
    for step, now in enumerate(instants(mission, guidance, truth)):
        told = np.where(now.flying, now.told, np.nan)
        estimator.update(now.time, told, now.sensed, now.change)
        ended += ~now.flying
        nis += np.where(np.isnan(estimator.nis), 0.0, [estimator.nis, np.ones(n)])
        if step % stride == 0 and step > 0:
            states = np.where(now.flying, now.states, np.nan)
            theta = true_estimate(mission.flight_model, true, truth, states)
            found = estimator.estimate
            row = (states[ALTITUDE], theta, found.mean, found.covariance, nis[0] / nis[1])
            rows.append((now.time, *(np.where(now.flying, value, np.nan) for value in row)))
            nis = np.zeros((2, n))
    estimator.counts["unusable"] -= ended  # of a flight that has ended nothing is told
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return CheckedEstimates(estimator.counts, *columns)


def _squared(error: Array, covariance: Array) -> Array:
    """eᵀ C⁻¹ e (k, n) of (k, i, n) and (k, i, i, n)."""
    matrices = np.moveaxis(covariance, 3, 1)
    right = np.moveaxis(error, 2, 1)[..., None]
    known = np.isfinite(right).all(axis=(2, 3))
    found = np.full(known.shape, np.nan)
    solved = np.linalg.solve(matrices[known], right[known])
    found[known] = np.einsum("mij,mij->m", right[known], solved)
    return found


def _joined(parts: list[CheckedEstimates]) -> CheckedEstimates:
    """Of all batches; the shorter ones filled with not-a-number."""
    longest = max(parts, key=lambda part: len(part.times))
    k = len(longest.times)

    def together(name: str) -> Array:
        arrays = [getattr(part, name) for part in parts]
        filled = [np.concatenate([a, np.full((k - len(a), *a.shape[1:]), np.nan)]) for a in arrays]
        return np.concatenate(filled, axis=-1)

    names = ("altitude", "truth", "mean", "covariance", "nis")
    counts = {
        name: np.concatenate([part.counts[name] for part in parts]) for name in parts[0].counts
    }
    return CheckedEstimates(counts, longest.times, *map(together, names))
