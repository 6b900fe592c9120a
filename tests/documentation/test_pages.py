"""Whatever stands on a page as code is run, in the order of the page, in one folder."""

from __future__ import annotations

import ast
import re
import shlex
import shutil
import subprocess
from contextlib import chdir
from pathlib import Path
from typing import Any

import pytest
import typer

import ampi
import database
from ampi.cli import app
from tests.support.command_line import run
from tests.support.databases import small_database
from tests.support.flight_code import COMPILER
from tests.support.pages import PAGES, ROOT, Block, blocks_of, commands_of, on_top_of

LANGUAGES = {"bash", "c", "python", "text", "toml"}
MAKE = (ROOT / "Makefile").read_text(encoding="utf-8")


@pytest.fixture(scope="session")
def nine_cases(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_database(tmp_path_factory)


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_block_of_a_page_runs(page: Path, nine_cases: Path, tmp_path: Path) -> None:
    blocks = blocks_of(page)
    if not blocks:
        return
    for name in ("shefex3.h5", "small.h5"):
        shutil.copy(nine_cases, tmp_path / name)
    names: dict[str, Any] = {"__name__": "page"}
    for block in blocks:
        place = f"{page.name}:{block.line}"
        assert block.language in LANGUAGES, f"{place}: a block of {block.language!r}"
        if block.not_run:
            check_block(block, place)
        else:
            run_block(block, place, tmp_path, names)


def run_block(block: Block, place: str, folder: Path, names: dict[str, Any]) -> None:
    file, _, mission = block.file.partition(", from ")
    text = on_top_of(mission, block.text) if mission else block.text
    if file:
        (folder / file).write_text(text, encoding="utf-8")
    if block.language == "python":
        with chdir(folder):
            exec(compile("\n" * (block.line) + text, place, "exec"), names)
    elif block.language == "bash":
        for line in commands_of(block):
            run_command(line, place, folder)
    elif block.language == "toml":
        assert file, f"{place}: of which file"
        is_mission = bool(re.search(r"^\[vehicle", text, re.MULTILINE))
        (ampi.load_mission if is_mission else ampi.load_world)(folder / file)
    else:
        assert file or block.language == "text", f"{place}: of which file"


def run_command(line: str, place: str, folder: Path) -> None:
    """`ampi …` in this process; the compiler; a comment may state the exit status."""
    program, *arguments = shlex.split(line, comments=True)
    status = re.search(r"# .*exit status (\d)", line)
    if program == "ampi":
        run(*arguments, cwd=folder, code=int(status[1]) if status else 0)
        return
    assert program in ("cc", "./loop"), f"{place}: {program} is not run: say so before the block"
    if COMPILER is None:
        pytest.skip("NO C COMPILER: what follows on this page is not tested here")
    command = [COMPILER if program == "cc" else program, *arguments]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)


def check_block(block: Block, place: str) -> None:
    if block.language == "python":
        check_imports(block.text)
    else:
        check_commands(block, place)


def check_imports(text: str) -> None:
    """It is Python, and what it imports is there."""
    tree = ast.parse(text)
    tree.body = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    exec(compile(tree, "imports", "exec"), {})


def check_commands(block: Block, place: str) -> None:
    """Commands, options and targets that are named exist."""
    assert block.language == "bash", f"{place}: {block.not_run}"
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    for line in commands_of(block):
        words = shlex.split(line, comments=True)
        if words[0] == "make":
            assert all(re.search(rf"^{word}:", MAKE, re.MULTILINE) for word in words[1:]), place
        elif words[0] == "ampi":
            options = {o for p in commands[words[1]].params for o in (*p.opts, *p.secondary_opts)}
            asked = {word.split("=")[0] for word in words[2:] if re.match(r"--?[a-z]", word)}
            assert asked <= options | {"--help"}, f"{place}: {asked - options}"


def test_the_readme_is_short_and_shows_two_figures() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) < 150
    figures = re.findall(r"!\[.+\]\((.+)\)", text)
    assert len(figures) == 2
    assert all((ROOT / figure).is_file() for figure in figures)


def test_pages_name_files_that_are_there() -> None:
    for page in PAGES:
        for name in re.findall(
            r"`((?:ampi|database|scripts|tests)/[\w/.]+)`", page.read_text("utf-8")
        ):
            assert (ROOT / name).exists(), f"{page.name}: {name}"


def test_the_readme_leads_to_pages_that_are_there() -> None:
    for link in re.findall(r"\]\(([^)#:]+)[)#]", (ROOT / "README.md").read_text("utf-8")):
        assert (ROOT / link).is_file(), link


def test_the_measured_tables_have_a_place_on_the_page() -> None:
    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    written = {
        name
        for script in (ROOT / "scripts").glob("*.py")
        for name in re.findall(r'write_section\([\w.]+, "([\w ]+)"', script.read_text("utf-8"))
    }
    assert {"results", "worlds", "flight code", "orders"} <= written
    for name in written | {"roads"}:
        assert page.count(f"<!-- {name}: begin -->") == page.count(f"<!-- {name}: end -->") == 1


def test_the_pages_of_the_site_are_all_in_its_index() -> None:
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    for page in PAGES[1:]:
        assert page.stem == "index" or re.search(rf"^{page.stem}$", index, re.MULTILINE), page.name


def test_the_reference_has_every_public_name() -> None:
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    told = set(re.findall(r"^\.\. auto\w+:: ([\w.]+)", page, re.MULTILINE))
    public = {*ampi.__all__, *(f"database.{name}" for name in database.__all__)}
    assert public - {"__version__"} == told
