"""Numbers in the cells of tables, in as many digits as they deserve, with their 95 % intervals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ampi.simulation.estimates.bootstrap import Estimate
from ampi.simulation.estimates.proportions import Fraction

NOTHING = "–"


@dataclass(frozen=True)
class Cell:
    """A count with its percentage and interval, or a number with its interval, if it has one."""

    value: str
    interval: str = ""

    @classmethod
    def of(cls, fraction: Fraction) -> Cell:
        """Count and percentage of a fraction."""
        return cls(str(fraction.count), str(fraction))


@dataclass(frozen=True)
class Group:
    """Quantities that belong together: a row each, a cell per column of the table."""

    name: str
    quantities: tuple[str, ...]
    cells: Mapping[str, tuple[Cell, ...]]  # column label → one cell per quantity

    @property
    def width(self) -> int:
        """Number of quantities."""
        return len(self.quantities)


def number(value: float) -> str:
    """A number in as many digits as it deserves, never in powers of ten above one."""
    if not np.isfinite(value):
        return NOTHING
    if abs(value) >= 100.0:
        return f"{value:,.0f}"
    if abs(value) >= 10.0:
        return f"{value:.1f}"
    return f"{value:.2g}" if value == 0.0 or abs(value) >= 1e-3 else f"{value:.1e}"


def share_cell(fraction: Fraction) -> Cell:
    """A percentage with its interval."""
    return Cell(
        f"{fraction.percent:.1f}", f"[{100.0 * fraction.low:.1f}, {100.0 * fraction.high:.1f}]"
    )


def estimate_cell(estimate: Estimate, per_si: float) -> Cell:
    """A number with its interval, in the unit of `per_si`."""
    value, low, high = (
        _number(number_ * per_si) for number_ in (estimate.value, estimate.low, estimate.high)
    )
    sure = value == NOTHING or np.isinf(estimate.low)
    return Cell(value) if sure else Cell(value, f"[{low}, {high}]")


def _number(value: float) -> str:
    """As `number`, and infinite ones too."""
    return f"{'-' if value < 0.0 else ''}∞" if np.isinf(value) else number(value)
