"""Files and functions that a reader takes in at once, and no module that nothing leads to."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("ampi", "database")
FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
FILE_LINES = 400
FUNCTION_LINES = 60  # its docstring included
# what is open still; the lists may only shrink
LONG_FILES: set[str] = set()
LONG_FUNCTIONS: set[str] = set()
UNREACHED: set[str] = {"ampi.simulation.estimates.sensitivity"}

# what people start and import: the packages, the commands, the scripts, and what the pages show
DOORS = {"ampi", "ampi.cli.__main__", "database"}
SCRIPTS = sorted((ROOT / "scripts").glob("*.py"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
SHOWN = {
    name
    for page in PAGES
    for name in re.findall(
        r"^(?:from|import) ((?:ampi|database)[\w.]*)", page.read_text("utf-8"), re.MULTILINE
    )
}


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def functions(path: Path) -> dict[str, int]:
    """Lines of every function and method of a file, decorators left out."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {
        f"{module_of(path)}.{node.name}": (node.end_lineno or node.lineno) - node.lineno + 1
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    }


def imports(path: Path, modules: set[str]) -> set[str]:
    """Modules of the house that a file imports, at the top or inside a function, or names in a text."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(
                node.value
            )  # `importlib.import_module("…")`, and what workers are started with
    return found & modules


def test_no_file_is_longer_than_a_reader_takes_in() -> None:
    lines = {str(p.relative_to(ROOT)): len(p.read_text("utf-8").splitlines()) for p in FILES}
    assert {name for name, count in lines.items() if count > FILE_LINES} <= LONG_FILES


def test_no_function_is_longer_than_a_screen() -> None:
    lines = {name: count for path in FILES for name, count in functions(path).items()}
    assert {name for name, count in lines.items() if count > FUNCTION_LINES} <= LONG_FUNCTIONS


def test_every_module_is_read_from_a_door() -> None:
    modules = {module_of(path): path for path in FILES}
    shown = {name for script in SCRIPTS for name in imports(script, set(modules))} | SHOWN
    reached: set[str] = set()
    open_ = [*DOORS, *(shown & set(modules))]
    while open_:
        module = open_.pop()
        if module not in reached:
            reached.add(module)
            open_ += imports(modules[module], set(modules))
            open_ += [module.rpartition(".")[0]] if "." in module else []
    assert set(modules) - reached <= UNREACHED


@pytest.mark.parametrize("path", [p for p in FILES if p.name != "__init__.py"], ids=module_of)
def test_a_module_says_what_it_is(path: Path) -> None:
    assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))


def test_the_reading_order_leads_through_files_that_are_there() -> None:
    page = ROOT / "docs" / "reading_order.md"
    lines = page.read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 120
    folder = ROOT
    for name in re.findall(r"`([\w/.]+(?:\.py|\.toml|/))`", "\n".join(lines)):
        if "/" in name:
            folder = ROOT / name if name.endswith("/") else (ROOT / name).parent
        here = folder if name.endswith("/") else folder / Path(name).name  # beside the last one
        assert here.exists(), name
