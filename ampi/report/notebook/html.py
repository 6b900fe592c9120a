"""A sheet and its sketch as HTML for a notebook: escaped, without scripts, in the page's own colours.

The table stands alone where matplotlib is not installed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from html import escape
from importlib import import_module
from typing import Any

from ampi.report.notebook.sheets import Sheet, sheet_of

SKETCHES = "ampi.report.notebook.sketches"
FRAME = "display:flex;flex-wrap:wrap;gap:1em;align-items:flex-start;max-width:100%;"
TITLE = "font-weight:600;font-size:1.05em;"
SENTENCE = "opacity:.75;margin:.15em 0 .4em;"
# a line that is seen on white and on black alike
CELL = "border-bottom:1px solid rgba(128,128,128,.35);padding:.2em .8em .2em 0;text-align:left;"
HEAD = f"{CELL}font-weight:400;opacity:.75;white-space:nowrap;vertical-align:top;"
WORDS = "flex:1 1 22em;max-width:36em;overflow-x:auto;"
FONTS = "'DejaVu Sans', Verdana, sans-serif"
DRAWING = "width:100%;height:auto;fill:currentColor;"
PICTURE = "flex:1 1 22em;min-width:16em;max-width:34em;"


def html_of(value: Any) -> str:
    """What a notebook shows of `value`."""
    sheet = sheet_of(value)
    rows = "".join(
        f'<tr><th scope="row" style="{HEAD}">{escape(name)}</th>'
        f'<td style="{CELL}">{escape(text)}</td></tr>'
        for name, text in sheet.rows
    )
    return (
        f'<div style="{FRAME}"><div style="{WORDS}">'
        f'<div style="{TITLE}">{escape(sheet.title)}</div>'
        f'<div style="{SENTENCE}">{escape(sheet.sentence)}</div>'
        f'<table style="border-collapse:collapse;"><tbody>{rows}</tbody></table></div>'
        f"{_picture(value, sheet)}</div>"
    )


def _picture(value: Any, sheet: Sheet) -> str:
    try:
        sketches = import_module(SKETCHES)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "matplotlib":
            raise
        return ""
    drawing = in_page(sketches.sketch_of(value), sketches.INKS, sheet.figure)
    return f'<div style="{PICTURE}">{drawing}</div>'


def in_page(svg: str, inks: Mapping[str, str], words: str) -> str:
    """An SVG file as an element of a page: `inks` of paper as those of a page.

    Names of groups are dropped, for a page may hold many such drawings; what is referred to keeps its
    name, which is a digest of what it is.
    """
    body = re.sub(r"<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    body = re.sub(r'<g id="[^"]*"', "<g", body).replace("'DejaVu Sans'", FONTS)
    for paper, page in inks.items():
        body = body.replace(paper.lower(), page)
    told = f'<svg role="img" aria-label="{escape(words)}" style="{DRAWING}" '
    return body.replace("<svg ", told, 1)
