"""The figures over all schemes and worlds: how far they miss, why, where, and what corrections do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.report.exhibits import Exhibit, flight_exhibits
from ampi.report.figures import budget, corrected, end_map, sensitivity
from ampi.report.figures.misses import miss_distributions
from ampi.report.figures.style import ImageFormat
from ampi.report.scheme_groups import (
    by_world,
    differs_from_model,
    first_law,
    is_corrected,
    reference_words,
    scheme_groups,
    words,
)
from ampi.simulation.flights import Flights

MOST_MARKS = 600  # of a figure kept as SVG


def first_exhibit(campaigns: Mapping[str, Flights]) -> Exhibit:
    """All schemes in all worlds in one figure: how far from the target they end."""
    worlds, laws = ", ".join(by_world(campaigns)), {f.law for f in campaigns.values()}
    told = "colour is the reference, line style the law" if len(laws) > 1 else "colour: reference"
    dark = (
        ", darker what is corrected in flight" if any(map(is_corrected, campaigns.values())) else ""
    )
    return Exhibit(
        "misses",
        "Misses",
        f"Share of all flights that end within a distance of the target; {told}{dark}. A flight that "
        "did not reach the target speed never counts.",
        f"One panel for each world ({worlds}): rising curves, one per scheme, of the share of "
        "flights within a distance of the target, from 10 m to 1000 km on a logarithmic axis.",
        lambda: miss_distributions(campaigns),
        image_format=ImageFormat.SVG,
    )


def scheme_exhibits(mission: Mission, campaigns: Mapping[str, Flights]) -> tuple[Exhibit, ...]:
    """Where flights end, what misses come from, and what corrections do, if there are any."""
    corrections = [_corrections(mission, campaigns)] if corrected.pairs(campaigns) else []
    return (_map(mission, campaigns), *corrections, *_causes(mission, campaigns))


def _causes(mission: Mission, campaigns: Mapping[str, Flights]) -> tuple[Exhibit, ...]:
    explained = ", ".join(sensitivity.explained(campaigns))
    return (
        Exhibit(
            "budget",
            "Uncertainty budget",
            "Share of the variance of the miss along the track, in ranks, that goes with each number "
            "alone: the squares of the rank correlations below, of numbers drawn independently. What "
            "they do not explain is interaction, noise, and what is not monotonic.",
            f"Bars with intervals for {explained}: per cent of the variance of the miss along the "
            "track by each dispersed number, by all others, and not explained.",
            lambda: budget.budget_figure(mission, campaigns),
            image_format=ImageFormat.SVG,
        ),
        Exhibit(
            "sensitivity",
            "What misses come from",
            "Spearman's rank correlations with every number that differed from flight to flight. A "
            "flight that did not reach the target speed counts as the farthest; the miss along the "
            "track, positive beyond the target, is that of the others.",
            f"Bars with intervals for {explained}: rank correlations of the distance missed "
            "and of the signed miss along the track with each dispersed number.",
            lambda: sensitivity.sensitivity(mission, campaigns),
            image_format=ImageFormat.SVG,
        ),
    )


def _map(mission: Mission, campaigns: Mapping[str, Flights]) -> Exhibit:
    worlds, law = ", ".join(by_world(campaigns)), words(next(iter(campaigns.values())).law)
    marks = sum(f.n for own in end_map.shown(campaigns).values() for f in own.values())
    return Exhibit(
        "map",
        "Where flights end",
        f"End points of the {law} law around the target, each world at its own scale; distances "
        "are along great circles.",
        f"One map for each world ({worlds}) in longitude and latitude: end points around the "
        "target with their 95 percent covariance ellipses, the ellipses that hold 95 percent of "
        "all flights, and circles of the radii that are judged.",
        lambda: end_map.end_map(mission, campaigns),
        image_format=ImageFormat.SVG if marks <= MOST_MARKS else ImageFormat.PNG,
    )


def _corrections(mission: Mission, campaigns: Mapping[str, Flights]) -> Exhibit:
    pairs = ", ".join(corrected.pairs(campaigns))
    return Exhibit(
        "corrections",
        "Corrections in flight",
        "Each flight twice, on the same draws: its miss with its plan corrected over its miss without; "
        "and the change of the angle of attack that the corrections ask for, between its limits.",
        f"A row for each of {pairs}: a scatter plot on logarithmic axes of misses with over misses "
        "without correction, and curves of the change of the angle of attack over time.",
        lambda: corrected.corrections_of_campaigns(mission, campaigns),
    )


def wrong_world_exhibits(mission: Mission, campaigns: Mapping[str, Flights]) -> tuple[Exhibit, ...]:
    """The flights of the first world that differs, one by one, as those of the model's own world.

    Of the first law; where plans are corrected, AMPI with and without. None if no world differs, or if
    there is one group alone: its flights are drawn anyway.
    """
    wrong = {
        world: first_law(own)
        for world, own in by_world(campaigns).items()
        if differs_from_model(next(iter(own.values())))
    }
    if not wrong or len(scheme_groups(campaigns)) == 1:
        return ()
    world, flown = next(iter(wrong.items()))
    corrections = {f.correction for f in flown.values()}
    own = [f for f in flown.values() if f.mode is Mode.AMPI] if len(corrections) > 1 else []
    drawn = {reference_words(f): f for f in own or flown.values()}
    law = words(next(iter(flown.values())).law)
    return tuple(
        replace(
            exhibit,
            name=f"{exhibit.name}-wrong",
            caption=f"{exhibit.caption} World {world}, {law} law.",
            after="",
        )
        for exhibit in flight_exhibits(mission, drawn)
    )
