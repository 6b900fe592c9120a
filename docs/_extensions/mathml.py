"""Equations as MathML, which browsers render themselves: no script, no font, no network.

LaTeX is converted while the pages are built (latex2mathml). Functions that LaTeX sets apart from their
neighbours (V sin γ) are set apart here; numbers of equations stand at the right, where references lead.
"""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util.math import get_node_equation_number

NAMED = r"<m[io]>(?:sin|cos|tan|exp)</m[io]>"
BEFORE = re.compile(rf"(</(?:mi|mn|msub|msup|mfrac)>)({NAMED})")
BEHIND = re.compile(rf"({NAMED})(?!<mo|</m)")
THIN_SPACE = '<mspace width="0.17em"/>'


def mathml(latex: str, display: str) -> str:
    """The element `math` of a formula, `inline` or as a `block`."""
    found = convert(latex, display=display)
    if "<mi>&</mi>" in found or "<mtext>\\" in found:
        raise ValueError(f"expected LaTeX that latex2mathml knows, got {latex!r}")
    return BEHIND.sub(rf"\1{THIN_SPACE}", BEFORE.sub(rf"\1{THIN_SPACE}\2", found))


def visit_inline(translator: Any, node: nodes.math) -> None:
    """`$…$` of a page, `:math:` of a docstring."""
    translator.body.append(mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def visit_block(translator: Any, node: nodes.math_block) -> None:
    """`$$…$$`, with its number and its anchor if it has a label."""
    translator.body.append(translator.starttag(node, "div", CLASS="math"))
    equation = mathml(node.astext().strip(), "block")
    translator.body.append(f'<div class="equation">{equation}</div>')
    if node["number"]:
        number = get_node_equation_number(translator, node)
        translator.body.append(f'<span class="eqno">({number})')
        translator.add_permalink_ref(node, "Link to this equation")
        translator.body.append("</span>")
    translator.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """What Sphinx calls."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
