"""Distributions of a world file, each the inverse of its cumulative distribution function.

A number of the truth is made from one uniform number u by F⁻¹(u), so a flight is a function of a point
of the unit cube: the same for Monte Carlo, for a design of experiments, and in any company.
The uniform numbers are the middles of 2⁵² cells, so they are never 0 or 1, and a normal law ends at
8.2 standard deviations: what it cannot be may be told before the first flight.

All numbers here are in the unit of the key that the distribution stands under; a law without a mean is
about the nominal number.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator
from scipy.special import ndtr, ndtri

from ampi.missions.units import Number, Section
from ampi.simulation.csv_table import CsvTable

Array = NDArray[np.float64]

LEAST = 2.0**-53  # of the uniform numbers; the greatest is 1 − LEAST
SMALLEST_SHARE = 1e-12  # of a normal law, that truncation may leave
PROBABILITY_ROUNDING = 1e-9  # of a sum of probabilities


def unknown_name(name: str, known: Iterable[str]) -> str:
    """A sentence for a name that is none of the known ones; it offers the nearest."""
    names = list(known)
    near = get_close_matches(name, names, n=3, cutoff=0.6)
    such = f"such as {' or '.join(near)}" if near else f"one of {', '.join(names)}"
    return f"{name}: expected a name that is known here, {such}; got {name!r}"


class KnownKeys(Section):
    """A section whose sentence for an unknown key offers the nearest ones."""

    @model_validator(mode="before")
    @classmethod
    def _keys_are_known(cls, data: Any) -> Any:
        if isinstance(data, dict):
            unknown = [key for key in data if key not in cls.model_fields]
            if unknown:
                raise ValueError("\n".join(unknown_name(k, cls.model_fields) for k in unknown))
        return data


class Constant(KnownKeys):
    """The same for every flight; a plain number in a world file."""

    distribution: Literal["constant"]
    value: Number

    def quantiles(self, uniforms: Array, nominal: float) -> Array:
        """The number, once for each uniform number."""
        return np.full(uniforms.shape, self.value)

    def ends(self, nominal: float) -> tuple[float, float]:
        """Least and greatest number that may be drawn."""
        return self.value, self.value

    def in_words(self, unit: str) -> str:
        """The number and its unit."""
        return f"{self.value:g}{unit}"


class _Bell(KnownKeys):
    """Mean (None: the nominal number) and standard deviation, given as it is or three times."""

    mean: Number | None = None
    sigma: Number | None = Field(default=None, gt=0)
    three_sigma: Number | None = Field(default=None, gt=0)

    @model_validator(mode="after")
    def _one_width(self) -> _Bell:
        if (self.sigma is None) == (self.three_sigma is None):
            raise ValueError("expected either sigma or three_sigma")
        return self

    @property
    def deviation(self) -> float:
        """Standard deviation, before any truncation."""
        return self.sigma if self.sigma is not None else (self.three_sigma or 0.0) / 3.0

    def _centre(self, nominal: float) -> float:
        return nominal if self.mean is None else self.mean

    def _bell_in_words(self, unit: str) -> str:
        about = "" if self.mean is None else f" about {self.mean:g}{unit}"
        return f"{about}, 3σ {3.0 * self.deviation:g}{unit}"


class Normal(_Bell):
    """A normal law."""

    distribution: Literal["normal"]

    def quantiles(self, uniforms: Array, nominal: float) -> Array:
        """F⁻¹ of the uniform numbers."""
        return np.asarray(self._centre(nominal) + self.deviation * ndtri(uniforms))

    def ends(self, nominal: float) -> tuple[float, float]:
        """Least and greatest number that may be drawn."""
        low, high = self.quantiles(np.array([LEAST, 1.0 - LEAST]), nominal).tolist()
        return low, high

    def in_words(self, unit: str) -> str:
        """Name, mean if given, and 3σ."""
        return f"normal{self._bell_in_words(unit)}"


class Truncated(_Bell):
    """A normal law, given that it is between low and high; one of them may be absent."""

    distribution: Literal["truncated"]
    low: Number | None = None
    high: Number | None = None

    @model_validator(mode="after")
    def _bounds_are_apart(self) -> Truncated:
        if self.low is None and self.high is None:
            raise ValueError("expected low or high, or both")
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise ValueError(f"expected low < high, got low = {self.low:g}, high = {self.high:g}")
        return self

    def share(self, nominal: float) -> float:
        """Of the normal law, between the bounds."""
        low, high = self._standardised(nominal)
        return float(ndtr(-low) - ndtr(-high) if low > 0.0 else ndtr(high) - ndtr(low))

    def quantiles(self, uniforms: Array, nominal: float) -> Array:
        """F⁻¹ of the uniform numbers, from the tail that is nearer: a far one keeps its digits."""
        low, high = self._standardised(nominal)
        share = self.share(nominal)
        below, above = ndtr(low) + uniforms * share, ndtr(-high) + (1.0 - uniforms) * share
        standard = np.where(below < above, ndtri(below), -ndtri(above))
        drawn = self._centre(nominal) + self.deviation * standard
        return np.asarray(np.clip(drawn, self.low, self.high))

    def ends(self, nominal: float) -> tuple[float, float]:
        """Least and greatest number that may be drawn."""
        low, high = self.quantiles(np.array([LEAST, 1.0 - LEAST]), nominal).tolist()
        return low, high

    def in_words(self, unit: str) -> str:
        """Name, mean if given, 3σ before truncation, and the bounds."""
        bounds = [
            f"{word} {bound:g}{unit}"
            for word, bound in (("from", self.low), ("to", self.high))
            if bound is not None
        ]
        return f"truncated normal{self._bell_in_words(unit)}, {' '.join(bounds)}"

    def _standardised(self, nominal: float) -> tuple[float, float]:
        low = -math.inf if self.low is None else self.low
        high = math.inf if self.high is None else self.high
        centre = self._centre(nominal)
        return (low - centre) / self.deviation, (high - centre) / self.deviation


class Uniform(KnownKeys):
    """Every number from low to high alike."""

    distribution: Literal["uniform"]
    low: Number
    high: Number

    @model_validator(mode="after")
    def _bounds_are_apart(self) -> Uniform:
        if self.low >= self.high:
            raise ValueError(f"expected low < high, got low = {self.low:g}, high = {self.high:g}")
        return self

    def quantiles(self, uniforms: Array, nominal: float) -> Array:
        """F⁻¹ of the uniform numbers."""
        return np.asarray(self.low + uniforms * (self.high - self.low))

    def ends(self, nominal: float) -> tuple[float, float]:
        """Least and greatest number that may be drawn."""
        return self.low, self.high

    def in_words(self, unit: str) -> str:
        """Name and bounds."""
        return f"uniform from {self.low:g} to {self.high:g}{unit}"


class Discrete(KnownKeys):
    """One of several values, in their order; without probabilities all alike."""

    distribution: Literal["discrete"]
    values: tuple[Number, ...] = Field(min_length=1)
    probabilities: tuple[Number, ...] | None = None

    @model_validator(mode="after")
    def _probabilities_fit(self) -> Discrete:
        given = self.probabilities
        if given is None:
            return self
        if len(given) != len(self.values):
            raise ValueError(
                f"probabilities: expected {len(self.values)}, one for each value, got {len(given)}"
            )
        if min(given) < 0.0 or abs(math.fsum(given) - 1.0) > PROBABILITY_ROUNDING:
            raise ValueError(
                f"probabilities: expected numbers from 0 that sum to 1, got {list(given)}, "
                f"which sum to {math.fsum(given):.10g}"
            )
        return self

    def quantiles(self, uniforms: Array, nominal: float) -> Array:
        """The value in whose share of [0, 1] each uniform number lies."""
        if self.probabilities is None:
            return np.array(self.values)[rows_at(uniforms, len(self.values))]
        steps = np.cumsum(self.probabilities)[:-1]
        return np.array(self.values)[np.searchsorted(steps, uniforms, side="right")]

    def ends(self, nominal: float) -> tuple[float, float]:
        """Least and greatest number that may be drawn."""
        return min(self.values), max(self.values)

    def in_words(self, unit: str) -> str:
        """The values, or how many."""
        if len(self.values) > 6:
            return f"one of {len(self.values)} values"
        return f"one of {', '.join(f'{value:g}' for value in self.values)}{unit}"


class TableColumn(KnownKeys):
    """A column of a CSV file; numbers from one file come from the same row in each flight."""

    distribution: Literal["table"]
    file: str
    column: str

    def of(self, table: CsvTable) -> Discrete:
        """The law of its values, in the order of the rows.

        Raises
        ------
        ValueError
            If the table has no such column.
        """
        values = tuple(table.column(self.column).tolist())
        return Discrete(distribution="discrete", values=values)

    def in_words(self, unit: str) -> str:
        """Column and file."""
        return f"column {self.column} of {self.file}"


def rows_at(uniforms: Array, rows: int) -> NDArray[np.int64]:
    """The row, of equally probable ones, that each uniform number selects."""
    return np.minimum((uniforms * rows).astype(np.int64), rows - 1)


LAWS: dict[str, type[Section]] = {
    "constant": Constant,
    "normal": Normal,
    "truncated": Truncated,
    "uniform": Uniform,
    "discrete": Discrete,
    "table": TableColumn,
}
NumericLaw = Constant | Normal | Truncated | Uniform | Discrete


def _number_or_table(value: Any) -> Any:
    """A number as the constant that it is; a sentence for what is no distribution."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return {"distribution": "constant", "value": value}
    if isinstance(value, Section):
        return value
    if not isinstance(value, Mapping) or "distribution" not in value:
        raise ValueError(
            'expected a number, or a table with distribution = "normal", "truncated", "uniform", '
            '"discrete" or "table"'
        )
    name = value["distribution"]
    if not isinstance(name, str) or name not in LAWS:
        raise ValueError(f"distribution: {unknown_name(str(name), LAWS)}")
    return value


Law = Annotated[
    Annotated[NumericLaw | TableColumn, Field(discriminator="distribution")],
    BeforeValidator(_number_or_table),
]


def law_as_written(law: NumericLaw | TableColumn) -> Any:
    """What a world file says of a law."""
    if isinstance(law, Constant):
        return law.value
    return {"distribution": law.distribution, **law.as_written()}
