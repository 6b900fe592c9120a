"""Executed notebooks as pages: text as it stands, code and what it gave; nothing is run.

A page shows of each output the richest kind that it can: HTML, SVG, PNG or text.
"""

from __future__ import annotations

import json
from typing import Any

from docutils import nodes
from myst_parser.parsers.sphinx_ import MystParser
from sphinx.application import Sphinx

FENCE = "`````"


class NotebookParser(MystParser):
    """Reads .ipynb by way of the Markdown that says the same."""

    supported = ("notebook",)

    def parse(self, inputstring: str, document: nodes.document) -> None:
        """Called by Sphinx with the text of the file."""
        cells = json.loads(inputstring)["cells"]
        super().parse("\n\n".join(map(cell_text, cells)), document)


def cell_text(cell: dict[str, Any]) -> str:
    """Markdown of a cell and its outputs."""
    source = "".join(cell["source"])
    if cell["cell_type"] != "code":
        return source
    code = f"{FENCE}python\n{source}\n{FENCE}"
    return "\n\n".join([code, *map(output_text, cell["outputs"])])


def output_text(output: dict[str, Any]) -> str:
    """Markdown of one output."""
    data = {kind: "".join(text) for kind, text in output.get("data", {}).items()}
    if "text/html" in data:
        return raw(data["text/html"])
    if "image/svg+xml" in data:
        return raw(data["image/svg+xml"])
    if "image/png" in data:
        return raw(f'<img alt="" src="data:image/png;base64,{data["image/png"].strip()}">')
    text = "".join(output.get("text", "")) or data.get("text/plain", "")
    return f"{FENCE}text\n{text.rstrip()}\n{FENCE}" if text.strip() else ""


def raw(html: str) -> str:
    """HTML that goes through as it is, in a box that scrolls."""
    return f'{FENCE}{{raw}} html\n<div class="output">\n{html}\n</div>\n{FENCE}'


def setup(app: Sphinx) -> dict[str, bool]:
    """What Sphinx calls."""
    app.add_source_parser(NotebookParser)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
