"""The plan of a build: which jobs there are, what each needs, in which order they are best run.

Nothing here is a list over the cases: a task is made when the schedule asks for it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from database.factory.jobs import AssembleBlock, SolveCase, SolveTogether
from database.factory.schedule import Task
from database.file.blocks import blocks_at
from database.plan.continuation import Cases, planned, streamed
from database.plan.prediction import corners
from database.records.campaign import Campaign
from database.records.record_files import load_block

TOGETHER = 32  # cases of a portion, at most: with half as many each takes a tenth longer
FEW = 6  # below, a case costs nearly what it costs alone


def planned_tasks(campaign: Campaign, kept: NDArray[np.bool_], width: int) -> Iterator[Task]:
    """Tasks that solve all cases but those `kept` (c,) and assemble the blocks.

    In the order in which they are to run: along the first axis from the centre outwards, so that blocks
    are assembled while others are solved, and no worker is idle at the end.
    """
    grid, found = campaign.grid, kept.copy()  # what is kept changes meanwhile
    before = 0
    for away, cases in streamed(grid):
        if away > before:
            yield from _assembling(campaign, before, found)
            before = away
        yield from _solving(campaign, cases[~found[cases]], width, found)
    yield from _assembling(campaign, before, found)


def _assembling(campaign: Campaign, away: int, found: NDArray[np.bool_]) -> Iterator[Task]:
    """Of the blocks whose last cases lie at a distance on the first axis."""
    grid = campaign.grid
    for block in blocks_at(grid.shape, grid.centre[0], away):
        cases = block.cases(grid.shape)
        whole = found[cases].all()
        if not whole or load_block(campaign.folder, block.number, campaign.label) is None:
            yield Task(AssembleBlock(campaign, block), tuple(cases))


def _solving(
    campaign: Campaign, cases: Cases, width: int, found: NDArray[np.bool_]
) -> Iterator[Task]:
    """Of cases of one layer.

    Few portions are made a multiple of the engine's `width`, so that all workers end together; none is
    cut too fine. A case starts from neighbours and from what lies between them and the centre
    (database.plan.prediction): where a neighbour was `found` kept, nothing else waits for the latter.
    """
    portions = -(-len(cases) // TOGETHER)
    if portions < 2 * width:
        portions = width * -(-portions // width)
    size = max(FEW, -(-len(cases) // max(1, portions)))
    for k in range(0, len(cases), size):
        portion = planned(campaign.grid, cases[k : k + size])
        needs = []
        for p in portion:
            needs.append(set(p.neighbours))
            if any(found[n] for n in p.neighbours):  # else they have waited for the others
                needs[-1].update(corner for _, corner in corners(campaign.grid, p.case))
        if campaign.together and portion[0].neighbours:
            yield Task(SolveTogether(campaign, tuple(portion)), tuple(sorted(set().union(*needs))))
        else:
            for p, wanted in zip(portion, needs, strict=True):
                yield Task(SolveCase(campaign, p), tuple(sorted(wanted)))
