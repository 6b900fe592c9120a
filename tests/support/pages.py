"""Pages of the documentation, as blocks of code that a reader would copy.

A comment on the line before a block says what becomes of it, and is not shown:

    <!-- file: air.csv -->                     its text is the file of this name
    <!-- file: my.toml, from shefex3 -->       … with the sections of a shipped mission that it lacks
    <!-- not run: a week of computing -->      commands are known, with all their options; nothing runs
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib import resources
from itertools import pairwise
from pathlib import Path

from markdown_it import MarkdownIt

ROOT = Path(__file__).parents[2]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
NOTE = re.compile(r"<!-- (file|not run): (.+?) -->")
SECTION = re.compile(r"^\[+([\w.]+)\]+", re.MULTILINE)


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text, the line of the page, what its comment says."""

    language: str
    text: str
    line: int
    file: str = ""
    not_run: str = ""


def blocks_of(page: Path) -> list[Block]:
    """All blocks of a page in order; those of Sphinx's directives are none."""
    tokens = MarkdownIt("commonmark").parse(page.read_text(encoding="utf-8"))
    found, note = [], None
    for token in tokens:
        if token.type in ("fence", "code_block") and not token.info.startswith("{"):
            said = {note[1].replace(" ", "_"): note[2]} if note else {}
            assert token.map is not None
            found.append(Block(token.info, token.content, token.map[0] + 1, **said))
        note = NOTE.match(token.content) if token.type == "html_block" else None
    return found


def commands_of(block: Block) -> list[str]:
    """Lines of a shell, continued ones joined."""
    return [line for line in block.text.replace("\\\n", " ").splitlines() if line.strip()]


def on_top_of(mission: str, sections: str) -> str:
    """A mission with a name and sections of its own, and what it lacks from a shipped one."""
    text = (resources.files("ampi.missions") / f"{mission}.toml").read_text(encoding="utf-8")
    own = SECTION.findall(sections)
    lacked = ""
    begins = [*(match.start() for match in SECTION.finditer(text)), len(text)]
    for begin, end in pairwise(begins):
        (name,) = SECTION.findall(text[begin:end])
        if not any(name == section or name.startswith(f"{section}.") for section in own):
            lacked += text[begin:end]
    names, _, rest = sections.partition("[")
    return f"{names}{lacked}\n[{rest}"
