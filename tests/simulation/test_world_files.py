"""World files: the shipped ones, the round trip of their text, and a sentence for every fault."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ampi.missions.loading import load_mission, parse_mission
from ampi.missions.mission import Mission
from ampi.simulation.uncertainties import CATALOGUE
from ampi.simulation.world import WorldError
from ampi.simulation.world_loading import SHELF, load_world, parse_world, shipped_worlds
from tests.support.missions import text_on_grid
from tests.support.worlds import HEAD, world, write_draws


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tables")
    write_draws(folder / "arctic_draws.csv")
    write_draws(folder / "low.csv", top=90)
    for name, text in {
        "short.csv": "altitude_m,factor\n0,1\n80000,1.1\n",
        "negative.csv": "altitude_m,factor\n0,1\n120000,-0.1\n",
        "falling.csv": "altitude_m,factor\n0,1\n0,1\n",
        "lift.csv": "lift\n1.1\n0.9\n",
        "zero.csv": "lift\n1.1\n0.0\n",
        "winds.csv": "density_0km,density_130km,wind_east_0km\n1,1,1\n",
        "typo.csv": "density_0km,densty_130km\n1,1\n",
        "undated.csv": "density_0km,density_130km\n1,1\n",
    }.items():
        (folder / name).write_text(text)
    return folder


@pytest.mark.parametrize(
    "name", ["arctic", "arctic_january", "entry", "everything", "factors", "hexeract"]
)
def test_shipped_worlds_load_and_their_text_makes_them_again(
    shefex3: Mission, tables: Path, name: str
) -> None:
    assert name in shipped_worlds()
    text = (SHELF.path / f"{name}.toml").read_text(encoding="utf-8")
    here = parse_world(text, folder=tables)
    assert here.name == name
    again = parse_world(here.toml, folder=tables)
    assert (again.toml, again.digest) == (here.toml, here.digest)
    assert again.in_words(shefex3) == here.in_words(shefex3)
    assert len(here.draw(shefex3, 3, 1)) == 3


def test_everything_has_the_sizes_of_its_title(shefex3: Mission) -> None:
    drawn = load_world("everything").draw(shefex3, 3000, 16)
    degree = 0.0174533
    for name, three_sigma in {
        "density_factor": 0.2,
        "lift_factor": 0.1,
        "drag_factor": 0.1,
        "mass_factor": 0.02,
        "angle_of_attack_error": degree,
        "navigation_altitude_bias": 100.0,
        "navigation_speed_bias": 0.5,
        "navigation_azimuth_bias": 0.02 * degree,
    }.items():
        assert 3.0 * drawn.numbers[name].std() == pytest.approx(three_sigma, rel=0.06)
    assert drawn.density is not None
    assert drawn.wind is not None
    assert 3.0 * drawn.density.std() == pytest.approx(0.1, rel=0.05)
    assert 3.0 * drawn.wind.std() == pytest.approx(60.0, rel=0.05)
    assert set(drawn.numbers["actuator_lag"]) == {0.5}
    assert set(drawn.numbers["actuator_delay"]) == {0.1}


def test_the_catalogue_is_what_a_file_may_say(shefex3: Mission) -> None:
    lines: dict[str, list[str]] = {}
    for uncertainty in CATALOGUE:
        lines.setdefault(uncertainty.section, []).append(f"{uncertainty.keys[-1]} = 1")
    body = "".join(f"[{section}]\n" + "\n".join(keys) + "\n" for section, keys in lines.items())
    body = body.replace("noise_length_m =", "noise_length_km =")
    numbers = world(body).draw(shefex3, 1, 1).numbers
    for uncertainty in CATALOGUE:
        assert numbers[uncertainty.name] == uncertainty.per_unit(uncertainty.keys[-1])
    assert len(numbers) == len(CATALOGUE)


def test_the_digest_knows_the_numbers_of_the_tables(tables: Path, tmp_path: Path) -> None:
    text = (SHELF.path / "arctic.toml").read_text(encoding="utf-8")
    write_draws(tmp_path / "arctic_draws.csv", days=range(1, 366, 29))
    here, there = (parse_world(text, folder=folder) for folder in (tables, tmp_path))
    assert here.toml == there.toml
    assert here.digest != there.digest


def test_a_file_is_found_by_its_path_with_its_tables_beside_it(tmp_path: Path) -> None:
    write_draws(tmp_path / "air.csv")
    path = tmp_path / "mine.toml"
    path.write_text(HEAD + '[draws]\ntable = "air.csv"\n')
    assert load_world(path).name == "w"


BELL = '{{ distribution = "normal", three_sigma = {} }}'.format
COLUMN = '{{ distribution = "table", file = "{}", column = "{}" }}'.format
FAULTS = {  # body of the file → its sentence
    f"[density]\nfactor = {BELL(-0.2)}": "density.factor.three_sigma: Input should be greater than 0",
    f"[density]\nfactor = {BELL(2.0)}": "density.factor: expected numbers greater than 0, got -4.4",
    "[density]\nfactor = 0.0": "density.factor: expected numbers greater than 0, got 0",
    "[density]\nnoise = nan": "density.noise: Input should be a finite number (got nan)",
    "[density]\nnoise = -0.1": "density.noise: expected numbers at least 0, got -0.1",
    "[density]\nfactr = 1.0": "density.factr: expected a name that is known here, such as factor;",
    "[densty]\nfactor = 1.0": "densty: expected a name that is known here, such as density",
    "[density]\ntable = 3": "density.table: Input should be a valid string (got 3)",
    "[[density]]\nfactor = 1": "density: expected a table, got [{'factor': 1}]",
    "[wind]\neast = 3.0": "wind.east: expected a speed with its unit in the key (east_m_per_s or",
    "[wind]\neast_km = 3.0": "wind.east_km: expected a name that is known here, such as east_km_per_s",
    "[wind]\neast_m_per_s = 3.0\neast_km_per_s = 1.0": "wind.east: given more than once, as",
    "[wind]\neast_m_per_s = true": "wind.east_m_per_s: expected a number, or a table with distri",
    "[wind]\neast_m_per_s = { sigma = 1.0 }": "wind.east_m_per_s: expected a number, or a table",
    '[wind]\neast_m_per_s = { distribution = "norml" }': "such as normal or uniform; got 'norml'",
    '[wind]\neast_m_per_s = { distribution = "normal", three_sigm = 1.0 }': "such as three_sigma; got",
    '[wind]\neast_m_per_s = { distribution = "normal" }': "expected either sigma or three_sigma",
    "[wind]\nnoise_length_m = 100.0": "wind.noise_length_m: expected numbers at least 1000 m, got 100 m",
    '[vehicle]\nmass_factor = { distribution = "uniform", low = 1.1, high = 0.9 }': "expected low < hi",
    '[vehicle]\nmass_factor = { distribution = "truncated", sigma = 1.0 }': "expected low or high",
    '[vehicle]\nmass_factor = { distribution = "truncated", sigma = 0.01, low = 2.0 }': "expected "
    "bounds that the normal law reaches",
    '[vehicle]\nmass_factor = { distribution = "discrete", values = [1.0, 1.1], probabilities = '
    "[0.5, 0.6] }": "probabilities: expected numbers from 0 that sum to 1, got [0.5, 0.6], which sum to",
    '[vehicle]\nmass_factor = { distribution = "discrete", values = [1.0], probabilities = '
    "[0.5, 0.5] }": "probabilities: expected 1, one for each value, got 2",
    "[navigation]\ndropout = 1.5": "navigation.dropout: expected numbers at least 0 and at most 1",
    "[navigation]\nlatency_s = -1.0": "navigation.latency_s: expected numbers at least 0 s, got -1 s",
    f"[actuator]\nlag_s = {BELL(0.1)}": '; distribution = "truncated" keeps to bounds',
    '[[correlation]]\nof = ["lift_factor", "drag_factor"]\nvalue = 0.5': "expected uncertainties that "
    "this world draws by a law of their own (it has none), got lift_factor",
    '[[correlation]]\nof = ["lift_factr", "drag_factor"]\nvalue = 0.5': "such as lift_factor or",
    '[[correlation]]\nof = ["lift_factor", "lift_factor"]\nvalue = 0.5': "expected different uncertain",
    '[[correlation]]\nof = ["lift_factor", "drag_factor"]\nvalue = 1.5': "less than or equal to 1",
    '[draws]\ntable = "none.csv"': "none.csv: expected a CSV file in",
    '[draws]\ntable = "winds.csv"': "expected density, wind_east and wind_north at the same altitudes",
    '[draws]\ntable = "typo.csv"': "got a column 'densty_130km'",
    '[draws]\ntable = "undated.csv"\nmonths = [1]': "undated.csv: expected a column 'day_of_year'",
    '[draws]\ntable = "low.csv"\nmonths = [13]': "draws.months.0: Input should be less than or equal",
    '[draws]\ntable = "low.csv"\nmonths = []': "draws.months: expected one or more months, 1 to 12",
    '[draws]\ntabel = "low.csv"': "draws: tabel: expected a name that is known here, such as table",
    '[density]\ntable = "negative.csv"': "negative.csv: expected factors on the density that",
    '[density]\ntable = "falling.csv"': "falling.csv: line 3, column altitude_m: expected more than 0",
    "[aerodynamics]\nlift_factor = "
    + COLUMN("lift.csv", "lft"): "lift.csv: expected a column 'lft', got lift",
    "[aerodynamics]\nlift_factor = "
    + COLUMN("zero.csv", "lift"): "lift_factor: expected numbers greater than 0, got 0 to 1.1",
}


@pytest.mark.parametrize("body", FAULTS)
def test_a_faulty_file_gets_its_sentence(tables: Path, body: str) -> None:
    with pytest.raises(WorldError, match=re.escape(FAULTS[body])) as told:
        world(body, folder=tables)
    assert str(told.value).startswith("w.toml: 1 faulty field(s)\n  ")


def test_correlations_that_cannot_be_together_are_refused() -> None:
    names = ["lift_factor", "drag_factor"]
    body = "[aerodynamics]\n" + "".join(f"{name} = {BELL(0.1)}\n" for name in names)
    body += f"[vehicle]\nmass_factor = {BELL(0.1)}\n"
    pair = "[[correlation]]\nof = {}\nvalue = {}\n".format
    for pairs, sentence in (
        (pair(names, 1.0), "expected a positive definite matrix of lift_factor, drag_factor"),
        (
            pair(names, 0.9)
            + pair(["drag_factor", "mass_factor"], 0.9)
            + pair(["mass_factor", "lift_factor"], -0.9),
            "got one whose least eigenvalue is -0.8",
        ),
        (pair(names, 0.5) + pair(names[::-1], 0.4), "drag_factor and lift_factor have one already"),
    ):
        with pytest.raises(WorldError, match=sentence):
            world(body + pairs)


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        ('"nrmal"', "entry.distribution: Input should be 'normal', 'uniform', 'corners' or 'none'"),
        ('"normal"\nscale = -1.0', "entry.scale: Input should be greater than 0 (got -1)"),
        ('"normal"\nscal = 1.0', "entry: scal: expected a name that is known here, such as scale"),
        ('"normal"\noffsets = 3', "entry.offsets: Input should be a valid dictionary (got 3)"),
    ],
)
def test_a_faulty_entry_gets_its_sentence(entry: str, sentence: str) -> None:
    with pytest.raises(WorldError, match=re.escape(sentence)):
        parse_world(f'name = "w"\ntitle = "W"\n[entry]\ndistribution = {entry}\n')


OF_THE_MISSION = {
    f"[entry.offsets]\ndensity_factor = {BELL(0.1)}": "got 'density_factor', an uncertainty that the "
    "mission does not know",
    f"[entry.offsets]\ntarget.longitude_deg = {BELL(0.1)}": "got 'target.longitude_deg', an uncertain",
    "[entry.offsets]\nspeed_m_per_s = 1\nspeed_km_per_s = 2": "speed is given already; remove one",
    f"[entry.offsets]\nlatitude_deg = {BELL(70.0)}": "entry.offsets.latitude_deg: expected offsets that "
    "the mission can have",
    '[density]\ntable = "short.csv"': "short.csv: expected altitudes from the target's, 23.5 km, to the "
    "entry altitude, 100.1 km, got 0 to 80 km",
    '[draws]\ntable = "low.csv"': "to the entry altitude, 100.1 km, got 0 to 90 km",
}


@pytest.mark.parametrize("body", OF_THE_MISSION)
def test_what_the_mission_does_not_know_is_told_before_the_first_flight(
    shefex3: Mission, tables: Path, body: str
) -> None:
    here = world(body, folder=tables)
    with pytest.raises(WorldError, match=re.escape(OF_THE_MISSION[body])):
        here.checked(shefex3)
    with pytest.raises(WorldError):
        here.draw(shefex3, 1, 1)


def test_a_mission_without_parameters_is_as_it_is() -> None:
    here = load_world("entry").draw(parse_mission(text_on_grid("")), 4, 1)
    assert here.parameters.shape == (4, 0)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"n": 0}, "n: expected at least one flight, a whole number; got 0"),
        ({"n": True}, "n: expected at least one flight, a whole number; got True"),
        ({"seed": -1}, "seed: expected a whole number, 0 or greater, got -1"),
        ({"first": 1.5}, "first: expected a whole number, 0 or greater, got 1.5"),
        ({"pool": "tunning"}, "pool: expected one of reported, tuning, got 'tunning'"),
    ],
)
def test_a_draw_of_nothing_is_refused(
    shefex3: Mission, arguments: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(ValueError, match=re.escape(sentence)):
        load_world("entry").draw(shefex3, **{"n": 1, "seed": 1, **arguments})


def test_no_file_and_no_text_are_told(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match=r"world: expected one of arctic, .* got 'evrything'"):
        load_world("evrything")
    with pytest.raises(WorldError, match="world: no file at"):
        load_world(tmp_path / "none.toml")
    (tmp_path / "bits.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(WorldError, match=r"bits\.toml: not a text file in UTF-8"):
        load_world(tmp_path / "bits.toml")
    with pytest.raises(WorldError, match="world: not valid TOML"):
        parse_world("name = ")


MSIS = """[nrlmsis]
date = "2026-01-15"
latitude_deg = 70.0
longitude_deg = -30.0
ap = 15.0
"""


def test_a_world_in_the_air_of_a_day_and_a_place(shefex3: Mission) -> None:
    """The same for every flight, of the air itself, and for a mission in that air next to none."""
    pytest.importorskip("pymsis")
    here = world(MSIS)
    drawn = here.draw(shefex3, 3, 1)
    assert drawn.density is not None
    assert drawn.wind is None
    assert np.array_equal(drawn.density[0], drawn.density[2])
    for kilometre, factor in {20: 0.92, 40: 0.69, 60: 0.56, 80: 0.62}.items():  # of January
        assert drawn.density[0, kilometre] == pytest.approx(factor, abs=0.015)
    own = here.draw(load_mission("shefex3_january"), 2, 1)
    assert own.density is not None
    assert own.density[0, 5:100] == pytest.approx(np.ones(95), abs=0.02)
    again = parse_world(here.toml)
    assert (again.toml, again.digest) == (here.toml, here.digest)
    assert any("NRLMSIS of 2026-01-15" in line for line in here.in_words(shefex3))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (MSIS.replace("2026-01-15", "15.1.2026"), "nrlmsis.date: expected a day as YYYY-MM-DD"),
        (MSIS.replace("70.0", "97.0"), "nrlmsis.latitude: Input should be .* 90 deg"),
        (MSIS.replace("ap = ", "app = "), "nrlmsis.app: Extra inputs are not permitted"),
    ],
)
def test_a_day_and_a_place_that_are_none(text: str, message: str) -> None:
    with pytest.raises(WorldError, match=message):
        world(text)
