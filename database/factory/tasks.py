"""The plan of a build: which jobs there are, what each needs, in which order they are best run.

Nothing here is a list over the cases: a task is made when the schedule asks for it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from database.factory.jobs import AssembleBlock, SolveCase, SolvePortion
from database.factory.schedule import Task
from database.file.blocks import blocks_at
from database.plan.continuation import Cases, streamed
from database.plan.prediction import between
from database.records.campaign import Campaign
from database.records.record_files import NOT_KEPT, Files, load_block

PORTION = 64  # cases of a portion, at most: twice as many are hardly faster, and later on the disk
FEW = 6  # below, a case costs nearly what it costs alone


def planned_tasks(campaign: Campaign, files: Files, width: int) -> Iterator[Task]:
    """Tasks that solve all cases but those kept in `files` and assemble the blocks.

    In the order in which they are to run: along the first axis from the centre outwards, so that blocks
    are assembled while others are solved, and no worker is idle at the end.
    """
    grid, found = campaign.grid, files != NOT_KEPT  # what is kept changes meanwhile
    before = 0
    for away, cases in streamed(grid):
        if away > before:
            yield from _assembling(campaign, before, found)
            before = away
        yield from _solving(campaign, cases[~found[cases]], width)
    yield from _assembling(campaign, before, found)


def _assembling(campaign: Campaign, away: int, found: NDArray[np.bool_]) -> Iterator[Task]:
    """Of the blocks whose last cases lie at a distance on the first axis."""
    grid = campaign.grid
    for block in blocks_at(grid.shape, grid.centre[0], away):
        cases = block.cases(grid.shape)
        whole = found[cases].all()
        if not whole or load_block(campaign.folder, block.number, campaign.label) is None:
            yield Task(AssembleBlock(campaign, block), cases)


def _solving(campaign: Campaign, cases: Cases, width: int) -> Iterator[Task]:
    """Of cases of one layer, each of which starts from what lies between it and the centre.

    Few portions are made a multiple of the engine's `width`, so that all workers end together; none is
    cut too fine.
    """
    portions = -(-len(cases) // PORTION)
    if portions < 2 * width:
        portions = width * -(-portions // width)
    size = max(FEW, -(-len(cases) // max(1, portions)))
    for k in range(0, len(cases), size):
        portion = cases[k : k + size]
        needs, numbers = between(campaign.grid, portion), tuple(portion.tolist())
        if len(needs):
            yield Task(SolvePortion(campaign, numbers), needs)
        else:  # the centre
            yield from (Task(SolveCase(campaign, case), needs) for case in numbers)
