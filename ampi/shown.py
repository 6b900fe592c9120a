"""Values that show themselves: in a notebook as a table and a small figure, on request in xarray.

How a value looks is known in `ampi.report.notebook`, which stands above every room that has one, what
flies among them. That room is named here and imported when a notebook asks, never before: the one who
asks stands above all rooms, so no arrow points upwards while anything flies. Formatters registered with
IPython would have to look for it in `import ampi`, and methods hung on the classes from above would be
there or not by what else was imported.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

HTML = "ampi.report.notebook.html"
ARRAYS = "ampi.report.notebook.arrays"
PLOTS = "ampi.report.notebook.plots"
OPTIONAL = ("matplotlib", "xarray")


def asked_for(module: str, what: str) -> Any:
    """A module of `ampi.report.notebook`, imported now for `what`.

    Raises
    ------
    ModuleNotFoundError
        In one sentence, if it needs an optional package that is not installed.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if missing not in OPTIONAL:
            raise
        raise ModuleNotFoundError(
            f"{what}: expected {missing}, which is not installed; try: pip install 'ampi[notebook]'",
            name=missing,
        ) from None


class Shown:
    """Shows itself in a notebook."""

    def _repr_html_(self) -> str:
        text: str = asked_for(HTML, "_repr_html_").html_of(self)
        return text


class Tabulated(Shown):
    """Goes into xarray as well."""

    def to_xarray(self) -> Any:
        """An `xarray.Dataset` with names, `units` and `long_name`; SI, rad.

        Raises
        ------
        ModuleNotFoundError
            If xarray is not installed.
        """
        return asked_for(ARRAYS, "to_xarray").dataset_of(self)
