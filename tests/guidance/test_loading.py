"""From the database file to the table that flies it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ampi.dataset import DatasetError, read_dataset
from ampi.guidance import Guidance
from ampi.loading import guidance_table, load_guidance
from ampi.missions.loading import load_mission, parse_mission
from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.tracking.bank_limiter import BankLimits

MODES = [mode for mode in Mode if mode is not Mode.HERMITE]  # no sensitivities in these tables


def test_every_vertex_of_the_table_is_its_optimum(database_file: Path, loaded: Guidance) -> None:
    dataset, table = read_dataset(database_file), loaded.table
    assert table.final_time.shape == dataset.shape == (3, 3)
    for case in range(9):
        index = np.unravel_index(case, dataset.shape)
        optimum = dataset.trajectory(case)
        values = table.values[index]
        assert np.array_equal(values[table.layout.states], optimum.states)
        assert np.array_equal(values[table.layout.bank_rate], optimum.bank_rate)
        assert np.array_equal(values[table.layout.gains], dataset.gains[index])
        assert table.final_time[index] == optimum.final_time
        measured = [axis[i] for axis, i in zip(table.axes, index, strict=True)]
        assert values[[3, 4], 0] == pytest.approx(measured, rel=1e-12)


def test_the_reference_of_a_vertex_is_the_optimum_between_its_nodes(
    database_file: Path, loaded: Guidance
) -> None:
    """LD→HD loses nothing: Eq. (31) against the mesh's own polynomials."""
    dataset = read_dataset(database_file)
    for case in (0, 4, 7):
        optimum = dataset.trajectory(case)
        reference = loaded.reference(optimum.states[[3, 4], 0])
        states, bank_rate = optimum.at(reference.times)
        size = np.abs(states).max(axis=1, keepdims=True)
        assert np.abs((reference.states - states) / size).max() < 1e-9
        assert np.abs(reference.bank_rate - bank_rate).max() < 1e-9
        assert reference.inside


def test_the_reference_begins_at_the_entry_state_inside_the_grid(
    mission: Mission, loaded: Guidance
) -> None:
    """Multilinear in p, and the first node of every optimum is its entry state."""
    entry = mission.entry_state + np.array([0.0, 0.0, 0.0, -31.0, 0.0017, 0.0])
    reference = loaded.reference(entry[[3, 4]])
    assert reference.inside
    assert reference.states[:6, 0] == pytest.approx(entry, rel=1e-12)


def test_limits_and_centre_are_the_missions(mission: Mission, loaded: Guidance) -> None:
    limits = mission.limits
    assert loaded.limits == BankLimits(
        limits.bank_angle, limits.bank_rate, limits.bank_acceleration
    )
    assert loaded.table.centre == (1, 1)
    assert loaded.cycle == 0.5


@pytest.mark.parametrize("mode", [*MODES, *(m.value for m in MODES)])
def test_modes_by_name_or_value(database_file: Path, mode: Mode | str) -> None:
    assert load_guidance(database_file, mode=mode).mode is Mode(mode)


def test_the_default_mode_is_ampi(loaded: Guidance) -> None:
    assert loaded.mode is Mode.AMPI


def test_an_unknown_mode_is_named(database_file: Path) -> None:
    with pytest.raises(
        ValueError, match=r"mode: expected one of nominal, mpi, ampi, .*, hermite, got 'quartic'"
    ):
        load_guidance(database_file, mode="quartic")


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"absent\.h5: no such file"):
        load_guidance(tmp_path / "absent.h5")


def test_a_hole_is_counted_and_its_message_told(database_file: Path) -> None:
    dataset = read_dataset(database_file)
    dataset.status[2, 1] = 3
    dataset.message[2, 1] = b"stopped for a reason; from elsewhere: stopped again"
    with pytest.raises(
        DatasetError,
        match=r"1 of 9 cases have no solution, the first is case 7: stopped for a reason\. A table",
    ):
        guidance_table(dataset)


def test_a_hole_flies_if_it_is_asked_to_and_is_told(database_file: Path) -> None:
    dataset = read_dataset(database_file)
    dataset.status[2, 1] = 3
    for array in (dataset.states, dataset.bank_rate, dataset.gains):
        array[2, 1] = np.nan
    dataset.final_time[2, 1] = np.nan
    table = guidance_table(dataset, "fly")
    whole = guidance_table(read_dataset(database_file))
    assert table.solved is not None
    assert np.argwhere(~table.solved).tolist() == [[2, 1]]
    assert np.array_equal(table.values[2, 1], whole.values[1, 1])  # at half a range, as its others
    assert table.final_time[2, 1] == whole.final_time[1, 1]
    others = table.solved
    assert np.array_equal(table.values[others], whole.values[others])
    assert np.array_equal(table.final_time[others], whole.final_time[others])


def test_a_whole_database_has_no_mask_and_an_empty_one_does_not_fly(database_file: Path) -> None:
    dataset = read_dataset(database_file)
    assert guidance_table(dataset, "fly").solved is None
    dataset.status[...] = 3
    with pytest.raises(DatasetError, match="9 of 9 cases have no solution"):
        guidance_table(dataset, "fly")


def test_what_to_do_with_holes_is_one_of_two_words(database_file: Path) -> None:
    with pytest.raises(ValueError, match="holes: expected refuse or fly, got 'yes'"):
        load_guidance(database_file, holes="yes")  # type: ignore[arg-type]


def test_longitudes_and_azimuths_among_the_axes_are_circular(database_file: Path) -> None:
    dataset = read_dataset(database_file)
    zone = "[[no_fly_zone]]\nlongitude_deg = 0.0\nlatitude_deg = 0.0\nradius_km = 100.0\n"
    text = load_mission("shefex3").toml
    text = text[: text.index("[grid]")].replace("[limits]", "azimuth_deg = -90.0\n[limits]") + zone
    for keys, circular in (
        (("speed_m_per_s", "azimuth_deg"), (1,)),
        (("longitude_deg", "target.longitude_deg"), (0, 1)),
        (("target.azimuth_deg", "no_fly_zone.0.longitude_deg"), (0, 1)),
        (("latitude_deg", "objective.longitude_weight_per_deg2"), ()),
        (("limits.bank_angle_deg", "no_fly_zone.0.latitude_deg"), ()),
    ):
        axes = "".join(f'"{key}" = [-0.1, 0.0, 0.1]\n' for key in keys)
        mission = parse_mission(f"{text}[grid]\n{axes}")
        assert guidance_table(replace(dataset, mission=mission)).circular == circular


def test_the_cycle_is_stated_or_the_nominal_one(database_file: Path) -> None:
    assert load_guidance(database_file).cycle == 0.5
    stated = load_guidance(database_file, cycle=0.1)
    assert stated.cycle == 0.1
