"""The command line as a newcomer types it, on a small grid: from a mission file to a verdict."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from ampi.missions.loading import load_mission
from ampi.simulation.flights_file import load_campaigns
from ampi.simulation.statistics import AreaRatio, footprint_ratio
from ampi.simulation.world_loading import shipped_worlds
from ampi.trajectory import Status
from database.records.record_files import count_records
from tests.support.command_line import run, unwrapped
from tests.support.missions import coarse, small_mission

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a mission file and its database, made by `ampi build`."""
    where = tmp_path_factory.mktemp("cli")
    (where / "small.toml").write_text(small_mission().toml)
    built = run("build", "small.toml", "small.h5", cwd=where)
    assert "9 of 9 cases solved" in built.stdout
    assert built.stderr == ""  # no progress bar where there is no terminal
    return where


def test_missions_lists_what_is_shipped(tmp_path: Path) -> None:
    assert "shefex3" in run("missions", cwd=tmp_path).stdout


def test_worlds_lists_what_is_shipped(tmp_path: Path) -> None:
    lines = run("worlds", cwd=tmp_path).stdout.splitlines()
    assert [line.split()[0] for line in lines] == shipped_worlds()
    assert "Everything at once" in unwrapped("\n".join(lines))


def test_solve_prints_csv_plot_and_json(tmp_path: Path) -> None:
    done = run(
        "solve", "shefex3", "--csv", "optimum.csv", "--plot", "optimum.png", "--json", cwd=tmp_path
    )
    summary = json.loads(done.stdout)
    assert summary["status"] == "SOLVED"
    assert summary["iterations"] <= 25
    assert [row["iteration"] for row in summary["log"]] == list(range(1, summary["iterations"] + 1))
    assert summary["log"][-1]["cost"] == pytest.approx(summary["cost"])
    assert summary["reintegrated_position_error_m"] < 10.0
    rows = (tmp_path / "optimum.csv").read_text().splitlines()
    assert rows[0].startswith("time_s,altitude_m,longitude_deg")
    assert abs(float(rows[1].split(",")[1]) - 100_100.0) < 1e-6
    assert (tmp_path / "optimum.png").read_bytes().startswith(b"\x89PNG")


def test_audit_in_words_and_in_json(folder: Path) -> None:
    assert "9 solved" in run("audit", "small.h5", "--probes", "0", cwd=folder).stdout
    numbers = json.loads(run("audit", "small.h5", "--probes", "2", "--json", cwd=folder).stdout)
    assert numbers["position_error"]["worst"] < 10.0
    assert set(numbers["interpolation"]) == {"mpi", "ampi", "quadratic"}


def test_fly_gives_the_footprint_ratio_in_json_too(folder: Path) -> None:
    options = ("-n", "60", "--modes", "nominal,ampi", "-j", "1", "--cycle", "0.5")
    written = run("fly", "small.h5", *options, "--output", "two.h5", cwd=folder).stdout
    numbers = json.loads(run("fly", "small.h5", *options, "--json", cwd=folder).stdout)
    schemes = numbers["schemes"]
    assert schemes["nominal"]["footprint_ratio"] is None
    ratio = schemes["ampi"]["footprint_ratio"]
    flown = load_campaigns(folder / "two.h5")
    assert ratio == pytest.approx(asdict(footprint_ratio(flown["ampi"], flown["nominal"])))
    assert str(AreaRatio(**ratio)) in written


def test_guide_writes_the_reference_of_an_entry(folder: Path) -> None:
    done = run(
        "guide",
        "small.h5",
        "-p",
        "speed_km_per_s=4.74",
        "--csv",
        "r.csv",
        "--plot",
        "r.png",
        cwd=folder,
    )
    assert "final time" in done.stdout
    table = np.genfromtxt(folder / "r.csv", delimiter=",", names=True)
    assert len(table) == 601
    assert table["speed_m_per_s"][0] == pytest.approx(4740.0)
    assert table["speed_m_per_s"][-1] == pytest.approx(595.0, abs=1.0)


def test_a_command_loads_what_it_needs(folder: Path) -> None:
    """A process that imports the command line, guides and flies; what is loaded after each step."""
    program = """
import json, sys
from ampi.cli import app
heavy = ["numpy", "pydantic", "scipy", "casadi", "joblib", "matplotlib"]
loaded = []
def note():
    loaded.append([name for name in heavy if name in sys.modules])
note()
app(["guide", "small.h5"], standalone_mode=False)
note()
import ampi
from ampi.dataset import read_dataset
flights = ampi.fly(read_dataset("small.h5").mission, ampi.load_guidance("small.h5"), n=2, n_jobs=1)
note()
print(json.dumps(loaded))
"""
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, check=True
    )
    imported, guided, flown = json.loads(done.stdout.splitlines()[-1])
    assert imported == []
    assert guided == ["numpy", "pydantic"]
    assert flown == ["numpy", "pydantic", "scipy"]  # a normal law is drawn by its inverse


def test_guide_flags_an_entry_outside(folder: Path) -> None:
    done = run("guide", "small.h5", "--speed", "5000", cwd=folder, code=1)
    assert "outside the hypercube in speed: boundary trajectory" in done.stdout
    assert "warning: speed lies outside the hypercube by 156 % of its axis' range" in done.stderr
    assert "warning: FAR_OUTSIDE: The parameters lie outside" in unwrapped(done.stderr)
    near = run("guide", "small.h5", "--speed", "4800", "--json", cwd=folder)
    assert "warning: speed lies outside the hypercube by 12.7 % of its" in near.stderr
    found = json.loads(near.stdout)
    assert (found["outside"], found["health"]) == (["speed"], "BOUNDARY_REFERENCE")
    assert found["excess"] == {"speed": pytest.approx((4800.0 - 4782.26) / 140.0)}
    whole = run("guide", "small.h5", "--speed", "4782.26", "--json", cwd=folder)
    assert whole.stderr == ""
    assert json.loads(whole.stdout)["health"] == "GOOD"


def test_fly_and_report(folder: Path) -> None:
    kept = ("--output", "flights.h5", "--csv", "flights.csv", "--cycle", "0.5")
    told = run("fly", "small.h5", "-n", "20", *kept, cwd=folder).stdout
    assert "25 km" in told
    drawn = ["entry.speed: normal, 3σ 70 m/s", "entry.flight_path_angle: normal, 3σ 0.5 deg"]
    assert f"World entry: {'; '.join(drawn)}" in unwrapped(told)
    rows = (folder / "flights.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 1 + 4 * 20
    ampi = ("--modes", "ampi", "-j", "1", "--json", "--cycle", "0.5")
    numbers = json.loads(run("fly", "small.h5", "-n", "20", *ampi, cwd=folder).stdout)
    one = numbers["schemes"]["ampi"]
    assert (one["n"], one["law"], one["world"]) == (20, "linear_quadratic", "entry")
    heads = rows[0].split(",")
    ours = [row.split(",") for row in rows if row.startswith("ampi,")]
    passed = sum(row[heads.index("passed")] == "yes" for row in ours)
    assert one["passed"]["count"] == passed > 0
    assert one["footprint_ratio"] is one["against_nominal"] is None  # nothing to compare with
    run("report", "small.h5", "flights.h5", "--output", "report.html", cwd=folder)
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "surrogate" in page
    assert "<img" in page or "<svg" in page


WORLDS = ("--world", "everything,entry", "--law", "linear_quadratic,drag_shuttle")


def test_worlds_and_laws_side_by_side_and_one_flight_again(folder: Path) -> None:
    fly = ("fly", "small.h5", *WORLDS, "--modes", "ampi", "--cycle", "0.5")
    told = run(*fly, "-n", "6", "--output", "worlds.h5", cwd=folder).stdout
    assert told.index("everything, linear quadratic") < told.index("entry, linear quadratic")
    campaigns = load_campaigns(folder / "worlds.h5")
    assert len(campaigns) == 4
    before = (folder / "worlds.h5").read_bytes()
    assert run(*fly, "-n", "6", "--output", "worlds.h5", cwd=folder).stdout == told
    assert (folder / "worlds.h5").read_bytes() == before  # it is flown
    other = run(*fly, "-n", "5", "--output", "worlds.h5", cwd=folder, code=2).stderr
    assert "worlds.h5 holds results of another campaign (different flights (6 there" in other

    one = ("--world", "everything", "--law", "drag_shuttle", "--modes", "ampi", "--cycle", "0.5")
    flown = campaigns["everything drag_shuttle ampi"]
    drawn = run("fly", "small.h5", *one, "--case", "4", "--json", cwd=folder).stdout
    assert json.loads(drawn)["ampi"]["miss_m"] == flown.miss[4]  # to the bit
    assert json.loads(drawn)["ampi"]["truth"]["actuator_lag"] == 0.5
    again = ("--case", "4", "--output", "worlds.h5", "--csv", "log.csv")
    told = run(*fly, *again, cwd=folder).stdout
    assert unwrapped(told).count("as recorded, to the bit") == 4
    log = (folder / "log.csv").read_text(encoding="utf-8").splitlines()
    assert log[0].startswith("time_s,scheme,altitude_m,longitude_rad,")
    assert log[1].split(",")[:2] == ["0.000000", "everything linear_quadratic ampi"]
    run("fly", "small.h5", *one, "--case", "4", "--plot", "flight.png", cwd=folder)
    assert (folder / "flight.png").stat().st_size > 1e4


def test_the_corrections_of_one_flight_are_written_and_drawn(folder: Path) -> None:
    one = ("--world", "everything", "--modes", "ampi", "--correction", "bank", "--cycle", "0.5")
    files = ("--corrections", "corrections.csv", "--plot", "plans.png")
    told = run("fly", "small.h5", *one, "--case", "4", *files, cwd=folder).stdout
    assert "flight 4, ampi: REACHED_SPEED" in unwrapped(told)
    log = (folder / "corrections.csv").read_text(encoding="utf-8").splitlines()
    assert log[0].startswith("time_s,outcome,reason,iterations,")
    assert log[1].startswith(("40.000000,PLAN_", "40.000000,OUT_OF_REACH,The plan leads to the"))
    assert (folder / "plans.png").stat().st_size > 1e4


def test_a_campaign_that_knows_enough_stops(folder: Path) -> None:
    stop = ("--stop-percent", "30", "--modes", "ampi", "--cycle", "0.5", "-n", "300")
    run("fly", "small.h5", *stop, "--output", "short.h5", cwd=folder)
    assert load_campaigns(folder / "short.h5")["ampi"].n == 128


def test_sensitivity_tells_what_the_miss_comes_from(folder: Path) -> None:
    options = ("--world", "entry", "-n", "8", "--cycle", "0.5", "--mode", "nominal")
    numbers = json.loads(run("sensitivity", "small.h5", *options, "--json", cwd=folder).stdout)
    assert numbers["flights"] == 8 * (2 + 2)
    assert set(numbers["total"]) == {"entry.speed", "entry.flight_path_angle"}
    table = run("sensitivity", "small.h5", *options, cwd=folder).stdout
    assert "entry.flight_path_angle" in table
    odd = run("sensitivity", "small.h5", "-n", "12", cwd=folder, code=2).stderr
    assert "n: expected a power of 2, got 12" in odd
    both = run("sensitivity", "small.h5", "--mode", "mpi,ampi", cwd=folder, code=2).stderr
    assert "expected one world, law and mode, got mpi, ampi" in both


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("solve", "shefex4"), "or the path of a .toml file, got 'shefex4'"),
        (("build", "shefex3", "absent/a.h5"), "the folder absent does not exist"),
        (("build", "shefex3", "."), "expected a file to write, got a folder"),
        (("audit", "absent.h5"), "absent.h5: no such file; make one with: ampi build"),
        (
            ("guide", "small.h5", "--speed", "nan"),
            "speed_m_per_s: expected a finite number, got nan",
        ),
        (
            ("guide", "small.h5", "--altitude-km", "100"),
            "altitude_km: expected a parameter of this mission (speed_m_per_s, speed_km_per_s, ",
        ),
        (("guide", "small.h5", "-p", "speed_m_per_s"), "--parameter: expected KEY=NUMBER"),
        (("guide", "small.h5", "--mode", "best"), "--mode: expected one of nominal, mpi"),
        (("guide", "small.h5", "-p", "speed_m_per_s=1", "-p", "speed_m_per_s=2"), "given twice"),
        (("fly", "small.h5", "--modes", "ampi,best"), "hermite, got 'best'"),
        (("fly", "small.h5", "--world", "everyting"), "or the path of a .toml file, got 'everyt"),
        (("fly", "small.h5", "--law", "best"), "drag_sliding_mode, drag_shuttle, got 'best'"),
        (("fly", "small.h5", "--pool", "best"), "pool: expected one of reported, tuning, got"),
        (("fly", "small.h5", "--cycle", "0"), "cycle: expected at least 0.001 s, got 0"),
        (("fly", "small.h5", "--plot", "a.png"), "--plot: expected --case with it"),
        (("fly", "small.h5", "--case", "2", "--plot", "a.png"), "--plot: expected one world, law"),
        (("fly", "small.h5", "--corrections", "a.csv"), "--corrections: expected --case with it"),
        (
            ("fly", "small.h5", "--modes", "ampi", "--case", "2", "--corrections", "a.csv"),
            "corrections: expected a scheme that corrects its plan in flight",
        ),
        (("fly", "small.h5", "--output", "absent/f.h5"), "f.h5: the folder "),
        (("fly", "small.h5", "--output", "small.h5"), "small.h5 is a trajectory database; nothing"),
        (("guide", "small.h5", "--csv", "small.h5"), "small.h5 is a trajectory database; nothing"),
        (("report", "small.h5", "f.h5", "--output", "small.h5"), "small.h5 is a trajectory data"),
        (("solve", "small.toml", "--csv", "small.toml"), "small.toml is a mission file; nothing"),
        (("solve", "shefex3", "--plot", "a.abc"), "a.abc: expected a name that ends in .png, .pdf"),
        (("audit", "small.h5", "--figures", "small.toml"), "small.toml: expected a folder, got a"),
        (("audit", "."), ".: expected a file, got a folder"),
        (("verify", "."), ".: a folder, there is nothing to verify"),
        (("report", "small.h5", "absent.h5"), "absent.h5"),
    ],
)
def test_misuse_is_one_sentence(folder: Path, arguments: tuple[str, ...], message: str) -> None:
    done = run(*arguments, cwd=folder, code=2)
    assert message in done.stderr
    assert done.stderr.startswith("error:")


def test_flights_are_replaced_only_if_asked(folder: Path) -> None:
    flights, base = folder / "dear.h5", folder / "dear.csv"
    for dear in (flights, base):
        dear.write_bytes(b"weeks of work")
    slow = ("--modes", "nominal", "-j", "1", "--cycle", "0.5")
    fly = ("fly", "small.h5", "-n", "2", *slow, "--output", "dear.h5")
    for command in (
        fly,
        ("solve", "small.toml", "--csv", "dear.h5"),
        ("guide", "small.h5", "--csv", "dear.csv"),
        ("report", "small.h5", "dear.h5", "--output", "dear.h5", "--force"),
    ):
        told = run(*command, cwd=folder, code=2).stderr
        assert re.search(r"dear\.(h5|csv) is already there|needs this file", told)
        assert {flights.read_bytes(), base.read_bytes()} == {b"weeks of work"}
    run(*fly, "--force", cwd=folder)
    assert list(load_campaigns(flights)) == ["nominal"]


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_an_encoding_costs_no_result(folder: Path, encoding: str) -> None:
    there = folder / "é:100:[bold]"
    there.mkdir(exist_ok=True)
    shutil.copy(folder / "small.h5", there)
    for command in (
        ("--help",),
        ("verify", there / "small.h5"),
        ("verify", there / "none.h5"),
        ("fly", "small.h5", "-n", "3", "--modes", "ampi", "-j", "1", "--cycle", "0.5"),
    )[: 4 if encoding == "ascii" else 3]:
        done = subprocess.run(
            [sys.executable, "-m", "ampi.cli", *map(str, command)],
            cwd=folder,
            capture_output=True,
            env={**os.environ, "PYTHONIOENCODING": encoding},
        )
        told = (done.stdout + done.stderr).decode(encoding)
        assert not re.search(r"\\u|\\x(?!e9)", told)  # all signs of ours have a spelling
        assert done.returncode == (2 if "none.h5" in str(command[-1]) else 0), told
        if command[0] == "verify":
            name = "é" if encoding != "ascii" else "\\xe9"
            assert f"{name}:100:[bold]" in told


def test_a_reader_may_leave_and_a_stream_be_closed_or_full(tmp_path: Path) -> None:
    shell = f"{sys.executable} -m ampi.cli missions"
    for ending, said in (
        ("| true", ""),
        (">&-", ""),
        ("2>&- >/dev/null", ""),
        (">/dev/full", "error: standard output: No space left on device"),
    ):
        done = subprocess.run(
            ["bash", "-c", f"{shell} {ending}"], cwd=tmp_path, capture_output=True, text=True
        )
        assert done.stderr.strip() == said


def test_names_on_the_way_to_the_terminal_stay_names(tmp_path: Path) -> None:
    told = run("verify", "a\nb\x1b[31m:100:/[/bold]", cwd=tmp_path, code=2).stderr
    assert r"a\nb\x1b[31m:100:/[/bold]" in told
    assert told.count("\n") == 1


def test_a_figure_knows_no_environment(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "rc").write_text("text.usetex: True\nfont.size: 30\nsavefig.bbox: tight\n")
    (tmp_path / "jinja2.py").write_text("raise ModuleNotFoundError(name='jinja2')\n")
    pictures = []
    for environment in (  # what the command made itself it makes anew
        {},
        {"MPLBACKEND": "module://nowhere.backend", "MATPLOTLIBRC": str(tmp_path / "rc")},
        {"PYTHONPATH": str(tmp_path)},
    ):
        done = subprocess.run(
            [sys.executable, "-m", "ampi.cli", "guide", "small.h5", "--plot", tmp_path / "p.png"],
            cwd=folder,
            capture_output=True,
            text=True,
            env={**os.environ, **environment},
        )
        pictures.append((tmp_path / "p.png").read_bytes())
    assert pictures[0] == pictures[1]
    assert done.returncode == 2  # the last has no jinja2
    assert "drawing needs jinja2, which is not installed; try: pip install" in done.stderr


def test_no_misuse_has_cost_an_input(folder: Path) -> None:
    assert "whole" in run("verify", "small.h5", cwd=folder).stdout
    load_mission(folder / "small.toml")


def test_no_number_is_cut_where_there_is_no_terminal(folder: Path) -> None:
    for command in (("rerun", "small.h5", "0"), ("audit", "small.h5", "--probes", "2")):
        told = run(*command, cwd=folder).stdout
        assert not re.search(r"\S…", told), told  # "0 … 70" is a cell


def test_a_target_out_of_reach_is_a_status(tmp_path: Path) -> None:
    text = coarse(load_mission("shefex3").toml)
    assert text.count("longitude_deg = -45.75") == 1
    far = text.replace("longitude_deg = -45.75", "longitude_deg = -120.0")
    (tmp_path / "far.toml").write_text(far)
    told = run("solve", "far.toml", cwd=tmp_path, code=2).stderr
    assert told.startswith(f"error: shefex3: {Status.TARGET_MISSED.sentence} Open: the flight ends")
    assert re.search(r"Open: the flight ends [\d,]+ km from the target", unwrapped(told))
    refused = run("build", "far.toml", "far.h5", cwd=tmp_path, code=2).stderr
    assert "the nominal problem has no solution" in refused
    assert "km from the target" in unwrapped(refused)
    assert [f.name for f in tmp_path.iterdir()] == ["far.toml"]


def test_a_limit_that_cannot_be_kept_is_named(tmp_path: Path) -> None:
    limit = "heat_flux_kW_per_m2 = 6500.0"
    text = coarse(load_mission("shefex3").toml)
    (tmp_path / "cold.toml").write_text(text.replace(limit, "heat_flux_MW_per_m2 = 3.0"))
    told = run("solve", "cold.toml", "--bank-angle", "30", cwd=tmp_path, code=2).stderr
    assert re.search(r"Open: heat_flux is 5\d\.?\d* % above its limit", unwrapped(told))


@pytest.mark.parametrize(
    ("method", "mission", "longitudes"),
    [
        ("zhou2021", "cavh_zhou2021", ("longitude_deg = 140.0", "longitude_deg = 220.0")),
        ("wang2020_scp", "cavh_wang2020", ("longitude_deg = 90.0", "longitude_deg = 150.0")),
        ("liu2024", "rlv_liu2024", ("longitude_deg = 12.0", "longitude_deg = 70.0")),
    ],
)
def test_a_method_of_the_literature_says_what_is_open(
    tmp_path: Path, method: str, mission: str, longitudes: tuple[str, str]
) -> None:
    text = load_mission(mission).toml
    assert text.count(longitudes[0]) == 1
    (tmp_path / "far.toml").write_text(text.replace(*longitudes))
    done = run("solve", "far.toml", "--method", method, cwd=tmp_path, code=2)
    told = unwrapped(done.stderr)
    assert re.search(r"Open: .*(from the target|above its limit|too (high|low))", told)
    assert "nan" not in done.output
    assert "Open: " not in done.stdout  # it is the error


def test_a_build_refuses_what_its_method_does_not_know(tmp_path: Path) -> None:
    text = load_mission("x33_liu2015").toml + "\n[grid]\nspeed_m_per_s = [-10.0, 0.0, 10.0]\n"
    (tmp_path / "x33.toml").write_text(text)
    told = run("build", "x33.toml", "x33.h5", cwd=tmp_path, code=2).stderr
    assert told.startswith("error: bank_angle_minimum: asked for by mission x33_liu2015")
    assert [f.name for f in tmp_path.iterdir()] == ["x33.toml"]


def test_a_database_of_another_mission_is_never_overwritten(folder: Path, tmp_path: Path) -> None:
    held = tmp_path / "held.h5"
    shutil.copy(folder / "small.h5", held)
    text = (folder / "small.toml").read_text().replace("mass_kg = 500.0", "mass_kg = 499.0")
    (tmp_path / "light.toml").write_text(text)
    refused = run("build", "light.toml", "held.h5", cwd=tmp_path, code=2).stderr
    assert "is not a database of this mission (shefex3); nothing was overwritten" in refused
    assert held.read_bytes() == (folder / "small.h5").read_bytes()
    few = ("-n", "5", "--modes", "ampi", "--cycle", "0.5", "--output", "few.h5")
    run("fly", "small.h5", *few, cwd=folder)
    run("build", "light.toml", "light.h5", cwd=tmp_path)
    mixed = run("report", "light.h5", folder / "few.h5", cwd=tmp_path, code=2).stderr
    assert "flown from a database of another mission" in mixed
    assert "(also shefex3, with other numbers or axes)" in mixed
    assert not (tmp_path / "report.html").exists()


def test_damaged_files_are_one_sentence(folder: Path, tmp_path: Path) -> None:
    whole = (folder / "small.h5").read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 1
    for name, content in (("cut.h5", whole[: len(whole) // 2]), ("flipped.h5", flipped)):
        (tmp_path / name).write_bytes(content)
        assert "rebuild" in run("audit", name, "--probes", "0", cwd=tmp_path, code=2).stderr
    (tmp_path / "cut.h5").write_bytes(b"PK\x03\x04 cut")
    told = run("report", folder / "small.h5", "cut.h5", cwd=tmp_path, code=2).stderr
    assert "not a whole file of flights" in told


def test_control_c_keeps_the_cases_and_says_how_to_go_on(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "ampi.cli", "build", "shefex3", "big.h5"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # a shell's background jobs ignore the interrupt, and so do their children
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    records = tmp_path / "big.h5.partial"
    while process.poll() is None and (not records.is_dir() or count_records(records) < 5):
        time.sleep(0.1)
    os.killpg(process.pid, signal.SIGINT)
    _, told = process.communicate()
    assert process.returncode == 130, told
    assert "solved cases are kept in big.h5.partial" in told
    assert "To continue: ampi build shefex3 big.h5" in told
    assert not (tmp_path / "big.h5").exists()
    assert count_records(records) >= 5
