"""Campaigns by what was flown in them: a tracking law and a reference, in a world.

A world differs from the model if anything is not as the model has it, but for the parameters of the
mission, which guidance is told. Such worlds come first wherever schemes stand side by side: what a
scheme is worth in its own model says little.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ampi.onboard.reference import Mode
from ampi.report.published import PAPER_LAW, PAPER_WORLD
from ampi.simulation.flights import Flights
from ampi.simulation.uncertainties import CATALOGUE

UNCORRECTED = "none"
NOMINAL_NUMBERS = np.array([uncertainty.nominal for uncertainty in CATALOGUE])


def differs_from_model(flights: Flights) -> bool:
    """Whether something was true in their world that guidance cannot know."""
    return bool(flights.profiles) or bool(np.any(flights.numbers != NOMINAL_NUMBERS))


def is_corrected(flights: Flights) -> bool:
    """Whether their plans are corrected in flight."""
    return flights.correction != UNCORRECTED


def reference_words(flights: Flights) -> str:
    """Their reference, and that it is corrected."""
    return f"{flights.mode.value}, corrected" if is_corrected(flights) else flights.mode.value


def words(name: str) -> str:
    """A name of the code as a reader writes it."""
    return name.lower().replace("_", " ").replace(".", " ")


def in_order(campaigns: Mapping[str, Flights]) -> dict[str, Flights]:
    """Worlds that differ first; in a world laws as they come; of a law the corrected flights last."""
    worlds = list(dict.fromkeys(f.world_sha256 for f in campaigns.values()))
    laws = list(dict.fromkeys(f.law for f in campaigns.values()))
    modes = list(Mode)

    def place(item: tuple[str, Flights]) -> tuple[bool, int, int, bool, int]:
        f = item[1]
        return (
            not differs_from_model(f),
            worlds.index(f.world_sha256),
            laws.index(f.law),
            is_corrected(f),
            modes.index(f.mode),
        )

    return dict(sorted(campaigns.items(), key=place))


def by_world(campaigns: Mapping[str, Flights]) -> dict[str, dict[str, Flights]]:
    """World → its campaigns, in that order; two worlds of one name are told apart by their digests."""
    digests: dict[str, list[str]] = {}
    for f in campaigns.values():
        seen = digests.setdefault(f.world, [])
        if f.world_sha256 not in seen:
            seen.append(f.world_sha256)
    found: dict[str, dict[str, Flights]] = {}
    for name, f in in_order(campaigns).items():
        alone = len(digests[f.world]) == 1
        label = f.world if alone else f"{f.world} {f.world_sha256[:7]}"
        found.setdefault(label, {})[name] = f
    return found


@dataclass(frozen=True, eq=False)
class SchemeGroup:
    """The references of one law in one world, their plans corrected in one way or not."""

    world: str
    law: str
    correction: str  # of the plans in flight: none, …
    names: tuple[str, ...]  # of the campaigns, in order
    campaigns: Mapping[str, Flights]  # label → flights, in the same order

    @property
    def title(self) -> str:
        """World, law and correction."""
        corrected = f", corrected by {words(self.correction)}"
        return (
            f"{self.world}, {words(self.law)}{corrected if self.correction != UNCORRECTED else ''}"
        )


def scheme_groups(campaigns: Mapping[str, Flights]) -> tuple[SchemeGroup, ...]:
    """By world, law and correction; labels are the references, or the names of the only group."""
    own: dict[tuple[str, str, str], dict[str, Flights]] = {}
    for world, flown in by_world(campaigns).items():
        for name, f in flown.items():
            own.setdefault((world, f.law, f.correction), {})[name] = f
    if len(own) == 1:
        (alone,) = own
        return (SchemeGroup(*alone, tuple(campaigns), campaigns),)
    return tuple(
        SchemeGroup(*place, tuple(flown), by_reference(flown)) for place, flown in own.items()
    )


def by_reference(campaigns: Mapping[str, Flights]) -> dict[str, Flights]:
    """Campaigns named by their references, where these tell them apart."""
    modes = [f.mode.value for f in campaigns.values()]
    apart = len(set(modes)) == len(modes)
    return dict(zip(modes, campaigns.values(), strict=True)) if apart else dict(campaigns)


def like_the_paper(groups: Sequence[SchemeGroup]) -> SchemeGroup:
    """The group whose flights are drawn one by one: the paper's world, and its kind of law, if flown."""
    own = [g for g in groups if g.world == PAPER_WORLD]
    return next((g for g in own if g.law == PAPER_LAW), [*own, *groups][0])


def first_law(campaigns: Mapping[str, Flights]) -> dict[str, Flights]:
    """The campaigns of the law that comes first."""
    law = next(iter(campaigns.values())).law
    return {name: f for name, f in campaigns.items() if f.law == law}
