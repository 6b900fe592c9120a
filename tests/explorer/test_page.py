"""The page in a real browser: sliders are moved by the keyboard, numbers are read back."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ampi
from ampi.dataset import read_dataset
from ampi.explorer.explorer import explore
from tests.support.command_line import run
from tests.support.steered import steered_mission

A4 = {"printBackground": False, "paperWidth": 8.27, "paperHeight": 11.69}  # inches
WIDTHS = """
const done = arguments[0], root = document.documentElement;
setTimeout(() => done([root.scrollWidth, root.clientWidth]), 300);
"""


@pytest.fixture(scope="module")
def page(small_database: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With flights of a wrong world."""
    folder = tmp_path_factory.mktemp("page")
    mission, guidance = read_dataset(small_database).mission, ampi.load_guidance(small_database)
    schemes = {"everything": ampi.Scheme(guidance, "everything"), "entry": ampi.Scheme(guidance)}
    flights = ampi.fly_schemes(mission, schemes, n=12, seed=1, n_jobs=1)
    path = folder / "explore.html"
    path.write_text(explore(read_dataset(small_database), flights), encoding="utf-8")
    return path


@pytest.fixture
def drawn(opened: Any) -> Iterator[Any]:
    """The page as it is opened, its corrected flight flown."""
    opened.refresh()
    wait_for(opened, "corrected")
    yield opened
    told = [entry for entry in opened.get_log("browser") if entry["level"] != "INFO"]
    assert told == []


def wait_for(driver: Any, flag: str) -> None:
    from selenium.webdriver.support.wait import WebDriverWait

    WebDriverWait(driver, 60).until(
        lambda d: d.execute_script(f"return document.body.dataset.{flag}") == "1"
    )


def number(driver: Any, name: str) -> float:
    return float(driver.find_element("id", name).text.replace("−", "-"))


def page_text(driver: Any, place: str) -> str:
    return str(driver.find_element("css selector", place).text)


def press(driver: Any, name: str, key: str, times: int) -> None:
    """An arrow key with shift on a slider; until everything that follows from it is drawn."""
    from selenium.webdriver import Keys

    driver.execute_script("document.body.dataset.corrected = ''")
    driver.find_element("id", name).send_keys(Keys.SHIFT, *[key] * times)
    wait_for(driver, "corrected")


def test_it_opens_and_agrees_with_the_flight_code(drawn: Any) -> None:
    badge = drawn.find_element("id", "agreement")
    assert "agree" in badge.text
    assert badge.get_attribute("class") == "badge"
    assert float(badge.get_attribute("data-largest")) < 1e-12
    assert number(drawn, "miss-ampi") < 0.1
    assert len(drawn.find_elements("css selector", "svg path.land")) > 0


def test_a_slider_moves_the_entry_and_beyond_the_table_it_says_so(drawn: Any) -> None:
    from selenium.webdriver import Keys

    before = drawn.find_element("css selector", "#charts svg").get_attribute("outerHTML")
    slider = drawn.find_element("css selector", "#entry input").get_attribute("id")
    press(drawn, slider, Keys.ARROW_RIGHT, 12)
    assert drawn.find_element("css selector", "#charts svg").get_attribute("outerHTML") != before
    assert "Outside the hypercube" not in drawn.find_element("id", "cell").text
    press(drawn, slider, Keys.ARROW_RIGHT, 6)
    assert "Outside the hypercube" in drawn.find_element("id", "cell").text
    assert (
        number(drawn, "miss-ampi") < 0.1
    )  # it flies all the same, the corrected flight before or not
    drawn.find_element("id", "reset-entry").click()
    drawn.execute_script("document.body.dataset.corrected = ''")
    wait_for(drawn, "corrected")
    assert "Inside the hypercube" in drawn.find_element("id", "cell").text


def test_a_wrong_model_moves_every_reference_and_the_corrector_lands(drawn: Any) -> None:
    from selenium.webdriver import Keys

    press(drawn, "p-density", Keys.ARROW_RIGHT, 2)
    press(drawn, "p-lift", Keys.ARROW_LEFT, 1)
    assert "1.100" in drawn.find_element("id", "value-density").text
    for mode in ("nominal", "mpi", "ampi", "quadratic"):
        assert number(drawn, f"miss-{mode}") > 1.0
    assert number(drawn, "miss-corrected") < 0.2


def test_a_flight_of_the_cloud_shows_itself(drawn: Any) -> None:
    from selenium.webdriver import Keys

    cloud = drawn.find_element("css selector", "svg[tabindex='0']")
    assert len(cloud.find_elements("css selector", ".flight")) > 6
    drawn.execute_script("document.body.dataset.corrected = ''")
    cloud.send_keys(Keys.ARROW_RIGHT)
    wait_for(drawn, "corrected")
    told = drawn.execute_script("return [page.entry.values, page.world.values]")
    own = drawn.execute_script("return DATA.shown.flights.campaigns[0]")
    assert told == [own["parameters"][0], own["world"][0]]
    assert drawn.find_element("id", "value-density").text.startswith(f"{own['world'][0][0]:.3f}")


def test_keys_go_through_the_cloud_and_out_of_it(drawn: Any) -> None:
    """End is the flight that missed by most; Escape lets go of it."""
    from selenium.webdriver import Keys

    cloud = drawn.find_element("css selector", "svg[tabindex='0']")
    drawn.execute_script("document.body.dataset.corrected = ''")
    cloud.send_keys(Keys.END)
    wait_for(drawn, "corrected")
    miss = drawn.execute_script("return DATA.shown.flights.campaigns[0].miss")
    assert drawn.execute_script("return page.ends.chosen") == int(
        np.nanargmax(np.array(miss, float))
    )
    assert f"missed by {max(filter(None, miss))} km" in page_text(drawn, "figure.tall")
    cloud.send_keys(Keys.ESCAPE)
    assert not cloud.find_elements("css selector", ".chosen")


def test_the_cell_stands_under_its_slider(drawn: Any) -> None:
    from selenium.webdriver import Keys

    own, slider = (drawn.find_element("css selector", f"#entry .slider {s}") for s in ("", "input"))
    points = drawn.execute_script("return DATA.shown.parameters[0].points")
    press(drawn, slider.get_attribute("id"), Keys.ARROW_LEFT, 5)
    assert [float(own.get_attribute(f"data-{end}")) for end in ("low", "high")] == points[:2]
    assert own.get_attribute("data-clipped") == "false"
    press(drawn, slider.get_attribute("id"), Keys.ARROW_LEFT, 20)
    assert own.get_attribute("data-clipped") == "true"
    assert "outside" in own.get_attribute("class")


def test_differences_are_from_the_reference_that_is_chosen(drawn: Any) -> None:
    """One line for each other mode; the pointer reads one value of each."""
    from selenium.webdriver import ActionChains
    from selenium.webdriver.support.select import Select

    figure = drawn.execute_script("return page.planned.chart.own")
    for base in ("ampi", "nominal"):
        Select(figure.find_element("css selector", "select")).select_by_value(base)
        drawn.execute_async_script("requestAnimationFrame(() => setTimeout(arguments[0], 50))")
        colours = [
            line.get_attribute("style") for line in figure.find_elements("css selector", ".line")
        ]
        assert len(colours) == 3
        assert not any(f"--{base})" in colour for colour in colours)
    ActionChains(drawn).move_to_element(figure.find_element("css selector", "svg")).perform()
    assert len(figure.find_elements("css selector", ".dot")) == 3


@pytest.mark.parametrize("width", [400, 1300])
def test_nothing_is_wider_than_the_window(drawn: Any, width: int) -> None:
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 500}
    drawn.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    try:
        needed, given = drawn.execute_async_script(WIDTHS)
    finally:
        drawn.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert needed <= given


def test_it_holds_all_that_it_needs_and_prints(drawn: Any, page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    text = text.replace("http://www.w3.org/2000/svg", "")  # a name, and no address
    assert not [word for word in ("http://", "https://", "src=", "@import") if word in text]
    assert len(text) < 1.5e6
    printed = drawn.execute_cdp_cmd("Page.printToPDF", A4)
    sheets = len(re.findall(rb"/Type */Page\b", base64.b64decode(printed["data"])))
    assert sheets <= 3  # two, with the fonts that it was drawn for


def test_no_title_ends_the_script_that_it_stands_in(small_database: Path) -> None:
    dataset = read_dataset(small_database)
    mission = dataset.mission.model_copy(update={"title": "</script><!-- <script> & Co"})
    text = explore(replace(dataset, mission=mission))
    assert text.count("</script>") == text.count("<script>") == 3
    assert "<!--" not in text


def test_an_angle_of_attack_that_is_steered_is_refused(small_database: Path) -> None:
    dataset = replace(read_dataset(small_database), mission=steered_mission())
    with pytest.raises(ValueError, match=r"expected a schedule of the angle of attack.*steered"):
        explore(dataset)


def test_the_command_writes_it_and_refuses_flights_of_another_mission(
    small_database: Path, tmp_path: Path
) -> None:
    said = run("explore", str(small_database), "--output", "page.html", cwd=tmp_path).stdout
    assert said.startswith("page.html: ")
    run(
        "explore", str(small_database), "--output", "page.html", cwd=tmp_path
    )  # its own is replaced
    other = run("explore", str(small_database), str(small_database), cwd=tmp_path, code=2)
    assert "Traceback" not in other.stderr and other.stderr.count("\n") == 1
