"""Values in a notebook: well-formed, escaped, of judge's numbers; in xarray what the file says."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import xarray
from IPython.core.formatters import DisplayFormatter
from matplotlib.figure import Figure

import ampi
from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode, Reference, ReferenceGenerator
from ampi.onboard.row_layout import LINEAR_TRACKING
from ampi.onboard.table import GuidanceTable
from ampi.report.figures.misses import distribution, share_within
from ampi.report.notebook.sheets import sheet_of
from ampi.simulation.flights import Flights
from ampi.trajectory import Status, Trajectory

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture
def reference(table: GuidanceTable) -> Reference:
    return ReferenceGenerator(table, Mode.AMPI).reference([axis[0] for axis in table.axes])


@pytest.fixture
def optimum(mission: Mission, reference: Reference) -> Trajectory:
    states, rate = reference.nodal[:7].copy(), reference.nodal[7].copy()
    mesh = mission.pseudospectral_mesh
    return Trajectory(mesh, states, rate, reference.final_time, 1.0, Status.TARGET_MISSED)


@pytest.fixture
def flights(campaigns: dict[str, Flights], mission: Mission) -> Flights:
    return replace(campaigns["ampi"], mission_sha256=mission.digest)


@pytest.fixture
def values(
    mission: Mission, optimum: Trajectory, reference: Reference, flights: Flights
) -> dict[str, Any]:
    other = replace(flights, miss=2.0 * flights.miss)
    return {
        "mission": mission,
        "trajectory": optimum,
        "reference": reference,
        "flights": flights,
        "verdict": ampi.judge(flights),
        "difference": ampi.compare(flights, other),
    }


def test_a_notebook_shows_every_one_as_a_table_and_a_figure(values: dict[str, Any]) -> None:
    formatter = DisplayFormatter()
    for name, value in values.items():
        shown, _ = formatter.format(value)
        page = ElementTree.fromstring(shown["text/html"])  # well-formed as XML, thus as HTML
        rows = [tuple("".join(cell.itertext()) for cell in row) for row in page.iter("tr")]
        assert tuple(rows) == sheet_of(value).rows, name
        (drawing,) = page.iter(f"{SVG}svg")
        assert len(drawing.get("aria-label", "")) > 40
        assert {tag.tag.removeprefix(SVG) for tag in page.iter()}.isdisjoint({"script", "image"})
        assert len(shown["text/html"]) < 100_000, name


def test_its_ink_is_that_of_the_page(values: dict[str, Any]) -> None:
    for value in values.values():
        text = value._repr_html_()
        assert "currentColor" in text
        assert "#222222" not in text and "#000000" not in text and "#ffffff" not in text


def test_words_are_escaped(mission: Mission) -> None:
    title = "<script>alert('&')</script>"
    page = ElementTree.fromstring(mission.model_copy(update={"title": title})._repr_html_())
    assert title in "".join(page.itertext())
    assert not list(page.iter("script"))


def test_a_sheet_has_the_numbers_of_the_verdict(flights: Flights) -> None:
    verdict = ampi.judge(flights)
    for rows in (dict(sheet_of(flights).rows), dict(sheet_of(verdict).rows)):
        assert rows["passed"] == f"{verdict.passed.count}: {verdict.passed}"
        assert rows["within 6.5 km"] == f"{verdict.within[6.5e3].count}: {verdict.within[6.5e3]}"
    assert dict(sheet_of(verdict).rows)["median miss"].startswith(
        f"{verdict.misses.median.value / 1e3:.2g} ["
    )


def test_without_matplotlib_the_table_stands_alone(
    monkeypatch: pytest.MonkeyPatch, values: dict[str, Any]
) -> None:
    for module in [name for name in sys.modules if name.startswith("ampi.report.notebook.")]:
        if not module.endswith((".html", ".sheets")):
            monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    for value in values.values():
        page = ElementTree.fromstring(value._repr_html_())
        assert list(page.iter("tr")) and not list(page.iter(f"{SVG}svg"))
    with pytest.raises(ModuleNotFoundError, match=r"plot: expected matplotlib, .*ampi\[notebook\]"):
        _ = values["flights"].plot


def test_without_xarray_a_sentence_says_so(
    monkeypatch: pytest.MonkeyPatch, flights: Flights
) -> None:
    monkeypatch.delitem(sys.modules, "ampi.report.notebook.arrays", raising=False)
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(
        ModuleNotFoundError, match=r"to_xarray: expected xarray, .*ampi\[notebook\]"
    ):
        flights.to_xarray()


def test_flights_in_xarray_are_those_of_their_file(flights: Flights, tmp_path: Path) -> None:
    path = tmp_path / "flights.h5"
    ampi.save_campaigns(path, {"one": flights})
    data = flights.to_xarray()
    with xarray.open_dataset(path, group="one", engine="h5netcdf") as kept:
        assert set(data.variables) == set(kept.variables)
        for name, own in data.variables.items():
            there = kept[name]
            assert own.dims == there.dims, name
            assert own.attrs["units"] == there.attrs["units"], name
            assert own.attrs["long_name"] == there.attrs["long_name"], name
            if own.dtype.kind == "U":
                assert own.values.tolist() == [text.decode() for text in there.values.tolist()]
            else:
                assert np.array_equal(own.values, there.values, equal_nan=own.dtype.kind == "f")
        assert data.attrs["seed"] == kept.attrs["seed"] == flights.seed


def test_a_reference_in_xarray_is_a_copy_by_the_names_of_its_rows(reference: Reference) -> None:
    data = reference.to_xarray()
    assert [*data.data_vars] == [row.name for row in LINEAR_TRACKING.rows]
    assert [v.attrs["units"] for v in data.data_vars.values()] == [
        row.unit for row in LINEAR_TRACKING.rows
    ]
    before = reference.rows.copy()
    reference.rows[...] = 0.0  # the next entry
    assert np.array_equal(np.stack([v.values for v in data.data_vars.values()]), before)
    assert data["time"].values[-1] == reference.final_time == data.attrs["final_time"]


def test_a_trajectory_in_xarray_has_states_and_rate_over_its_nodes(optimum: Trajectory) -> None:
    data = optimum.to_xarray()
    assert data.attrs["status"] == "TARGET_MISSED"
    assert np.array_equal(data["time"], optimum.times)
    assert np.array_equal(data["speed"], optimum.states[3])
    assert data["bank_rate"].attrs == {"units": "rad/s", "long_name": "bank rate"}


@pytest.mark.parametrize("name", ["footprint", "misses", "altitude", "bank", "loads"])
def test_figures_need_no_mission(flights: Flights, name: str) -> None:
    figure = getattr(flights.plot, name)(
        uncorrected=replace(flights, correction="none", along=flights.along + 1e3)
    )
    assert isinstance(figure, Figure)
    assert "uncorrected" in {
        t.get_text().split(" (")[0] for t in figure.legends[0].get_texts()
    } or (
        name == "misses"  # by references
    )
    assert DisplayFormatter().format(figure)[0]["image/png"].startswith(b"\x89PNG")


def test_figures_against_the_mission_want_the_one_flown(flights: Flights, mission: Mission) -> None:
    assert isinstance(flights.plot.ground_track(mission), Figure)
    heavier = mission.model_copy(update={"title": "another"})
    with pytest.raises(ValueError, match="mission: expected the one that was flown, shefex3"):
        flights.plot.ground_track(heavier)
    with pytest.raises(TypeError, match="beside: expected Flights"):
        flights.plot.footprint(beside=3)


def test_a_sketch_counts_as_the_figure_does(flights: Flights) -> None:
    corners, shares = distribution(flights)
    distances, own = share_within(flights)
    at = np.searchsorted(corners, distances[1:-1], side="right") - 1
    assert own[1:-1] == pytest.approx(shares[at])
