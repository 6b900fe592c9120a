"""What a team asks before it adopts a tool: licence, citation, version, types, and checks like ours."""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml
from jsonschema import Draft7Validator

import ampi
from ampi.release import RELEASE

ROOT = Path(__file__).parents[1]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
CITATION: dict[str, Any] = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
TEXT = {"type": "string", "minLength": 1}
PEOPLE = {
    "type": "array",
    "minItems": 1,
    "items": {
        "type": "object",
        "anyOf": [{"required": ["name"]}, {"required": ["family-names", "given-names"]}],
    },
}
CFF = {  # of the citation file format 1.2.0: what it requires, and of what we use the types
    "type": "object",
    "required": ["cff-version", "message", "title", "authors"],
    "properties": {
        "cff-version": {"const": "1.2.0"},
        "message": TEXT,
        "title": TEXT,
        "type": {"enum": ["software", "dataset"]},
        "version": TEXT,
        "authors": PEOPLE,
        "keywords": {"type": "array", "items": TEXT, "uniqueItems": True},
        "references": {
            "type": "array",
            "items": {
                "type": "object",
                "required": ["type", "title", "authors"],
                "properties": {
                    "authors": PEOPLE,
                    "doi": {"type": "string", "pattern": r"^10\.\d{4,9}/\S+$"},
                    "year": {"type": "integer"},
                },
            },
        },
    },
}


def test_one_version_everywhere() -> None:
    """pyproject.toml says it; where this fails alone, install again: the metadata are old."""
    said = PROJECT["project"]["version"]
    assert RELEASE == ampi.__version__ == version("ampi") == said == CITATION["version"]
    assert re.fullmatch(r"\d+\.\d+\.\d+(rc\d+)?", said)
    assert "version" not in PROJECT["project"].get("dynamic", ())


def test_no_other_file_says_a_version_of_its_own() -> None:
    told = re.compile(r"__version__ *= *['\"]|#define AMPI_RELEASE")
    files = [f for p in ("ampi", "database") for f in (ROOT / p).rglob("*.[chp]*") if f.is_file()]
    texts = {
        f: f.read_text("utf-8", errors="ignore") for f in files if f.suffix in (".py", ".c", ".h")
    }
    assert [f.name for f, text in texts.items() if told.search(text)] == []


def test_the_licence_is_the_one_that_is_named() -> None:
    assert PROJECT["project"]["license"] == CITATION["license"] == "BSD-3-Clause"
    text = (ROOT / "LICENSE").read_text("utf-8")
    assert text.startswith("BSD 3-Clause License\n")
    assert "Neither the name of the copyright holder" in text
    assert PROJECT["project"]["license-files"] == ["LICENSE"]
    assert not [c for c in PROJECT["project"]["classifiers"] if c.startswith("License ::")]


def test_the_citation_is_valid() -> None:
    assert [error.message for error in Draft7Validator(CFF).iter_errors(CITATION)] == []


def test_types_are_shipped() -> None:
    for package in ("ampi", "database"):
        assert (ROOT / package / "py.typed").is_file()
        assert "py.typed" in PROJECT["tool"]["setuptools"]["package-data"][package]
    assert "Typing :: Typed" in PROJECT["project"]["classifiers"]


def test_the_hooks_are_make_check() -> None:
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text("utf-8"))
    (repository,) = hooks["repos"]
    assert repository["repo"] == "local"  # nothing is fetched
    entries = [hook["entry"] for hook in repository["hooks"]]
    check = re.search(r"^check: (.+)$", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
    assert check is not None
    assert entries == [f"make {target}" for target in check[1].split()]
    assert {hook["language"] for hook in repository["hooks"]} == {"system"}


def test_the_pythons_of_ci_are_those_of_the_classifiers() -> None:
    classifiers = " ".join(PROJECT["project"]["classifiers"])
    named = set(re.findall(r"Python :: (3\.\d+)", classifiers))
    tried = set(re.findall(r"\b3\.\d+\b", (ROOT / ".ci" / "pythons").read_text("utf-8")))
    least = PROJECT["project"]["requires-python"].removeprefix(">=")
    assert named == tried | {least}
