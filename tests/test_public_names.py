"""What `import ampi` and `import database` promise is there, and it is all that the pages use."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

import ampi
import database

ROOT = Path(__file__).parents[1]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
FACES = {"ampi": ampi, "database": database}
PUBLIC = [(face, name) for face in FACES.values() for name in face.__all__]
BLOCK = re.compile(r"^( *)```python\n(.*?)^\1```", re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize(("face", "name"), PUBLIC, ids=[f"{f.__name__}.{n}" for f, n in PUBLIC])
def test_every_public_name_is_there(face: ModuleType, name: str) -> None:
    assert getattr(face, name) is not None


def used(block: str) -> Iterator[tuple[str, str]]:
    """Module and name of all that a block of Python takes from the two packages."""
    tree = ast.parse(block)
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in FACES:
            yield from ((node.module or "", alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            for alias in node.names:
                room, _, below = alias.name.partition(".")
                if room in FACES and below:
                    yield room, below
        elif isinstance(node, ast.Attribute):
            owner = node.value.id if isinstance(node.value, ast.Name) else ""
            if owner in FACES:
                yield owner, node.attr


def not_public(module: str, name: str) -> bool:
    """Whether a page takes what the face does not hold, or another thing of the same name."""
    room = module.split(".")[0]
    if name not in FACES[room].__all__:
        return True
    return module != room and getattr(FACES[room], name).__module__ != module


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_uses_public_names_alone(page: Path) -> None:
    blocks = [match[2] for match in BLOCK.finditer(page.read_text(encoding="utf-8"))]
    found = {one for block in blocks for one in used(re.sub(r"^ *>>> ", "", block))}
    assert sorted(f"{module}: {name}" for module, name in found if not_public(module, name)) == []


def test_what_the_cellar_holds_is_seen() -> None:
    """A page that went past the face would be found."""
    block = "import ampi.scp.guess\nfrom ampi.guidance import NUMPY\nampi.nothing\ndatabase.build\n"
    found = {f"{m}: {n}" for m, n in used(block) if not_public(m, n)}
    assert found == {"ampi: scp.guess", "ampi.guidance: NUMPY", "ampi: nothing"}
