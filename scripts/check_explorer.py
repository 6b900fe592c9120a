"""How true and how fast the explorer's page of a database is, in a headless Chromium.

python scripts/check_explorer.py demo/shefex3.h5            1,000 entries, to 20 % outside
python scripts/check_explorer.py demo/shefex3.h5 --json     print the numbers
python scripts/check_explorer.py demo/shefex3.h5 --figure explorer.png   a picture, too

Needs chromium, chromedriver and the extra `test`.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import ampi
from ampi.dataset import read_dataset
from ampi.explorer.explorer import MODES, explore

OUTSIDE = 0.2  # of an axis' range
PART = 31  # of every reference each 31st number is compared, another part at each entry
QUIET = (
    "headless=new",
    "no-sandbox",
    "disable-gpu",
    "disable-background-networking",
    "disable-sync",
)
COMPUTED = """
const [rows, part, done] = arguments, { engine } = window.page;
const chosen = (values, point) => [...values].filter((_, k) => k % part === point % part);
done(JSON.stringify(rows.map((p, point) => engine.tables.map(
  (table) => chosen(Table.nodal(table, engine.inSi(p)).values, point)))));
"""
TIMED = """
const [rows, done] = arguments, { page } = window, { engine } = page, world = page.world.values;
const middle = (list) => list.sort((a, b) => a - b)[list.length >> 1];
const timed = (action) => middle(rows.map((p) => {
  const begun = performance.now();
  action(p);
  return performance.now() - begun;
}));
done({
  agreement: Math.max(...rows.map((p) => { engine.references(p); return engine.compared(p).largest; })),
  references_ms: timed((p) => engine.references(p)),
  references_drawn_ms: timed((p) => page.drawReferences(engine.references(p).modes)),
  one_flight_ms: timed((p) => engine.fly(p, world, "ampi")),
  corrected_flight_ms: timed((p) => engine.correct(p, world)),
});
"""


def opened(path: Path, profile: str) -> Any:
    """The page in a browser, drawn."""
    from selenium.webdriver import Chrome, ChromeOptions
    from selenium.webdriver.chrome.service import Service
    from selenium.webdriver.support.wait import WebDriverWait

    options = ChromeOptions()
    options.binary_location = str(shutil.which("chromium"))
    for argument in (*QUIET, f"user-data-dir={profile}", "window-size=1300,1000"):
        options.add_argument(f"--{argument}")
    driver = Chrome(options=options, service=Service(str(shutil.which("chromedriver"))))
    driver.set_script_timeout(600)
    driver.get(path.as_uri())
    WebDriverWait(driver, 60).until(
        lambda d: d.execute_script("return document.body.dataset.ready")
    )
    return driver


def largest_errors(database: Path, p: Any, found: list[Any]) -> dict[str, float]:
    """Of each mode, in shares of a row's range."""
    errors = {}
    for k, mode in enumerate(MODES):
        guidance = ampi.load_guidance(database, mode=mode)
        rows = np.moveaxis(guidance.table.values, -2, 0).reshape(len(guidance.table.layout), -1)
        ranges = np.tile(np.ptp(rows, axis=1), guidance.table.values.shape[-1])
        ranges = np.append(ranges, np.ptp(guidance.table.final_time))
        worst = 0.0
        for point, told in enumerate(p):
            reference, part = guidance.reference(told), slice(point % PART, None, PART)
            own = np.append(reference.nodal.T.reshape(-1), reference.final_time)[part]
            worst = max(worst, float(np.max(np.abs(found[point][k] - own) / ranges[part])))
        errors[mode.value] = worst
    return errors


def show(driver: Any, figure: Path) -> None:
    """The page in denser air with less lift, as a picture."""
    from selenium.webdriver.support.wait import WebDriverWait

    driver.execute_script(
        "document.body.dataset.corrected = ''; page.world.values = [1.06, 0.98, 1, 15, 0]"
    )
    driver.execute_script("page.request()")
    WebDriverWait(driver, 60).until(
        lambda d: d.execute_script("return document.body.dataset.corrected") == "1"
    )
    size = {"width": 1300, "height": 960, "deviceScaleFactor": 1, "mobile": False}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    driver.execute_async_script("setTimeout(arguments[0], 1000)")
    driver.save_screenshot(str(figure))


def measured(database: Path, entries: int, seed: int, figure: Path | None) -> dict[str, Any]:
    """All numbers."""
    dataset = read_dataset(database)
    mission, units = dataset.mission, [p.number.per_unit for p in dataset.mission.parameters]
    low, high = np.array([(axis[0], axis[-1]) for axis in mission.grid_axes]).T
    reach = OUTSIDE * (high - low)
    p = np.random.default_rng(seed).uniform(low - reach, high + reach, (entries, len(low)))
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "explore.html"
        page.write_text(explore(dataset), encoding="utf-8")
        driver = opened(page, folder)
        try:
            shown = (p / units).tolist()
            found = json.loads(driver.execute_async_script(COMPUTED, shown, PART))
            timed = driver.execute_async_script(TIMED, shown[:200])
            if figure is not None:
                show(driver, figure)
        finally:
            driver.quit()
        size = page.stat().st_size / 1e6
    return {"page_mb": size, "largest_error": largest_errors(database, p, found), **timed}


def main() -> None:
    """Parse, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("database", type=Path)
    parser.add_argument("--entries", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--figure", type=Path, help="PNG of the page")
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    arguments = parser.parse_args()
    found = measured(arguments.database, arguments.entries, arguments.seed, arguments.figure)
    if arguments.json:
        print(json.dumps(found, indent=1))
        return
    for name, value in found.items():
        print(f"{name}: {value if isinstance(value, dict) else format(value, '.3g')}")


if __name__ == "__main__":
    main()
