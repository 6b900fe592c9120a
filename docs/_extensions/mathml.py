"""Equations as MathML, which browsers render themselves: no script, no font, no network.

LaTeX is converted while the pages are built (latex2mathml). Operators that LaTeX sets apart from their
argument (sin γ) are set apart here; numbers of equations stand at the right, as references find them.
"""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util.math import get_node_equation_number

NAMED = re.compile(r"(<m[io]>(?:sin|cos|tan|exp|ln|log|max|min|arctan)</m[io]>)(?!<mo|</m)")
THIN_SPACE = '<mspace width="0.17em"/>'


def mathml(latex: str, display: str) -> str:
    """The element `math` of a formula, `inline` or as a `block`."""
    found = convert(latex, display=display)
    if "<mi>&</mi>" in found or "<mtext>\\" in found:
        raise ValueError(f"expected LaTeX that latex2mathml knows, got {latex!r}")
    return NAMED.sub(rf"\1{THIN_SPACE}", found)


def visit_inline(translator: Any, node: nodes.math) -> None:
    """`$…$` of a page, `:math:` of a docstring."""
    translator.body.append(mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def visit_block(translator: Any, node: nodes.math_block) -> None:
    """`$$…$$`, with its number and its anchor if it has a label."""
    translator.body.append(translator.starttag(node, "div", CLASS="math"))
    translator.body.append(mathml(node.astext().strip(), "block"))
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
