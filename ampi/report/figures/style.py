"""One style for every figure: type sizes, one colour per guidance mode, and the way into a page.

Colours are Okabe and Ito's (2008), told apart under every common colour blindness; markers differ as
well, so that a grey print can be read. Figures are made through matplotlib's object interface: no
window, no current figure, nothing left behind in its settings.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec

from matplotlib import rc_context, rcdefaults, rcParams
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from ampi.onboard.reference import Mode
from ampi.outputs import written

P = ParamSpec("P")

DOTS_PER_INCH = 110
COLOURS = 256  # of a PNG: the lines of a figure have few, and their blends
LIMIT_COLOUR = "#B00020"
TARGET_COLOUR = "#000000"
DATABASE_COLOUR = "#5B7DB1"
INK = "#222222"

_SETTINGS: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.labelsize": 10.0,
    "axes.titlesize": 10.5,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.fontsize": 9.0,
    "legend.frameon": False,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.hashsalt": "ampi",
}


class ImageFormat(Enum):
    """How a figure is kept; in a page PNG for thousands of lines, SVG for a few."""

    PNG = "image/png"
    SVG = "image/svg+xml"
    PDF = "application/pdf"


@dataclass(frozen=True)
class ModeStyle:
    """Colour, marker and dash pattern of one guidance mode."""

    colour: str
    marker: str
    dashes: str | tuple[float, tuple[float, ...]]


MODE_STYLES = {
    Mode.NOMINAL: ModeStyle("#E69F00", "s", "-"),
    Mode.MPI: ModeStyle("#009E73", "^", (0.0, (6.0, 2.0))),
    Mode.AMPI: ModeStyle("#0072B2", "o", (0.0, (1.0, 1.0))),
    Mode.NEAREST: ModeStyle("#56B4E9", "v", (0.0, (1.0, 2.5))),
    Mode.QUADRATIC: ModeStyle("#CC79A7", "D", (0.0, (3.0, 1.5))),
    Mode.CUBIC: ModeStyle("#D55E00", "P", (0.0, (5.0, 1.0, 1.0, 1.0))),
    Mode.SECOND_DIFFERENCES: ModeStyle("#7A5195", "X", (0.0, (4.0, 1.0))),
    Mode.HERMITE: ModeStyle("#5B5B5B", "h", (0.0, (2.0, 1.0))),
}


# where a format says who made it, and the times that would differ from file to file
_MAKER = {ImageFormat.PNG: "Software", ImageFormat.SVG: "Creator", ImageFormat.PDF: "Creator"}
_TIMES: dict[ImageFormat, dict[str, str | None]] = {
    ImageFormat.PNG: {},
    ImageFormat.SVG: {"Date": None},
    ImageFormat.PDF: {"CreationDate": None},
}


@contextmanager
def _settings() -> Iterator[None]:
    """Matplotlib's defaults and ours above them, whatever a matplotlibrc asks for."""
    with rc_context():
        rcdefaults()
        rcParams.update(_SETTINGS)
        yield


def house_style(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Run a drawing function under the settings above; matplotlib's own stay as they were."""

    @wraps(draw)
    def styled(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with _settings():
            return draw(*args, **kwargs)

    return styled


class HouseFigure(Figure):
    """A figure that a notebook shows without pyplot, under the settings above."""

    def _repr_png_(self) -> bytes:
        return image_bytes(self)


def new_figure(width: float, height: float) -> Figure:
    """Empty figure of `width` × `height` (inches) on the Agg canvas, laid out without overlaps."""
    figure = HouseFigure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def image_bytes(
    figure: Figure, image_format: ImageFormat = ImageFormat.PNG, made_by: str = "ampi"
) -> bytes:
    """The figure as a file's content; the same figure gives the same bytes."""
    buffer, maker = io.BytesIO(), {_MAKER[image_format]: made_by}
    with _settings():
        figure.savefig(
            buffer,
            format=image_format.name.lower(),
            dpi=DOTS_PER_INCH,
            metadata={**maker, **_TIMES[image_format]},
        )
    return _lighter(buffer, maker) if image_format is ImageFormat.PNG else buffer.getvalue()


def _lighter(png: io.BytesIO, maker: dict[str, str]) -> bytes:
    """The same picture in `COLOURS` colours: a third of the bytes, and no eye tells them apart."""
    about, kept = PngInfo(), io.BytesIO()
    for key, value in maker.items():
        about.add_text(key, value)
    picture = Image.open(png).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    picture.save(kept, "png", optimize=True, pnginfo=about, dpi=(DOTS_PER_INCH, DOTS_PER_INCH))
    return kept.getvalue()


def save_figure(path: Path, figure: Figure, made_by: str) -> None:
    """Write a figure in the format that its name ends in, with the command that made it."""
    content = image_bytes(figure, ImageFormat[path.suffix[1:].upper()], made_by)
    with written(path) as temporary:
        temporary.write_bytes(content)


def data_uri(content: bytes, image_format: ImageFormat = ImageFormat.PNG) -> str:
    """An image as the `src` of an <img>, so that the page needs no second file."""
    return f"data:{image_format.value};base64,{base64.b64encode(content).decode('ascii')}"
