"""How a campaign is drawn: in the colour of its reference, darker if it is corrected in flight."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from matplotlib.colors import to_hex, to_rgb

from ampi.report.figures.style import MODE_STYLES, ModeStyle
from ampi.report.scheme_groups import is_corrected, reference_words
from ampi.simulation.flights import Flights

DARKER = 0.4  # of a colour that stays


def style_of(flights: Flights) -> ModeStyle:
    """Colour, marker and dashes."""
    style = MODE_STYLES[flights.mode]
    if not is_corrected(flights):
        return style
    red, green, blue = to_rgb(style.colour)
    return replace(style, colour=to_hex((DARKER * red, DARKER * green, DARKER * blue)), dashes="-")


def styles(campaigns: Iterable[Flights]) -> dict[str, ModeStyle]:
    """Reference in words, corrected or not → its style, in the order in which they come."""
    return {reference_words(flights): style_of(flights) for flights in campaigns}
