"""What is installed here: every package of pyproject.toml, and how to get what is not there."""

from __future__ import annotations

import json
import re
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest
from typer.testing import CliRunner

from ampi._native.engine import is_available
from ampi.cli import app, doctor

PROJECT = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["project"]


def names(requirements: list[str]) -> set[str]:
    return {re.split(r"[\[<>=;]", one)[0] for one in requirements}


def told() -> dict[str, dict[str, str]]:
    result = CliRunner().invoke(app, ["doctor", "--json"])
    assert result.exit_code == 0
    found: dict[str, dict[str, str]] = json.loads(result.stdout)
    return found


def test_it_names_what_the_project_needs() -> None:
    found = told()
    assert names(PROJECT["dependencies"]) <= set(found["software"])
    assert found["software"]["numpy"] == version("numpy")
    extras = set(PROJECT["optional-dependencies"])
    assert {"report", "cluster", "atmosphere"} <= set(found["extras"]) < extras
    for extra in ("report", "atmosphere"):
        for package in names(PROJECT["optional-dependencies"][extra]):
            assert f"{package} {version(package)}" in found["extras"][extra]
    assert found["engine"]["compiled engine"].startswith("there" if is_available() else "not there")
    assert found["blas"]


def test_what_is_not_there_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_installed", lambda package: None)
    monkeypatch.setenv("PATH", "")
    result = CliRunner().invoke(app, ["doctor"])
    assert result.exit_code == 0
    for extra in ("report", "cluster", "atmosphere"):
        assert f"try: pip install 'ampi[{extra}]'" in result.output
    assert re.search(r"h5dump +not there \(reads a database", result.output)
