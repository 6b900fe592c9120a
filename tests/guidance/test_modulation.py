"""The angle of attack in the commands: asked for by any law, limited, added to a schedule or a row."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.cli.fly import schemes_of
from ampi.dataset import read_dataset
from ampi.guidance import Guidance
from ampi.loading import LAWS, guidance_of, load_guidance
from ampi.missions.mission import Mission
from ampi.simulation.headings import digest_of, law_name
from ampi.tracking.angle_limiter import AngleRange, ModulationLimits
from ampi.tracking.bank_limiter import BankLimits
from ampi.tracking.linear_quadratic import LinearQuadratic

Array = NDArray[np.float64]
CYCLE, STEPS = 0.5, 60


def commanded(guidance: Guidance, mission: Mission, off: Array, more_drag: float) -> Array:
    """Angles of attack (k,), commanded along the nominal reference, `off` (8,) it."""
    p = mission.nominal_parameters
    reference = guidance.reference(p).copy()
    guidance.begin(p)
    angles, drag = [], reference.rows[0] * 0.0 + 5.0
    if guidance.law.senses:
        drag = np.exp(reference.rows[guidance.table.layout.index("log_drag")])
    for time in 560.0 + CYCLE * np.arange(STEPS):
        state = np.array([np.interp(time, reference.times, row) for row in reference.rows[:8]])
        felt = np.interp(time, reference.times, drag) * more_drag
        sensed = felt * np.array([-1.0, 0.5 * np.cos(state[6]), 0.5 * np.sin(state[6])])
        angles.append(guidance.step(time, state + off, sensed).angle_of_attack)
    return np.array(angles)


@pytest.mark.parametrize("law", LAWS)
def test_every_law_modulates_within_the_limits_of_the_mission(
    database_file: Path, mission: Mission, law: str
) -> None:
    alone = load_guidance(database_file, law=law, cycle=CYCLE)
    guidance = load_guidance(database_file, law=law, modulate=True, cycle=CYCLE)
    off = np.array([1500.0, 0.0, 0.0, 60.0, 2e-3, 0.0, 0.0, 0.0])
    assert guidance.modulates
    assert not alone.modulates
    assert np.all(commanded(alone, mission, off, 0.7) == 0.0)
    angles = commanded(guidance, mission, off, 0.7)
    limits, rates = mission.limits, np.diff(angles, prepend=0.0) / CYCLE
    assert limits.angle_of_attack_change is not None
    assert limits.angle_of_attack_rate is not None
    assert 0.2 < np.abs(angles).max() / limits.angle_of_attack_change <= 1.0 + 1e-12
    assert np.abs(rates).max() <= limits.angle_of_attack_rate * (1.0 + 1e-12)
    assert np.abs(np.diff(rates)).max() <= limits.angle_of_attack_acceleration * CYCLE + 1e-12


def test_a_vehicle_without_a_schedule_is_told_the_row_and_the_change_within_its_bounds(
    database_file: Path, mission: Mission
) -> None:
    loaded = load_guidance(database_file, modulate=True)
    shape = (*loaded.table.final_time.shape, 1, loaded.table.segments.n_nodes)
    table = replace(
        loaded.table,
        values=np.concatenate([loaded.table.values, np.full(shape, 0.4)], axis=-2),
        layout=loaded.table.layout.with_angle_of_attack,
    )
    off = np.array([1500.0, 0.0, 0.0, 60.0, 2e-3, 0.0, 0.0, 0.0])
    changes = commanded(loaded.at_cycle(CYCLE), mission, off, 1.0)
    least, most = 0.4 + 0.5 * changes.min(), 0.4 + 0.5 * changes.max()
    steered = Guidance(
        table,
        loaded.limits,
        law=loaded.law,
        modulation=loaded.modulation,
        angles=AngleRange(least, most, 1.0),
        cycle=CYCLE,
    )
    angles = commanded(steered, mission, off, 1.0)
    assert angles == pytest.approx(np.clip(0.4 + changes, least, most), abs=1e-12)
    bank_alone = Guidance(table, loaded.limits, law=loaded.law, modulation=loaded.modulation)
    assert commanded(bank_alone, mission, off * 0.0, 1.0) == pytest.approx(0.4, abs=1e-4)


def test_schemes_are_told_apart(database_file: Path) -> None:
    dataset = read_dataset(database_file)
    (alone,) = schemes_of(dataset, "entry", "drag_shuttle", "ampi", "refuse").values()
    (steered,) = schemes_of(
        dataset, "entry", "drag_shuttle", "ampi", "refuse", modulate=True
    ).values()
    assert law_name(alone.guidance) == "drag_shuttle"
    assert law_name(steered.guidance) == "drag_shuttle_modulated"
    assert digest_of(alone.guidance) != digest_of(steered.guidance)


def test_a_mission_that_allows_no_change_is_refused(database_file: Path) -> None:
    dataset = read_dataset(database_file)
    none = {"angle_of_attack_change": None, "angle_of_attack_rate": None}
    limits = dataset.mission.limits.model_copy(update=none)
    mission = dataset.mission.model_copy(update={"limits": limits})
    object.__setattr__(dataset, "mission", mission)
    with pytest.raises(ValueError, match=r"modulate: expected False, .*angle_of_attack_change_deg"):
        guidance_of(dataset, modulate=True)
    assert guidance_of(dataset).modulation is None


def test_a_law_that_modulates_wants_limits(database_file: Path) -> None:
    loaded = load_guidance(database_file, modulate=True)
    with pytest.raises(ValueError, match=r"modulation: expected limits of the change"):
        Guidance(loaded.table, loaded.limits, law=LinearQuadratic(modulates=True))
    assert loaded.modulation == ModulationLimits(*np.radians([4.5, 5.0, 4.0]))
    assert isinstance(loaded.limits, BankLimits)
