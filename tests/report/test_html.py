"""The report as a page: well-formed, self-contained, accessible, and with judge()'s numbers."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from ampi.missions.mission import Mission
from ampi.onboard.table import GuidanceTable
from ampi.report.board import board
from ampi.report.exhibits import campaign_exhibits, database_exhibits
from ampi.report.html import write_report
from ampi.report.schemes_table import schemes_table
from ampi.report.text import verdict_text
from ampi.report.verdict_tables import coincident
from ampi.simulation.flights import Flights
from ampi.simulation.statistics import judge

VOID = {"meta", "img", "br", "link", "hr", "input"}
EXTRA = {"Git revision": "0123abc", "Database": "<b>not bold</b>.h5"}
Attributes = dict[str, str | None]


class Page(HTMLParser):
    """Collects tags and table rows, and checks that every tag is closed in order."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, Attributes]] = []
        self.rows: list[list[str]] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        elif tag in ("th", "td"):
            self.rows[-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data
        if "td" in self.open or "th" in self.open:
            self.rows[-1][-1] += data

    def named(self, tag: str) -> list[Attributes]:
        """Attributes of every `tag`."""
        return [attributes for name, attributes in self.tags if name == tag]


@pytest.fixture(scope="module")
def source(
    tmp_path_factory: pytest.TempPathFactory,
    mission: Mission,
    table: GuidanceTable,
    campaigns: dict[str, Flights],
) -> str:
    path = tmp_path_factory.mktemp("report") / "report.html"
    audit = {"Cases solved": "9 of 9"}
    assert write_report(path, mission, table, campaigns, EXTRA, audit=audit) == path
    assert path.stat().st_size < 12e6
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(source: str) -> Page:
    parsed = Page()
    parsed.feed(source)
    parsed.close()
    assert parsed.open == []
    return parsed


def test_nothing_comes_from_outside(source: str, page: Page) -> None:
    for tag, attributes in page.tags:
        for name in ("src", "href", "srcset", "action"):
            target = attributes.get(name)
            assert target is None or target.startswith(("data:image/", "#")), (tag, target)
    style = re.sub(r'src="data:[^"]*"', "", source)
    assert "@import" not in style
    assert "url(" not in style
    assert "<script" not in source


def test_links_have_targets(page: Page) -> None:
    anchors = {attributes["id"] for _, attributes in page.tags if "id" in attributes}
    assert {str(a["href"])[1:] for a in page.named("a")} <= anchors


def test_every_figure_is_described(page: Page) -> None:
    images = page.named("img")
    assert len(images) == 16
    assert len({str(image["alt"]) for image in images}) == 16
    assert all(len(str(image["alt"])) > 60 for image in images)


def test_headers_have_scope_and_rows_are_whole(
    page: Page, mission: Mission, campaigns: dict[str, Flights]
) -> None:
    assert all(a.get("scope") in ("col", "row", "rowgroup", "colgroup") for a in page.named("th"))
    assert page.named("html")[0]["lang"] == "en"
    assert [a for a in page.named("meta") if a.get("name") == "viewport"]
    group, axes, ours, with_the_papers, dispersions = 1, 4, 4, 6, 6
    groups = [*schemes_table(campaigns).groups, board(mission, campaigns).group]
    assert set(map(len, page.rows)) == {
        *(group, axes, ours, with_the_papers, dispersions),
        *(1 + one.width for one in groups),
    }


def test_numbers_are_those_of_judge(page: Page, campaigns: dict[str, Flights]) -> None:
    rows = {row[0]: row[1:] for row in page.rows}
    header = next(row[1:] for row in page.rows if row[0] == "Quantity")
    for name, flights in campaigns.items():
        column, verdict = header.index(name), judge(flights)
        for quantity, fraction in (
            ("25 to 50 km", verdict.rings[1]),
            ("outside", verdict.rings[3]),
            ("within 6.5 km", verdict.within[6.5e3]),
            ("all limits kept", verdict.limits_kept),
        ):
            assert rows[quantity][column] == f"{fraction.count} {fraction}"


def test_paper_columns_carry_table_5(page: Page) -> None:
    header = next(row for row in page.rows if "AMPI 2016" in row)
    nominal, ampi = header.index("nominal 2016"), header.index("AMPI 2016")
    printed = [row for row in page.rows if row[0] in ("25 to 50 km", "50 to 75 km", "outside")]
    assert [row[nominal].split()[0] for row in printed] == ["242", "12", "0"]
    assert [row[ampi].split()[0] for row in printed] == ["0", "0", "0"]
    assert [
        row[i].split()[0] for row in page.rows if row[0] == "within 6.5 km" for i in (ampi, nominal)
    ] == ["740", "163"]


def test_notices_and_provenance_are_there(source: str, page: Page) -> None:
    assert "The vehicle is a surrogate." in page.text
    assert "linear-quadratic" in page.text
    assert "not comparable one to one" in page.text
    assert "0123abc" in page.text
    assert "<b>not bold" not in source
    assert EXTRA["Database"] in unescape(source)


def test_other_missions_are_not_compared(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    mission: Mission,
    table: GuidanceTable,
    campaigns: dict[str, Flights],
) -> None:
    monkeypatch.setattr("ampi.report.html._drawn", lambda *_: [])  # the words alone
    target = mission.target.model_copy(update={"position_tolerance": 2e3})
    lighter = mission.vehicle.model_copy(update={"mass": 499.0})
    for change in ({"name": "other"}, {"vehicle": lighter}):  # a name alone makes no mission
        other = mission.model_copy(update={"target": target, **change})
        alone = {"ampi": campaigns["ampi"]}
        text = write_report(tmp_path / "r.html", other, table, alone, {}).read_text("utf-8")
        assert not re.search(r"2016|paper|Table 5|is a surrogate", text)
        assert "Passed: within 2 km of the target, 2.5 km of its altitude and 25 m/s" in text
        told = verdict_text(other, alone)
        assert not re.search(r"2016|paper|Table 5", told)


def test_captions_name_the_papers_figures_for_its_mission_alone(
    mission: Mission, table: GuidanceTable, campaigns: dict[str, Flights]
) -> None:
    exhibits = (*campaign_exhibits(mission, campaigns), *database_exhibits(mission, table))
    assert all(exhibit.after.startswith("Fig") for exhibit in exhibits)
    said = " ".join(f"{e.title} {e.caption} {e.alternative}" for e in exhibits)
    assert not re.search(r"Fig\.|paper|Table", said)


def test_the_page_says_what_was_built_drawn_and_passed(
    page: Page, mission: Mission, campaigns: dict[str, Flights]
) -> None:
    rows = [row for row in page.rows if row[0] == "speed_m_per_s"]
    assert rows[0] == ["speed_m_per_s", "4712.26", "-70, 0, +70", "3"]
    drawn = campaigns["ampi"].parameters[:, 3] - mission.entry.speed
    assert rows[1][1] == "all"
    shown = [float(cell) for cell in rows[1][2:5]]
    assert shown == pytest.approx([drawn.min(), drawn.mean(), drawn.max()], rel=1e-3)
    assert rows[1][5] == "100.0 %"
    assert campaigns["ampi"].drawn in page.text
    passed = next(row for row in page.rows if row[0] == "passed" and len(row) == 4)
    assert [int(cell.split()[0]) for cell in passed[1:]] == [
        int(np.count_nonzero(flights.passed)) for flights in campaigns.values()
    ]
    failed = next(row for row in page.rows if row[0] == "position")
    assert [int(cell.split()[0]) for cell in failed[1:]] == [
        int(np.count_nonzero(flights.faults["position"])) for flights in campaigns.values()
    ]
    assert "Cases solved" in page.text and "9 of 9" in page.text


@pytest.fixture(scope="module")
def of_many(
    tmp_path_factory: pytest.TempPathFactory,
    mission: Mission,
    table: GuidanceTable,
    many: dict[str, Flights],
) -> Page:
    """The words of a page of eight campaigns."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ampi.report.html._drawn", lambda *_: [])
        path = tmp_path_factory.mktemp("many") / "report.html"
        page = Page()
        page.feed(write_report(path, mission, table, many, {}).read_text("utf-8"))
    assert page.open == []
    return page


def test_the_wrong_world_comes_first_on_the_page(of_many: Page, many: dict[str, Flights]) -> None:
    groups = [row[0] for row in of_many.rows if len(row) == 1][:6]
    assert groups == [
        *("everything", "entry"),  # at a glance
        *(
            f"{world}, {law}"
            for world in ("everything", "entry")
            for law in ("linear quadratic", "drag sliding mode")
        ),
    ]
    first = next(i for i, row in enumerate(of_many.rows) if row == [groups[2]])
    schemes = [row for row in of_many.rows[first : first + 12] if len(row) > 1]
    assert [row[0] for row in schemes] == ["nominal", "ampi"] * 4
    abroad = judge(many["drag_sliding_mode abroad, ampi"])
    assert schemes[3][4].split()[0] == f"{abroad.within[25e3].percent:.1f}"
    sections = [a.get("id") for a in of_many.named("section")]
    assert sections[:3] == ["glance", "mission", "schemes"]


def test_the_papers_columns_stand_beside_its_own_world_alone(of_many: Page) -> None:
    heads = [row for row in of_many.rows if row[0] == "Quantity"]
    assert ["AMPI 2016" in row for row in heads] == [False] * 10 + [
        *(False, True, True, True, False) * 2
    ]
    assert "not comparable one to one" not in of_many.text  # a tracker of its kind was flown


def test_what_is_drawn_is_told_by_world(of_many: Page, many: dict[str, Flights]) -> None:
    (lift,) = [row for row in of_many.rows if row[0] == "lift_factor"]
    drawn = many["linear_quadratic abroad, ampi"].truth.numbers["lift_factor"]
    assert lift[1] == "everything"
    expected = [drawn.min(), drawn.mean(), drawn.max()]
    assert [float(cell) for cell in lift[2:5]] == pytest.approx(expected, rel=1e-3)
    assert lift[5] == "–"
    (speed,) = [row for row in of_many.rows if row[0] == "speed_m_per_s" and len(row) == 6]
    assert speed[1] == "all"
    for told in ("lift_factor: normal, 3σ 0.15", "everything (ffffffffffff)", "drag sliding mode"):
        assert told in of_many.text


def test_flights_are_drawn_of_the_papers_world_and_kind_of_law(
    mission: Mission, many: dict[str, Flights], campaigns: dict[str, Flights]
) -> None:
    for exhibit in campaign_exhibits(mission, many):
        assert exhibit.caption.endswith("World entry, drag sliding mode law.")
    home = {k: f for k, f in many.items() if "linear" in k}
    assert "World entry, linear quadratic law." in campaign_exhibits(mission, home)[0].caption
    abroad = {k: f for k, f in many.items() if f.world == "everything"}
    assert "World everything, linear" in campaign_exhibits(mission, abroad)[0].caption
    assert "World" not in campaign_exhibits(mission, campaigns)[0].caption


def test_where_every_world_differs_no_flights_are_said_to_be_as_modelled(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    mission: Mission,
    table: GuidanceTable,
    many: dict[str, Flights],
) -> None:
    monkeypatch.setattr("ampi.report.html._drawn", lambda exhibits, _: [*exhibits])
    monkeypatch.setattr("ampi.report.exhibits.Exhibit.source", "data:", raising=False)
    both = {name: f for name, f in many.items() if f.mode.value == "ampi"}
    abroad = {name: f for name, f in both.items() if f.world == "everything"}
    pages = [
        write_report(tmp_path / "r.html", mission, table, flown, {}).read_text("utf-8")
        for flown in (both, abroad)
    ]
    for heading, there in (
        ("In a world that differs from the model", [True, True]),
        ("In the world as modelled", [True, False]),
        ('id="campaign-states-wrong"', [True, True]),
        ('id="campaign-states"', [True, False]),
    ):
        assert [heading in page for page in pages] == there


def test_campaigns_that_coincide_are_named(campaigns: dict[str, Flights]) -> None:
    assert coincident(campaigns) == ()
    twin = replace(campaigns["ampi"], along=campaigns["ampi"].along + 0.5)
    (sentence,) = coincident({**campaigns, "twin": twin})
    assert sentence.startswith("twin coincides with ampi")
    other = replace(twin, along=campaigns["ampi"].along + 2.0)
    assert coincident({**campaigns, "other": other}) == ()


def test_a_report_without_campaigns_is_refused(
    tmp_path: Path, mission: Mission, table: GuidanceTable
) -> None:
    with pytest.raises(ValueError, match="expected at least one campaign"):
        write_report(tmp_path / "r.html", mission, table, {}, {})
