"""What flights are told: navigation and accelerometer, with their errors.

    navigation     x(t − τ) + bias + noise on north, east, altitude, V, γ, ψ, σ; a sample may be missing
    accelerometer  (1 + scale) a + bias + noise, along the velocity, up and to the right of it

The bank rate, from a gyroscope, is exact. The noise of a flight comes from its own seed, in the order of
its samples: it depends on no other flight.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ampi.physics.state import LATITUDE, LONGITUDE, N_STATES
from ampi.simulation.delay import Delay
from ampi.simulation.truth import Truth

Array = NDArray[np.float64]

NAVIGATED = ("altitude", "east", "north", "speed", "flight_path_angle", "azimuth", "bank_angle")
SENSED = ("along", "up", "right")
BLOCK = 256  # samples of noise drawn at once


class SensorNoise:
    """Standard normal numbers for every sample, and one uniform number: has it arrived?"""

    def __init__(self, seeds: NDArray[np.uint64]) -> None:
        self._generators = [np.random.Generator(np.random.Philox(key=int(seed))) for seed in seeds]
        self._normal = np.empty((len(seeds), BLOCK, N_STATES + len(SENSED)))
        self._uniform = np.empty((len(seeds), BLOCK))
        self._next = BLOCK

    def sample(self) -> tuple[Array, Array, Array]:
        """Of the next sample: navigation (7, n), accelerometer (3, n), uniform (n,)."""
        k = self._begin()
        self._next = k + 1
        normal = self._normal[:, k].T
        return normal[:N_STATES], normal[N_STATES:], self._uniform[:, k]

    def rest(self) -> tuple[Array, Array]:
        """Of the next k samples, of which there is one: normal (n, k, 10) and uniform (n, k)."""
        k, self._next = self._begin(), BLOCK
        return np.ascontiguousarray(self._normal[:, k:]), np.ascontiguousarray(self._uniform[:, k:])

    def _begin(self) -> int:
        """Which sample of the block is the next."""
        if self._next == BLOCK:
            for generator, normal, uniform in zip(
                self._generators, self._normal, self._uniform, strict=True
            ):
                generator.standard_normal(out=normal)
                generator.random(out=uniform)
            self._next = 0
        return self._next


class Sensors:
    """Navigation and accelerometer of n flights, sampled once per guidance cycle."""

    def __init__(self, truth: Truth, radius: float, cycle: float) -> None:
        numbers = truth.numbers

        def each(names: tuple[str, ...], room: str, kind: str) -> Array:
            return np.stack([numbers[f"{room}_{name}_{kind}"] for name in names])

        self._bias, self._noise = (each(NAVIGATED, "navigation", k) for k in ("bias", "noise"))
        self._felt_bias = each(SENSED, "accelerometer", "bias")
        self._felt_noise, self._scale = (numbers[f"accelerometer_{k}"] for k in ("noise", "scale"))
        self._dropout, self._radius = numbers["navigation_dropout"], radius
        latency = numbers["navigation_latency"] / cycle
        self._latency = latency if np.any(latency > 0.0) else None
        self._delay: Delay | None = None
        noisy = np.any(self._noise) or np.any(self._felt_noise) or np.any(self._dropout)
        self.noise = SensorNoise(truth.seeds) if noisy else None
        self._is_biased = bool(np.any(self._bias))
        self._feels_truly = not (np.any(self._felt_bias) or np.any(self._scale))
        self._felt = np.zeros((len(SENSED), len(truth.seeds)))

    def navigation(self, x: Array, rate: Array) -> Array:
        """What navigation tells (8, n) of the states (7, n) and bank rates (n,)."""
        told, missing = self._sampled(self._late(x), rate)
        if self.noise is not None:
            told[:, missing] = np.nan
        return told

    def at_entry(self, x: Array, rate: Array) -> Array:
        """The same where a flight begins: with a sample that has arrived, and is not late."""
        return self._sampled(x, rate)[0]

    def _sampled(self, x: Array, rate: Array) -> tuple[Array, NDArray[np.bool_]]:
        """A sample (8, n), and of which flights (n,) it is missing."""
        told, missing = np.concatenate([x, rate[None]]), np.zeros(len(rate), dtype=bool)
        if self.noise is None and not self._is_biased:
            return told, missing
        errors = self._bias.copy()
        if self.noise is not None:
            normal, self._felt, uniform = self.noise.sample()
            errors += self._noise * normal
            missing = uniform < self._dropout
        errors[LONGITUDE] /= self._radius * np.cos(told[LATITUDE])
        errors[LATITUDE] /= self._radius
        told[:N_STATES] += errors
        return told, missing

    def acceleration(self, felt: Array) -> Array:
        """What the accelerometer tells (3, n) of the specific force (3, n); after `navigation`."""
        if self._feels_truly and self.noise is None:
            return felt
        return felt * (1.0 + self._scale) + self._felt_bias + self._felt_noise * self._felt

    def _late(self, x: Array) -> Array:
        if self._latency is None:
            return x
        if self._delay is None:
            self._delay = Delay(self._latency, x)
        self._delay.push(x)
        return self._delay.value()
