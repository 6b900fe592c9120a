"""The report as a page: well-formed, self-contained, accessible, and with judge()'s numbers."""

from __future__ import annotations

import re
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import pytest

from ampi.missions.mission import Mission
from ampi.onboard.table import GuidanceTable
from ampi.report.html import write_report
from ampi.simulation.monte_carlo import Flights
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
    assert write_report(path, mission, table, campaigns, EXTRA) == path
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
    assert len(images) == 12
    assert len({str(image["alt"]) for image in images}) == 12
    assert all(len(str(image["alt"])) > 60 for image in images)


def test_headers_have_scope_and_rows_are_whole(page: Page) -> None:
    assert all(a.get("scope") in ("col", "row", "rowgroup") for a in page.named("th"))
    assert page.named("html")[0]["lang"] == "en"
    assert [a for a in page.named("meta") if a.get("name") == "viewport"]
    assert set(map(len, page.rows)) <= {1, 4, 6}  # group heading; ours; ours and the paper's


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
    header = next(row for row in page.rows if row[0] == "Quantity")
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
    monkeypatch.setattr("ampi.report.html._drawn", lambda exhibits: [])  # the words alone
    other = mission.model_copy(update={"name": "other", "title": "Another vehicle"})
    alone = {"ampi": campaigns["ampi"]}
    text = write_report(tmp_path / "r.html", other, table, alone, {}).read_text(encoding="utf-8")
    assert "2016" not in text
    assert "surrogate" not in text


def test_a_report_without_campaigns_is_refused(
    tmp_path: Path, mission: Mission, table: GuidanceTable
) -> None:
    with pytest.raises(ValueError, match="expected at least one campaign"):
        write_report(tmp_path / "r.html", mission, table, {}, {})
