"""Are certificates true? Their references flown again by an integrator and a physics that they lack.

DOP853 flies the bank profile of each reference from the measured entry to the target speed, and the
mission's own limits are read along the reference; then both verdicts stand side by side.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.onboard.certificate import Certificate, Thresholds, Verdict
from ampi.onboard.predicted_flight import LONGEST
from ampi.onboard.reference import Reference
from ampi.onboard_model import certifier_of
from ampi.physics.angles import wrapped
from ampi.physics.state import ALTITUDE, BANK, LATITUDE, LONGITUDE
from ampi.propagation.adaptive_step import IntegrationError
from ampi.propagation.bank_profile import fly_to_speed

Array = NDArray[np.float64]

OUTSIDE = 0.2  # of an axis' range: how far beyond it the second half of the entries reaches
TOGETHER = 100  # flights: those of one call share their steps
TIMED = 50  # certificates, one at a time


@dataclass(frozen=True, eq=False)
class CheckedCertificates:
    """Certificates of n references, and what their flights were."""

    parameters: Array  # (n, d)
    inside: NDArray[np.bool_]  # (n,)
    certificate: Certificate  # of all n
    flown_miss: Array  # (n, 3), east, north, up (m); infinite: the target speed was not reached
    verdict: NDArray[np.int64]  # (n,), by the flights and the mission's limits
    seconds: float  # median of one certificate

    @cached_property
    def predicted(self) -> Array:
        """Predicted misses (n,), m, in all directions."""
        return _length(self.certificate.miss)

    @cached_property
    def flown(self) -> Array:
        """Flown misses (n,), m."""
        return _length(self.flown_miss)

    @property
    def rank_correlation(self) -> float:
        """Of predicted and flown misses (Spearman)."""
        return rank_correlation(self.predicted, self.flown)

    @property
    def defect_correlation(self) -> float:
        """Of defects at the nodes and flown misses inside: what tells a miss without a flight."""
        return rank_correlation(self.certificate.defect[self.inside, 0], self.flown[self.inside])

    @property
    def error(self) -> Array:
        """Distances (n,), m, of the predicted and the flown ends; 0 where neither is there."""
        both = np.isinf(self.predicted) & np.isinf(self.flown)
        with np.errstate(invalid="ignore"):
            apart = _length(self.certificate.miss - self.flown_miss)
        return np.where(both, 0.0, np.where(np.isnan(apart), np.inf, apart))

    @property
    def relative_error(self) -> Array:
        """Those over the flown miss."""
        return np.where(self.error == 0.0, 0.0, self.error / self.flown)

    @property
    def right(self) -> float:
        """Share of right verdicts."""
        return float(np.mean(self.certificate.verdict == self.verdict))


def rank_correlation(a: Array, b: Array) -> float:
    """Spearman's: Pearson's of the ranks, equal numbers sharing theirs."""
    ranks = []
    for values in (a, b):
        _, place, count = np.unique(values, return_inverse=True, return_counts=True)
        ranks.append((np.cumsum(count) - 0.5 * (count - 1))[place])
    return float(np.corrcoef(ranks)[0, 1])


def random_entries(mission: Mission, n: int, seed: int) -> Array:
    """(n, d): the first half in the hypercube of the grid, the others in one 20 % larger each way."""
    low, high = np.array([axis[[0, -1]] for axis in mission.grid_axes]).T
    beyond = OUTSIDE * (high - low) * (np.arange(n) >= n // 2)[:, None]
    draws = np.random.default_rng(seed).random((n, len(low)))
    return np.asarray(low - beyond + draws * (high - low + 2.0 * beyond))


def check_certificates(
    mission: Mission, guidance: Guidance, parameters: Array
) -> CheckedCertificates:
    """Certify the references of `parameters` (n, d) in the guidance's mode, and fly them.

    Raises
    ------
    ValueError
        If the model on board cannot express the mission.
    """
    certifier = certifier_of(mission, guidance.table.segments)
    references = [guidance.reference(p).copy() for p in parameters]
    found, seconds = certifier.certificates(references), []
    for own in references[:TIMED]:
        began = time.perf_counter()
        certifier.certificate(own)
        seconds.append(time.perf_counter() - began)
    family = mission.family(parameters)
    inside = np.array([own.inside for own in references])
    starts = range(0, len(references), TOGETHER)
    blocks = [np.arange(len(references))[i : i + TOGETHER] for i in starts]
    bank = np.stack([own.nodal[BANK] for own in references])
    final_time = np.array([own.final_time for own in references])
    miss = np.concatenate([flown_miss(family.take(b), bank[b], final_time[b]) for b in blocks])
    verdict = _verdicts(miss, _greatest_use(family, references), inside, certifier.thresholds)
    median = float(np.median(seconds))
    return CheckedCertificates(parameters, inside, found, miss, verdict, median)


def _verdicts(
    miss: Array, use: Array, inside: NDArray[np.bool_], thresholds: Thresholds
) -> NDArray[np.int64]:
    """By the flights."""
    verdict = np.where(inside, int(Verdict.INSIDE), int(Verdict.CLIPPED))
    verdict[use - 1.0 > thresholds.limit_excess] = int(Verdict.LIMIT_EXCEEDED)
    far = np.hypot(miss[:, 0], miss[:, 1]) > thresholds.horizontal
    verdict[far | (np.abs(miss[:, 2]) > thresholds.altitude)] = int(Verdict.TARGET_MISSED)
    return verdict


def flown_miss(family: MissionFamily[Mission], bank: Array, final_time: Array) -> Array:
    """East, north and up of the target (m), (n, 3); infinite of who does not get there.

    Of nodal bank angles (n, nodes) and final times (n,) on the mesh of the mission, from its entries.
    """
    model, mission = family.flight_model(), family.mission
    entry, speed = family.entry_states, family.target("speed")
    mesh = mission.pseudospectral_mesh
    try:
        end = fly_to_speed(model, mesh, bank, entry, final_time, speed, LONGEST)
    except IntegrationError:
        if len(bank) == 1:
            return np.full((1, 3), np.inf)
        halves = np.array_split(np.arange(len(bank)), 2)  # one of them stops all
        return np.concatenate([flown_miss(family.take(h), bank[h], final_time[h]) for h in halves])
    latitude = family.target("latitude")
    radius = model.planet.equatorial_radius * (not mission.target.place_is_free)
    east = radius * np.cos(latitude) * wrapped(end[:, LONGITUDE] - family.target("longitude"))
    north = radius * (end[:, LATITUDE] - latitude)
    miss = np.stack([east, north, end[:, ALTITUDE] - family.target("altitude")], axis=1)
    return np.where(np.isnan(miss), np.inf, miss)


def _greatest_use(family: MissionFamily[Mission], references: Sequence[Reference]) -> Array:
    """Of any limit by each reference (n,)."""
    states = np.stack([own.states for own in references], axis=1)
    rates = np.stack([own.bank_rate for own in references])
    times = np.stack([own.times for own in references])
    limits = family.path_limits(trailing=1)
    use = limits.use(family.flight_model(trailing=1), states, rates, times)
    return np.asarray(np.stack(np.broadcast_arrays(*use)).max(axis=(0, 2)))


def _length(miss: Array) -> Array:
    return np.asarray(np.sqrt((miss * miss).sum(axis=1)))
