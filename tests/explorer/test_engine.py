"""What the page computes is what Python computes: references, flights, corrected flights."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ampi
from ampi.dataset import read_dataset
from ampi.explorer.explorer import MODES, explore
from ampi.missions.mission import Mission
from ampi.simulation.outcomes import flown
from ampi.simulation.profiles import ALTITUDES
from ampi.trajectory import Status
from tests.support.truths import nominal_truth

OUTSIDE, POINTS = 0.2, 1000
PART = 24  # of every reference each 24th number is compared, another part at each point
NODAL = """
const [rows, part, done] = arguments;
Explorer.open(DATA).then((engine) => {
  const found = rows.map((p, point) => engine.tables.map((table) => {
    const { values, finalTime } = Table.nodal(table, engine.inSi(p));
    return [...values.filter((_, k) => k % part === point % part), finalTime];
  }));
  const told = rows.slice(0, 100).map((p) => {
    engine.references(p);
    return engine.compared(p).largest;
  });
  done({ found: JSON.stringify(found), agreement: Math.max(...told) });
});
"""
HOLES = """
const done = arguments[0];
Explorer.open(DATA).then((engine) => done([-0.5, 0.5].map((share) => {
  const p = engine.parameters.map(({ nominal, high, low }) => nominal + share * 0.5 * (high - low));
  engine.references(p);
  return engine.compared(p).hole;
})));
"""
FLOWN = """
const [p, world, done] = arguments;
Explorer.open(DATA).then((engine) => {
  engine.correct(p, world); // leaves nothing behind
  const found = Object.fromEntries(engine.modes.map(({ name }) => [name, engine.fly(p, world, name)]));
  found.corrected = engine.correct(p, world);
  done(JSON.stringify(found, (key, value) => (key === "track" ? undefined : value)));
});
"""


def points(mission: Mission, n: int) -> Any:
    """Inside and to 20 % outside of the table, SI."""
    low, high = np.array([(axis[0], axis[-1]) for axis in mission.grid_axes]).T
    reach = OUTSIDE * (high - low)
    return np.random.default_rng(7).uniform(low - reach, high + reach, (n, len(low)))


@pytest.fixture(scope="module")
def units(small_database: Path) -> Any:
    mission = read_dataset(small_database).mission
    return np.array([parameter.number.per_unit for parameter in mission.parameters])


def test_references_are_those_of_python(opened: Any, small_database: Path, units: Any) -> None:
    """To 1e-6 of each row's range at 1,000 points; and the flight code's to the last digits."""
    p = points(read_dataset(small_database).mission, POINTS)
    found = opened.execute_async_script(NODAL, (p / units).tolist(), PART)
    own = json.loads(found["found"])  # [points][modes][some columns, final time]
    assert found["agreement"] < 1e-12
    for k, mode in enumerate(MODES):
        guidance = ampi.load_guidance(small_database, mode=mode)
        table = guidance.table
        of_row = np.ptp(np.moveaxis(table.values, -2, 0).reshape(len(table.layout), -1), axis=1)
        ranges = np.tile(of_row, table.values.shape[-1])
        for point, told in enumerate(p):
            reference, column = guidance.reference(told), slice(point % PART, None, PART)
            nodal, final_time = np.array(own[point][k][:-1]), own[point][k][-1]
            error = np.abs(nodal[: len(ranges[column])] - reference.nodal.T.reshape(-1)[column])
            assert np.all(error < 1e-6 * ranges[column])
            assert abs(final_time - reference.final_time) < 1e-6 * np.ptp(table.final_time)


def test_flights_end_where_those_of_python_end(
    opened: Any, small_database: Path, units: Any
) -> None:
    """In a world that differs; the page's plant has steps of 1 s, that of campaigns 0.5 s."""
    mission = read_dataset(small_database).mission
    p = points(mission, 1)
    wind = np.zeros((2, 1, len(ALTITUDES)))
    wind[0] = 20.0
    numbers = {"density_factor": 1.05, "lift_factor": 0.98, "drag_factor": 1.02}
    truth = nominal_truth(p, wind=wind, **numbers)
    told = [1.05, 0.98, 1.02, 20.0, 0.0]
    found = json.loads(opened.execute_async_script(FLOWN, (p[0] / units).tolist(), told))
    for mode in MODES:
        guidance = ampi.load_guidance(small_database, mode=mode, cycle=1.0)
        own, page = flown(mission, guidance, truth, 5.0), found[mode.value]
        assert page["arrives"]
        for name in ("miss", "along", "across"):
            assert 1e3 * page[name] == pytest.approx(own[name][0], abs=5.0)
        assert page["altitude"] == pytest.approx(own["altitude_error"][0], abs=5.0)
    assert found["corrected"]["miss"] < 0.5 * found["ampi"]["miss"]


def test_a_table_with_holes_opens_and_says_where_it_borrows(
    opened: Any, page: Path, small_database: Path, tmp_path: Path
) -> None:
    dataset = read_dataset(small_database)
    status = dataset.status.copy()
    status[2, 2] = int(Status.TARGET_MISSED)
    holed = tmp_path / "holed.html"
    holed.write_text(explore(replace(dataset, status=status)), encoding="utf-8")
    opened.get(holed.as_uri())
    try:
        low, high = opened.execute_async_script(HOLES)
    finally:
        opened.get(page.as_uri())
    assert (low, high) == (False, True)


def test_the_flight_code_is_that_of_its_sources(tmp_path: Path) -> None:
    """The binary that is shipped, built anew where there is a compiler for it."""
    if shutil.which("clang") is None or shutil.which("wasm-ld") is None:
        pytest.skip("NOT CHECKED: no clang and wasm-ld, flight.wasm may be older than its sources")
    told = subprocess.run(["clang", "--version"], check=True, capture_output=True, text=True)
    if "version 14." not in told.stdout:
        pytest.skip("NOT CHECKED: flight.wasm is clang 14's, another one writes other bytes")
    folder = Path(ampi.__file__).parent / "explorer" / "wasm"
    subprocess.run([folder / "build", tmp_path / "flight.wasm"], check=True)
    assert (tmp_path / "flight.wasm").read_bytes() == (folder / "flight.wasm").read_bytes()
