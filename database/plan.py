"""The plan of a build: which jobs there are, what each needs, in which order they are best run."""

from __future__ import annotations

from collections.abc import Set

import numpy as np

from database.blocks import blocks
from database.campaign import Campaign
from database.continuation import PlannedCase, layers
from database.jobs import AssembleBlock, Job, SolveCase, SolveTogether
from database.prediction import corners
from database.records import load_block

TOGETHER = 32  # cases of a portion, at most: with half as many each takes a tenth longer
FEW = 6  # below, a case costs nearly what it costs alone


def planned_jobs(
    campaign: Campaign, kept: Set[int], width: int
) -> tuple[dict[str, Job], dict[str, list[str]]]:
    """Jobs that solve all cases but those `kept` and assemble the blocks, and what each job needs.

    In the order in which they are to run: along the first axis from the centre outwards, so that blocks
    are assembled while others are solved, and no worker is idle at the end.
    """
    jobs, needs = dict[str, Job](), dict[str, list[str]]()
    grid = campaign.grid
    open_blocks = [
        block
        for block in blocks(grid.shape)
        if any(case not in kept for case in block.cases(grid.shape))
        or load_block(campaign.folder, block.number, campaign.label) is None
    ]
    solved = set(kept)
    plan = layers(grid)
    away = np.abs(np.arange(grid.size) // (grid.size // grid.shape[0]) - grid.centre[0])
    for distance in range(grid.shape[0]):
        for layer in plan:
            here = [p for p in layer if away[p.case] == distance and p.case not in kept]
            _solving_jobs(campaign, here, width, kept, jobs, needs)
            solved.update(p.case for p in here)
        for block in list(open_blocks):
            cases = block.cases(grid.shape)
            if solved.issuperset(cases):
                jobs[f"block {block.number}"] = AssembleBlock(campaign, block)
                needs[f"block {block.number}"] = [case_name(c) for c in cases]
                open_blocks.remove(block)
    return jobs, needs


def _solving_jobs(
    campaign: Campaign,
    layer: list[PlannedCase],
    width: int,
    kept: Set[int],
    jobs: dict[str, Job],
    needs: dict[str, list[str]],
) -> None:
    """Add the jobs that solve cases of one layer.

    Few portions are made a multiple of the engine's `width`, so that all workers end together; none is
    cut too fine. A case starts from neighbours and from what lies between them and the centre
    (database.prediction): where a neighbour is kept, nothing else waits for the latter.
    """
    portions = -(-len(layer) // TOGETHER)
    if portions < 2 * width:
        portions = width * -(-portions // width)
    size = max(FEW, -(-len(layer) // max(1, portions)))
    for k in range(0, len(layer), size):
        portion = layer[k : k + size]
        for planned in portion:
            jobs[case_name(planned.case)] = SolveCase(campaign, planned)
            needs[case_name(planned.case)] = [case_name(n) for n in planned.neighbours]
            if not kept.isdisjoint(planned.neighbours):  # else they have waited for the others
                lost = [corner for _, corner in corners(campaign.grid, planned.case)]
                needs[case_name(planned.case)] += [case_name(n) for n in lost if n not in kept]
        if campaign.together and portion[0].neighbours:
            name = f"cases {', '.join(str(p.case) for p in portion)}"
            jobs[name] = SolveTogether(campaign, tuple(portion))
            needs[name] = sorted({n for p in portion for n in needs[case_name(p.case)]})
            for planned in portion:
                needs[case_name(planned.case)] = [name]


def case_name(case: int) -> str:
    """Name of the job that solves a case."""
    return f"case {case}"
