"""What a reference is worth before it is flown: its certificate.

    defect     ẋ − f(x, u, t) at the collocated nodes and midway between them: zero of a flight
    miss       where its bank profile would end, flown without a tracker from the measured entry
    margins    what the reference leaves of each limit, at the high-density points
    verdict    inside, clipped, or rejected and why

by the onboard model (`flight_model`), in bounded work, without an exception. An interpolated reference
always ends on its target, for all that it is made of do: what tells a good one is its defect, and the
miss that comes of it. A tracker takes most of that away, at the price of its authority.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.collocation import Collocation
from ampi.onboard.flight_model import (
    ALTITUDE,
    AZIMUTH,
    LATITUDE,
    LONGITUDE,
    Factors,
    FlightModelData,
)
from ampi.onboard.flight_numbers import FlightNumbers, OfFlights
from ampi.onboard.plausibility import SANE, on_turn_of
from ampi.onboard.predicted_flight import SETTLED, at_speed, flown_nodes
from ampi.onboard.reference import Reference
from ampi.onboard.segments import Segments
from ampi.outcome import Outcome

Array = NDArray[np.float64]

# changes of the states (m, rad, m/s) over a whole flight in which defects are counted
SIZES = np.array([1e4, 0.1, 0.1, 1e3, 0.1, 0.1, 0.1])
TOGETHER = 128  # references judged at once: 10 MB of equations


class Verdict(Outcome):
    """Of several that apply the greatest is told: precedence is the order of the numbers."""

    INSIDE = 0, "Inside the hypercube; predicted to end near the target, within the limits."
    CLIPPED = (
        1,
        "Outside the hypercube, the reference is of its boundary; predicted to end near the target, "
        "within the limits.",
    )
    LIMIT_EXCEEDED = 2, "Rejected: the reference exceeds a limit by more than the threshold."
    TARGET_MISSED = (
        3,
        "Rejected: its bank profile is predicted to end farther from the target than the threshold, "
        "or not to reach the target speed.",
    )
    BAD_PARAMETERS = 4, "Rejected: the parameters are no finite numbers."

    @property
    def rejected(self) -> bool:
        """Whether the reference should not be flown."""
        return self >= Verdict.LIMIT_EXCEEDED


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """What a certificate still accepts."""

    horizontal: float  # m, of the predicted miss
    altitude: float  # m
    limit_excess: float = 0.02  # of a limit


@dataclass(frozen=True, eq=False)
class Certificate:
    """Of one reference, or of n: then arrays with a first axis (n,)."""

    verdict: Any  # Verdict; of n references their numbers
    defect: Array  # (…, 2), greatest at the nodes and between, times the final time over `SIZES`
    defect_at_nodes: Array  # (…, 7), greatest over the nodes: m/s, rad/s, m/s²
    defect_between: Array  # (…, 7), over the midpoints
    miss: Array  # (…, 3): east, north, up of the target (m), at its speed; infinite: not reached
    flight_time: Any  # s, to there
    margins: Array  # (…, l): least share that is left of each limit; negative: exceeded
    limits: tuple[str, ...]  # their names

    @property
    def horizontal_miss(self) -> Any:
        """Distance (m) over the ground."""
        return np.hypot(self.miss[..., 0], self.miss[..., 1])

    def of(self, i: int) -> Certificate:
        """That of reference i of n."""
        own = {name: getattr(self, name)[i] for name in OVER_REFERENCES}
        own["verdict"], own["flight_time"] = Verdict(int(own["verdict"])), float(own["flight_time"])
        return Certificate(**own, limits=self.limits)


OVER_REFERENCES = tuple(own.name for own in fields(Certificate) if own.name != "limits")


@dataclass(frozen=True, eq=False)
class Certifier:
    """Makes certificates of the references of one table."""

    model: FlightModelData
    numbers: FlightNumbers
    thresholds: Thresholds
    collocation: Collocation
    position_is_free: bool = False  # of the target: no horizontal miss is judged

    @classmethod
    def of(
        cls,
        model: FlightModelData,
        numbers: FlightNumbers,
        thresholds: Thresholds,
        segments: Segments,
        *,
        position_is_free: bool = False,
    ) -> Certifier:
        """With the segments of the table."""
        own = Collocation.of(segments)
        return cls(model, numbers, thresholds, own, position_is_free)

    def certificate(self, reference: Reference) -> Certificate:
        """Of one reference."""
        return self.certificates([reference]).of(0)

    def certificates(self, references: Sequence[Reference]) -> Certificate:
        """Of n references of the table, copies of their own memory each."""
        blocks = range(0, len(references), TOGETHER)
        parts = [self._judged(references[i : i + TOGETHER]) for i in blocks]
        own: dict[str, Any] = {
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in OVER_REFERENCES
        }
        return Certificate(**own, limits=self.model.limits.names)

    def _judged(self, references: Sequence[Reference]) -> Certificate:
        layout = references[0].layout
        nodal = np.stack([own.nodal for own in references], axis=1)  # (r, n, nodes)
        states, bank_rate = nodal[layout.states], nodal[layout.bank_rate]
        final_time = np.array([own.final_time for own in references])
        told = np.array([own.parameters for own in references])
        with np.errstate(all="ignore"):  # of nonsense the verdict tells
            flights = self.numbers.at(told)
            at_nodes, between = self._defects(states, bank_rate, final_time, flights.factors)
            miss, time = self._miss(states, bank_rate, final_time, flights)
            margins = self._margins(references, flights)
            scaled = np.stack([at_nodes, between], axis=1) / SIZES
        clipped = np.array([not own.inside for own in references])
        known = np.all(np.abs(told) < SANE, axis=1)
        return Certificate(
            verdict=self._verdicts(miss, margins, clipped, known),
            defect=scaled.max(axis=2) * final_time[:, None],
            defect_at_nodes=at_nodes,
            defect_between=between,
            miss=miss,
            flight_time=time,
            margins=margins,
            limits=self.model.limits.names,
        )

    def _defects(
        self, states: Array, bank_rate: Array, final_time: Array, factors: Factors
    ) -> tuple[Array, Array]:
        """Greatest defects (n, 7) at the collocated nodes, and midway between nodes."""
        times, along = self.collocation.times(final_time), _at_points(factors)
        flown = self.model.rates(states, bank_rate, times, along)
        at_nodes, between = np.zeros((2, states.shape[1], len(states)))
        for rule in self.collocation.rules:
            half, own = rule.half(final_time)[:, None], states[:, :, rule.nodes]
            missed = own @ rule.slopes.T / half - flown[:, :, rule.collocated]
            np.maximum(at_nodes, np.abs(missed).max(axis=2).T, out=at_nodes)
            rates = self.model.rates(
                own @ rule.middle.T,
                bank_rate[:, rule.nodes] @ rule.middle.T,
                rule.middle_times(final_time),
                along,
            )
            missed = own @ rule.middle_slopes.T / half - rates
            np.maximum(between, np.abs(missed).max(axis=2).T, out=between)
        return at_nodes, between

    def _miss(
        self, states: Array, bank_rate: Array, final_time: Array, flights: OfFlights
    ) -> tuple[Array, Array]:
        """East, north and up of the target (m), (n, 3), and the time there (s)."""
        entry = flights.entry.copy()
        for angle in (LONGITUDE, AZIMUTH):
            entry[angle] = on_turn_of(entry[angle], states[angle, :, 0])
        factors = flights.factors
        flown, moved = flown_nodes(
            self.model, self.collocation, states, entry, final_time, _at_points(factors)
        )
        target = dict(
            zip(("altitude", "longitude", "latitude", "speed"), flights.target, strict=True)
        )
        end, time = at_speed(
            self.model, flown[:, :, -1], final_time, bank_rate[:, -1], target["speed"], factors
        )
        radius = self.model.equatorial_radius
        east = on_turn_of(end[LONGITUDE] - target["longitude"], 0.0) * np.cos(target["latitude"])
        north = end[LATITUDE] - target["latitude"]
        horizontal = 0.0 if self.position_is_free else radius
        miss = np.stack([horizontal * east, horizontal * north, end[ALTITUDE] - target["altitude"]])
        known = (moved <= SETTLED) & np.isfinite(miss).all(axis=0)
        return np.where(known, miss, np.inf).T, np.where(known, time, np.inf)

    def _margins(self, references: Sequence[Reference], flights: OfFlights) -> Array:
        """1 − the greatest use of each limit, (n, l)."""
        layout = references[0].layout
        rows = np.stack([own.rows for own in references], axis=1)
        use = self.model.limit_use(
            rows[layout.states],
            rows[layout.bank_rate],
            np.stack([own.times for own in references]),
            _at_points(flights.factors),
            flights.limits,
        )
        return np.asarray(1.0 - use.max(axis=2).T)

    def _verdicts(
        self, miss: Array, margins: Array, clipped: NDArray[np.bool_], known: NDArray[np.bool_]
    ) -> NDArray[np.int64]:
        limit = self.thresholds
        near = np.hypot(miss[:, 0], miss[:, 1]) <= limit.horizontal
        near &= np.abs(miss[:, 2]) <= limit.altitude
        kept = np.all(margins >= -limit.limit_excess, axis=1)
        found = np.where(clipped, int(Verdict.CLIPPED), int(Verdict.INSIDE))
        found = np.where(kept, found, int(Verdict.LIMIT_EXCEEDED))
        found = np.where(near, found, int(Verdict.TARGET_MISSED))
        return np.where(known, found, int(Verdict.BAD_PARAMETERS))


def _at_points(factors: Factors) -> Factors:
    """Those of n flights (n,) for their states (7, n, points)."""
    return Factors(*(factor[..., None] if np.ndim(factor) else factor for factor in factors))
