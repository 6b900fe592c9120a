"""Aitken relaxation: exact on a geometric sequence, and cautious everywhere else."""

from __future__ import annotations

import numpy as np
import pytest

from ampi.scp.literature.acceleration import AitkenRelaxation

STEP = np.array([[0.3, -0.1], [0.05, 0.2]])  # (n, n_x), trust radii


@pytest.mark.parametrize("ratio", (0.1, 0.3, 0.45))
def test_a_geometric_sequence_ends_in_one_step(ratio: float) -> None:
    length = AitkenRelaxation().length(ratio * STEP, STEP, 1.0)
    series = ratio * STEP * sum(ratio**k for k in range(60))
    assert length * ratio * STEP == pytest.approx(series)


def test_the_ratio_is_found_again_after_a_longer_step() -> None:
    ratio, longer = 0.4, 1.5
    # f(x) = (1 − λ)(x* − x): the step that follows a move of ω f
    following = STEP * (1.0 - longer * (1.0 - ratio))
    found = AitkenRelaxation().length(following, STEP, longer)
    assert found == pytest.approx(1.0 / (1.0 - ratio))


def test_a_first_step_a_turn_and_a_reversal_are_taken_whole() -> None:
    relaxation, across = AitkenRelaxation(), np.array([[0.1, 0.3], [-0.2, 0.05]])
    assert relaxation.length(STEP, None, 1.0) == 1.0
    assert relaxation.length(across, STEP, 1.0) == 1.0
    assert relaxation.length(-0.4 * STEP, STEP, 1.0) == 1.0


def test_a_step_that_the_trust_region_cut_is_taken_whole() -> None:
    cut = STEP / np.abs(STEP).max()
    assert AitkenRelaxation().length(0.4 * cut, cut, 1.0) == 1.0
    assert AitkenRelaxation().length(cut, 0.9 * cut, 1.0) == 1.0


def test_steps_that_hardly_shrink_are_lengthened_no_further_than_allowed() -> None:
    assert AitkenRelaxation(longest=2.0).length(0.9 * STEP, STEP, 1.0) == pytest.approx(2.0)
