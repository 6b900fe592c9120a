"""Ends of flights by several roads on one map, and what a report says of corrections."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ampi.correction.corrector import CorrectionOutcome
from ampi.report.cells import NOTHING
from ampi.report.figures.road_ends import CIRCLES, LEAST, logarithmic, road_ends
from ampi.report.figures.style import image_bytes
from ampi.report.verdict_tables import corrections
from ampi.simulation.flights import Flights


def test_the_logarithmic_map_keeps_bearings_and_counts_decades() -> None:
    away, bearing = LEAST * 10.0 ** np.arange(5.0), np.array([0.3, -2.0, 1.0, 3.0, 0.0])
    x, y = logarithmic(away * np.sin(bearing), away * np.cos(bearing))
    np.testing.assert_allclose(np.hypot(x, y), np.arange(5.0), atol=1e-12)
    np.testing.assert_allclose(np.arctan2(x, y)[1:], bearing[1:], atol=1e-12)
    assert np.all(logarithmic(np.zeros(1), np.full(1, 0.1 * LEAST)) == np.zeros((2, 1)))


def test_every_flight_that_arrived_is_on_the_map(campaigns: dict[str, Flights]) -> None:
    figure = road_ends(campaigns)
    afar = figure.axes[0]
    for line, flights in zip(afar.lines, campaigns.values(), strict=False):
        x, y = (np.asarray(values, dtype=float) for values in line.get_data())
        assert len(x) == np.count_nonzero(flights.reached)
        assert np.all(np.maximum(np.abs(x), np.abs(y)) <= afar.get_xlim()[1])
        near = flights.miss[flights.reached] < min(CIRCLES)
        assert np.count_nonzero(np.hypot(x, y) < 1.0) == np.count_nonzero(near)
    assert image_bytes(figure).startswith(b"\x89PNG")


def test_corrections_are_counted_where_there_are_any(campaigns: dict[str, Flights]) -> None:
    counts = campaigns["ampi"].corrections.copy()
    counts[:, CorrectionOutcome.PLAN_REPLACED] = 100
    counts[:4, CorrectionOutcome.OUT_OF_REACH] = 3
    corrected = replace(campaigns["ampi"], correction="bank", corrections=counts)
    (group,) = corrections({"nominal": campaigns["nominal"], "ampi": corrected})
    assert group.quantities == ("plan replaced", "out of reach", "flights ever out of reach")
    assert [cell.value for cell in group.cells["ampi"]] == ["6,000", "12", "4"]
    assert {cell.value for cell in group.cells["nominal"]} == {NOTHING}
    assert corrections(campaigns) == ()
