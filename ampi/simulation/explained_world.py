"""A world file as its author reads it: every section and uncertainty explained."""

from __future__ import annotations

from collections.abc import Iterator

from ampi.missions.explained import comment, explained
from ampi.missions.text import assignment
from ampi.missions.units import in_units
from ampi.simulation.distributions import law_as_written
from ampi.simulation.uncertainties import CATALOGUE, SECTIONS, Uncertainty
from ampi.simulation.world_schema import told_of
from ampi.simulation.world_sections import WITH_PROFILE, WorldSections

LAWS = """
# Below, each is a number, the same for every flight, or a distribution:
#   { distribution = "normal", three_sigma = 0.2 }, with sigma instead, and with a mean
#   { distribution = "truncated", three_sigma = 0.2, low = 0.8, high = 1.2 }
#   { distribution = "uniform", low = 0.9, high = 1.1 }
#   { distribution = "discrete", values = [0.9, 1.1] }, and with probabilities
#   { distribution = "table", file = "draws.csv", column = "factor" }"""


def explained_world(sections: WorldSections) -> Iterator[str]:
    """Lines of TOML with comments that make the world."""
    yield from explained(sections, without=("laws", "profiles"))
    yield LAWS
    for section in SECTIONS:
        yield from ("", f"[{section}]")
        for uncertainty in (one for one in CATALOGUE if one.section == section):
            yield from comment(told_of(uncertainty))
            yield _assignment(sections, uncertainty)
        if section in WITH_PROFILE:
            yield from comment("CSV of a profile over altitude, on top of the others")
            given = section in sections.profiles
            line = assignment("table", sections.profiles.get(section, f"{section}.csv"))
            yield line if given else f"# {line}"


def _assignment(sections: WorldSections, uncertainty: Uncertainty) -> str:
    given = sections.law_of(uncertainty)
    if given is not None:
        return assignment(given[0], law_as_written(given[1]))
    if uncertainty.dimension is None:
        return f"# {assignment(uncertainty.key, uncertainty.nominal)}"
    unit, nominal = in_units(uncertainty.dimension, uncertainty.nominal)
    return f"# {assignment(f'{uncertainty.key}_{unit}', nominal)}"
