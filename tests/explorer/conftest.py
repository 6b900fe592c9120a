"""A page of the small database, opened in a real headless browser."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from ampi.dataset import read_dataset
from ampi.explorer.explorer import explore
from tests.support import databases
from tests.support.browser import browser


@pytest.fixture(scope="session")
def small_database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return databases.small_database(tmp_path_factory)


@pytest.fixture(scope="package")
def page(small_database: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("explorer") / "explore.html"
    path.write_text(explore(read_dataset(small_database)), encoding="utf-8")
    return path


@pytest.fixture(scope="package")
def opened(page: Path) -> Iterator[Any]:
    """The page, drawn."""
    if shutil.which("chromium") is None or shutil.which("chromedriver") is None:
        pytest.skip("NOT CHECKED: no chromium and chromedriver, the explorer is seen by nobody")
    with browser() as driver:
        driver.get(page.as_uri())
        yield driver
