"""The example notebooks: their code runs, and what they show is there, small and of no machine."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from ampi.missions.mission import Mission
from ampi.onboard.health import Health
from ampi.simulation.flights import Flights
from tests.support.databases import small_database

NOTEBOOKS = Path(__file__).parents[2] / "docs" / "notebooks"
FEWER = ("FLIGHTS = 60", "FLIGHTS = 6")


def cells(name: str) -> list[dict[str, Any]]:
    found = json.loads((NOTEBOOKS / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]
    return [cell for cell in found if cell["cell_type"] == "code"]


@pytest.fixture
def beside_a_database(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Work where the nine cases are built already: `database.build` finds them whole, or solves them."""
    shutil.copy(small_database(tmp_path_factory), tmp_path / "nine_cases.h5")
    monkeypatch.chdir(tmp_path)


def executed(name: str) -> dict[str, Any]:
    """The names that the cells of a notebook leave behind."""
    names: dict[str, Any] = {}
    for cell in cells(name):
        exec("".join(cell["source"]).replace(*FEWER), names)
    return names


@pytest.mark.usefixtures("beside_a_database")
def test_from_a_mission_to_a_reference() -> None:
    names = executed("mission_to_reference")
    assert names["report"].solved == names["report"].cases == 9
    assert names["reference"].health is Health.GOOD
    assert abs(names["error"][0]).max() < 500.0  # m of altitude


@pytest.mark.usefixtures("beside_a_database")
def test_from_worlds_to_a_verdict() -> None:
    names = executed("worlds_to_verdict")
    flights, corrected = names["flights"], names["corrected"]
    assert isinstance(names["mission"], Mission) and isinstance(flights, Flights)
    assert flights.n == corrected.n == 6
    assert max(corrected.miss) < 1e3 < max(flights.miss)


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.stem)
def test_what_they_show_is_whole(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert path.stat().st_size < 400_000
    assert not re.search(r"/(home|root|tmp|work|Users)/|https?://(?!www\.w3\.org)", text)
    own = cells(path.stem)
    assert [cell["execution_count"] for cell in own] == list(range(1, len(own) + 1))
    kinds = [output["output_type"] for cell in own for output in cell["outputs"]]
    assert "error" not in kinds
    assert len(kinds) >= len(own) - 1  # a cell may end without a value
