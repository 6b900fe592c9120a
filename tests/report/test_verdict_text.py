"""The verdict in the terminal: judge()'s numbers, the paper's numbers, 100 characters."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from ampi.missions.mission import Mission
from ampi.report.cells import number
from ampi.report.text import WIDTH, verdict_text
from ampi.report.verdict_tables import verdict_tables
from ampi.simulation.flights import Flights
from ampi.simulation.plant import FlightStatus
from ampi.simulation.statistics import footprint_ratio, judge


def block(text: str, heading: str) -> dict[str, str]:
    """Rows of the block under `heading`: label → the rest of the line."""
    lines = text.splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith(heading))
    rows = {}
    for line in lines[start + 2 :]:
        if not line or not line[12:13].isspace() or line[:1].isspace():
            break
        rows[line[:12].strip()] = line[12:]
    return rows


def test_shares_are_those_of_judge(mission: Mission, campaigns: dict[str, Flights]) -> None:
    text = verdict_text(mission, campaigns)
    circles, radii = block(text, "Circles of Table 5"), block(text, "Within a radius")
    shares = block(text, "% of flights")
    for name, flights in campaigns.items():
        verdict = judge(flights)
        for fraction in verdict.rings:
            assert str(fraction).replace(" %", "") in circles[name]
        for fraction in verdict.within.values():
            assert str(fraction).replace(" %", "") in radii[name]
        for fraction in (verdict.reached, verdict.limits_kept):
            assert str(fraction).replace(" %", "") in shares[name]


def test_spreads_are_those_of_judge(mission: Mission, campaigns: dict[str, Flights]) -> None:
    text = verdict_text(mission, campaigns)
    for heading, error in (("Miss distance", "miss"), ("Altitude error (m)", "altitude")):
        rows = block(text, heading)
        for name, flights in campaigns.items():
            spread = getattr(judge(flights), error)
            told = re.sub(r"\[[^]]*\]", "", rows[name]).replace(",", "")
            shown = [float(word) for word in told.split()]
            wanted = [spread.median, spread.percentile_99, spread.worst]
            assert shown == pytest.approx(wanted, rel=0.05)
            intervals = re.findall(r"\[(\S+), (\S+)\]", rows[name])
            for value, ends in zip(shown, intervals, strict=False):
                low, high = (float(end.replace(",", "")) for end in ends)
                assert low <= value <= high
            assert len(intervals) == 2  # the worst has none


def test_footprints_are_those_of_statistics(
    mission: Mission, campaigns: dict[str, Flights]
) -> None:
    rows = block(verdict_text(mission, campaigns), "Covariance ellipse of 95 %")
    ratio = footprint_ratio(campaigns["ampi"], campaigns["nominal"])
    assert str(ratio) in rows["ampi"]
    assert number(judge(campaigns["ampi"]).footprint_area * 1e-6) in rows["ampi"]
    assert rows["nominal"].split()[-1] == "–"


def test_nominal_tracking_has_no_hypercube(mission: Mission, campaigns: dict[str, Flights]) -> None:
    rows = block(verdict_text(mission, campaigns), "% of flights")
    assert rows["nominal"].split()[-1] == "–"
    assert str(judge(campaigns["ampi"]).clipped).replace(" %", "") in rows["ampi"]


def test_failures_are_counted(mission: Mission, campaigns: dict[str, Flights]) -> None:
    """One column a way to fail, in the order of FlightStatus."""
    rows = block(verdict_text(mission, campaigns), "Failures")
    flown = campaigns["ampi"].status
    ways = [s for s in FlightStatus if s is not FlightStatus.REACHED_SPEED]
    shares = [f"{100.0 * np.mean(flown == int(s)):.1f}" for s in ways]
    assert rows["ampi"].split()[::3] == shares == ["1.7", "1.7", "1.7", "0.0"]


def test_paper_rows_carry_table_5(mission: Mission, campaigns: dict[str, Flights]) -> None:
    text = verdict_text(mission, campaigns)
    circles = block(text, "Circles of Table 5")["nominal 2016"]
    assert circles.split()[::3] == ["74.6", "24.2", "1.2", "0.0"]
    radii = block(text, "Within a radius")["AMPI 2016"]
    assert all(share in radii for share in (" 74.0 ", " 98.5 ", " 100.0 "))


def test_other_missions_have_no_paper(mission: Mission, campaigns: dict[str, Flights]) -> None:
    other = mission.model_copy(update={"name": "other"})
    assert "2016" not in verdict_text(other, campaigns)


@pytest.mark.parametrize("name", ["ampi", "a very long name of a campaign"])
def test_no_line_is_wider_than_the_terminal(
    name: str, mission: Mission, campaigns: dict[str, Flights]
) -> None:
    lines = verdict_text(mission, {name: campaigns["ampi"], **campaigns}).splitlines()
    assert max(map(len, lines)) <= WIDTH


def test_ratio_is_withheld_from_different_draws(
    mission: Mission, campaigns: dict[str, Flights]
) -> None:
    moved = replace(campaigns["ampi"], parameters=campaigns["ampi"].parameters + 1.0)
    tables = verdict_tables(mission, {"nominal": campaigns["nominal"], "ampi": moved})
    footprint = next(t for t in tables if t.title == "Footprint")
    assert footprint.groups[0].cells["ampi"][1].value == "–"


@pytest.mark.parametrize(
    ("value", "text"),
    [(32173.4, "32,173"), (15.04, "15.0"), (3.04, "3"), (0.0, "0"), (3.04e-6, "3.0e-06")],
)
def test_numbers_are_short(value: float, text: str) -> None:
    assert number(value) == text


def test_many_limits_are_told_in_several_lines(
    mission: Mission, campaigns: dict[str, Flights]
) -> None:
    zones = tuple(f"no_fly_zone {k}" for k in range(1, 9))
    ampi = campaigns["ampi"]
    crowded = replace(
        ampi,
        limits=zones,
        path=np.zeros((ampi.n, len(zones), len(ampi.times))),
        peak=np.zeros((ampi.n, len(zones))),
    )
    text = verdict_text(mission, {"ampi": crowded})
    assert max(map(len, text.splitlines())) <= WIDTH
    assert all(text.count(f"no fly zone {k}") == 2 for k in range(1, 9))
