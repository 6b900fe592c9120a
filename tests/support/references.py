"""References at an instant by a library, and references with rows of one's own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BarycentricInterpolator

from ampi.onboard.reference import Reference
from ampi.onboard.table import GuidanceTable

Array = NDArray[np.float64]


def at_instant(table: GuidanceTable, reference: Reference, time: float) -> Array:
    """Rows (r,) of a reference at a time (s), by scipy's polynomial of the segment."""
    segments = table.segments
    begins = segments.start[0] + segments.start[1] * reference.final_time
    k = int(np.searchsorted(begins[1:], time, side="right"))
    half = segments.half_length[0][k] + segments.half_length[1][k] * reference.final_time
    count, first = segments.counts[k], segments.first_node[k]
    values = reference.nodal[:, first : first + count].T
    found = BarycentricInterpolator(segments.nodes[k, :count], values)(
        (time - begins[k]) / half - 1
    )
    return np.asarray(found)


def asking(reference: Reference, bank_rate: float | Array) -> Reference:
    """A copy that asks for a bank rate (rad/s; of all nodes, or (n,)), and tracks nothing."""
    own, layout = reference.copy(), reference.layout
    own.nodal[layout.bank_rate], own.nodal[layout.gains] = bank_rate, 0.0
    return own
