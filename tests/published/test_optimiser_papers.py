"""The tables of the optimiser papers: every row that is judged holds, but for those named here."""

from __future__ import annotations

import json

import pytest

from ampi.papers.figures import FIGURES
from ampi.papers.reproduction import PAPERS
from ampi.papers.table import Reproduction

pytestmark = pytest.mark.slow

OPEN: dict[str, set[str]] = {}  # what is not reached; the pages and the tables say so


OF_THEIR_OWN = {"betts2010"}  # test_shuttle_betts2010.py


@pytest.fixture(scope="module", params=sorted(PAPERS.keys() - OF_THEIR_OWN))
def found(request: pytest.FixtureRequest) -> Reproduction:
    return PAPERS[request.param](True)


def test_every_judged_row_holds(found: Reproduction) -> None:
    failing = {row.quantity for row in found.rows if row.holds is False}
    assert failing == OPEN.get(found.paper, set())
    assert sum(row.holds is True for row in found.rows) >= 2


def test_every_solution_was_flown_again(found: Reproduction) -> None:
    flown = [n for n in found.numbers.values() if "end_error" in n]
    assert len(flown) == len(found.solutions) + len(found.ours)
    assert all(abs(n["end_error"]["speed_m_per_s"]) < 1e3 for n in flown)


def test_the_numbers_are_json(found: Reproduction) -> None:
    again = json.loads(json.dumps(found.as_dict(), default=float))
    assert again["rows"][0]["quantity"] == found.rows[0].quantity


def test_the_figure_has_four_panels_with_units(found: Reproduction) -> None:
    figure = FIGURES[found.paper](found)
    assert len(figure.axes) == 4
    assert all(axes.get_xlabel() and axes.get_ylabel() for axes in figure.axes)
