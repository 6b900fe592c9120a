"""Sphinx reads this: `make docs` builds the pages of this folder into build/docs."""

from __future__ import annotations

import sys
from importlib.metadata import version as installed_version
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.util.docstrings import prepare_docstring

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project = "ampi"
author = "the ampi developers"
project_copyright = "the ampi developers"
release = version = installed_version("ampi")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "mathml", "executed"]
myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 3
myst_links_external_new_tab = False
source_suffix = {".md": "markdown", ".ipynb": "notebook"}
exclude_patterns = ["_extensions"]
templates_path: list[str] = []
nitpicky = True
nitpick_ignore_regex = [("py:exc", r"\w+Error")]  # named where they are raised, public or not

math_numfig = False
math_eqref_format = "Eq. ({number})"
numfig = False

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # a docstring gives shapes and units; the signature gives the types
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"ampi {release}"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_copy_source = False
html_show_sphinx = False


def as_written(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """The docstring of a property, in whose first line napoleon takes a colon for the end of a type."""
    if what in ("attribute", "property"):
        lines[:] = prepare_docstring(obj.__doc__ or "")


def setup(app: Sphinx) -> None:
    """What Sphinx calls."""
    app.connect("autodoc-process-docstring", as_written, priority=600)
