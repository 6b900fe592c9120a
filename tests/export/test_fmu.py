"""The functional mock-up unit: validated and flown by FMPy, against Guidance.step."""

from __future__ import annotations

import re
import shutil
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import ampi
from ampi.dataset import read_dataset
from ampi.export.blob import table_blob
from ampi.export.fmu import export_fmu
from ampi.export.fmu_description import UNITS, FmuModel, Measured, Version
from ampi.guidance import Guidance
from ampi.loading import load_guidance
from ampi.missions import units
from ampi.onboard.health import Health, Steering
from tests.support.databases import small_database
from tests.support.fmus import Unit

fmpy = pytest.importorskip("fmpy", reason="FMPy is absent: THE FMU IS NOT TESTED")
pytestmark = pytest.mark.skipif(
    shutil.which("cc") is None, reason="there is no C compiler: THE FMU IS NOT TESTED"
)

Array = NDArray[np.float64]
CYCLE = 0.5
VERSIONS: tuple[Version, ...] = (2, 3)
FMI = Path(__file__).parents[2] / "ampi" / "export" / "fmi"
MEASURED = np.array([4700.0, -0.183])  # p of the small database: between its points


@pytest.fixture(scope="module")
def database_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_database(tmp_path_factory)


def model_of(guidance: Guidance) -> FmuModel:
    own = (Measured("speed", "m/s"), Measured("flight_path_angle", "rad"))
    return FmuModel("small SHEFEX-3", guidance.table, own, cycle=CYCLE)


def blob_of(guidance: Guidance) -> bytes:
    return table_blob(guidance.table, guidance.law, guidance.limits, cycle=CYCLE)


Exporter = Callable[[str, Version], Path]


@pytest.fixture(scope="module")
def exported(database_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Exporter:
    """The unit of a law, made once."""
    folder = tmp_path_factory.mktemp("fmu")

    def export(law: str, version: Version) -> Path:
        path = folder / f"{law}_{version}.fmu"
        if not path.exists():
            guidance = load_guidance(database_file, law=law, cycle=CYCLE)
            made = export_fmu(path, model_of(guidance), blob_of(guidance), version=version)
            assert made.platform is not None, made.why
        return path

    return export


@pytest.fixture(scope="module")
def guidance(database_file: Path) -> Guidance:
    return load_guidance(database_file, cycle=CYCLE)


@pytest.fixture(params=VERSIONS)
def unit(request: pytest.FixtureRequest, exported: Exporter, tmp_path: Path) -> Callable[..., Unit]:
    """New instances of the linear-quadratic unit, of either standard."""
    path = exported("linear_quadratic", request.param)
    return lambda name="flight": Unit(path, tmp_path, name)


def recorded(guidance: Guidance, n: int = 400) -> tuple[Array, Array]:
    """Times (n,) and what is told (11, n): near the reference, then with nonsense, to after its end."""
    rng = np.random.default_rng(5)
    reference = guidance.reference(MEASURED).copy()
    end = 1.05 * reference.final_time
    times = np.linspace(0.0, end, n) + 0.1 * rng.uniform(0.0, 1.0, n)
    states = [np.interp(times, reference.times, row) for row in reference.states]
    told = np.array([*states, np.interp(times, reference.times, reference.bank_rate)])
    told *= 1.0 + 1e-3 * rng.standard_normal(told.shape)
    told = np.vstack([told, rng.uniform(0.0, 15.0, (3, n))])
    nonsense = [np.nan, np.inf, -np.inf, 1e300, 5e-324, -0.0, 1e12, 4e3]
    for i in rng.choice(np.arange(20, n), n // 10, replace=False):
        told[rng.integers(0, 11), i] = rng.choice(nonsense)
    times[n // 2] = times[n // 2 - 3]  # back; then not a number, and far ahead
    times[5 * n // 8], times[6 * n // 8] = np.nan, 1e9
    return times, told


def stepped(guidance: Guidance, p: Array, times: Array, told: Array) -> Array:
    """Commands (n, 5) of Guidance.step."""
    guidance.begin(p)
    commands = [guidance.step(t, x[:8], x[8:]) for t, x in zip(times, told.T, strict=True)]
    return np.array(
        [[c.bank_rate, c.bank_angle, c.angle_of_attack, c.steering, c.health] for c in commands]
    )


# --- what it flies --------------------------------------------------------------------------------


def test_every_command_has_the_bits_of_guidance(
    unit: Callable[..., Unit], guidance: Guidance
) -> None:
    times, told = recorded(guidance)
    with unit() as flight:
        flight.begin(MEASURED)
        got = flight.flown(times, told, CYCLE)
    expected = stepped(guidance, MEASURED, times, told)
    assert set(expected[:, 3]) == set(Steering) - {Steering.PLANNED}  # without a correction
    assert {Health.GOOD, Health.BAD_TIME, Health.BAD_NAVIGATION} < set(expected[:, 4])
    assert Health.AFTER_FINAL_TIME in expected[:, 4]
    assert np.array_equal(got, expected)


@pytest.mark.parametrize("law", ["drag_sliding_mode", "drag_shuttle"])
def test_drag_laws_differ_from_guidance_by_rounding_alone(
    law: str, exported: Exporter, database_file: Path, tmp_path: Path
) -> None:
    guidance = load_guidance(database_file, law=law, cycle=CYCLE).on_engine("numpy")
    times, told = recorded(guidance)
    with Unit(exported(law, 3), tmp_path, law) as flight:
        flight.begin(MEASURED)
        got = flight.flown(times, told, CYCLE)
    expected = stepped(guidance, MEASURED, times, told)
    assert np.array_equal(got[:, 3:], expected[:, 3:])
    assert np.abs(got - expected).max() < 1e-12  # exp, log, sin and cos of two libraries


@pytest.mark.parametrize("version", VERSIONS)
def test_a_simulator_flies_it(version: Version, exported: Exporter, guidance: Guidance) -> None:
    times = np.arange(60) * CYCLE
    told = recorded(guidance)[1][:, :60]
    told[~np.isfinite(told)] = 0.0
    path = exported("linear_quadratic", version)
    inputs = [variable.name for variable in Unit.variables(path, "input")]
    signals = np.zeros(60, dtype=[("time", float), *((name, float) for name in inputs)])
    signals["time"] = times
    for name, row in zip(inputs, told, strict=True):
        signals[name] = row
    result = fmpy.simulate_fmu(
        str(path),
        stop_time=times[-1],
        step_size=CYCLE,
        output_interval=CYCLE,
        input=signals,
        start_values={"parameter.speed": MEASURED[0], "parameter.flight_path_angle": MEASURED[1]},
    )
    expected = stepped(guidance, MEASURED, times, told)
    names = (
        "command.bank_rate",
        "command.bank_angle",
        "command.angle_of_attack",
        "steering",
        "health",
    )
    got = np.array([result[name] for name in names]).T
    assert np.array_equal(result["time"], times)
    assert np.array_equal(got[1:], expected[:-1])  # of the cycle that ends there
    begin = guidance.reference(MEASURED)
    assert got[0].tolist() == [begin.nodal[7, 0], begin.nodal[6, 0], 0.0, Steering.REFERENCE, 0]


def test_two_instances_do_not_see_each_other(unit: Callable[..., Unit], guidance: Guidance) -> None:
    times, told = recorded(guidance, 60)
    other = MEASURED + np.array([50.0, 0.003])
    with unit("one") as one, unit("two") as two:
        one.begin(MEASURED)
        two.begin(other)
        got = [
            (one.flown(times[[i]], told[:, [i]], CYCLE), two.flown(times[[i]], told[:, [i]], CYCLE))
            for i in range(60)
        ]
    assert np.array_equal(np.vstack([a for a, _ in got]), stepped(guidance, MEASURED, times, told))
    assert np.array_equal(np.vstack([b for _, b in got]), stepped(guidance, other, times, told))


def test_a_state_is_flown_on_from_and_a_reset_forgets_the_flight(
    unit: Callable[..., Unit], guidance: Guidance
) -> None:
    times, told = recorded(guidance, 60)
    expected = stepped(guidance, MEASURED, times, told)
    with unit() as flight:
        nominal = flight.parameters()
        flight.begin(MEASURED)
        flight.flown(times[:30], told[:, :30], CYCLE)
        state = flight.get_state()
        first = flight.flown(times[30:], told[:, 30:], CYCLE)
        flight.set_state(state)
        again = flight.flown(times[30:], told[:, 30:], CYCLE)
        flight.free_state(state)
        assert np.array_equal(first, expected[30:])
        assert np.array_equal(again, expected[30:])
        flight.fmu.reset()
        assert flight.parameters() == nominal
        flight.begin(MEASURED)
        assert np.array_equal(flight.flown(times, told, CYCLE), expected)


def test_parameters_outside_are_told_before_the_first_step(unit: Callable[..., Unit]) -> None:
    with unit() as flight:
        flight.begin(np.array([np.nan, -0.18]))
        assert flight.command()[4] == Health.BAD_PARAMETERS


# --- what it refuses ------------------------------------------------------------------------------


def test_a_call_out_of_order_is_an_error_and_says_so(
    unit: Callable[..., Unit], capsys: pytest.CaptureFixture[str]
) -> None:
    nothing = np.zeros((11, 1))
    with unit() as flight:
        refused(
            capsys, lambda: flight.step(0.0, CYCLE), "DoStep: is not to be called now: it is instan"
        )
        refused(
            capsys, flight.fmu.exitInitializationMode, "ExitInitializationMode: is not to be called"
        )
        refused(capsys, flight.fmu.terminate, "Terminate: is not to be called now")
        flight.begin(MEASURED)
        refused(
            capsys, flight.fmu.enterInitializationMode, "not to be called now: its flight has begun"
        )
        refused(
            capsys, lambda: flight.set_parameters(MEASURED), "Set: expected parameters before the"
        )
        refused(
            capsys, lambda: flight.step(0.0, 0.0), "DoStep: expected a communication step longer"
        )
        refused(capsys, lambda: flight.get_real([99]), "Get: expected references of real variables")
        refused(capsys, lambda: flight.set_real([12], [0.0]), "Set: expected references of inputs")
        flight.flown(np.zeros(1), nothing, CYCLE)  # none of it has harmed the flight
        flight.fmu.terminate()
        refused(
            capsys, lambda: flight.step(1.0, CYCLE), "DoStep: is not to be called now: it is term"
        )


def refused(capsys: pytest.CaptureFixture[str], call: Callable[[], object], sentence: str) -> None:
    capsys.readouterr()
    with pytest.raises(fmpy.fmi1.FMICallException, match=r"failed with status 3 \(error\)"):
        call()
    assert sentence in capsys.readouterr().out


@pytest.mark.parametrize("version", VERSIONS)
def test_a_foreign_model_description_and_a_damaged_table_are_refused(
    version: Version, exported: Exporter, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = exported("linear_quadratic", version)
    with pytest.raises(Exception, match="Failed to instantiate"):
        Unit(path, tmp_path, "foreign", token="{another}")
    assert "Instantiate: expected the token {" in capsys.readouterr().out
    for damage, sentence in (
        (lambda blob: blob[:-9], "the table is shorter or longer than it says"),
        (lambda blob: blob[:5000] + b"\x55" + blob[5001:], "the table is damaged"),
        (lambda blob: b"not a table" * 999, "the file is not a guidance table"),
        (lambda blob: b"", "expected the file ampi_table.bin in the folder of resources"),
    ):
        with pytest.raises(Exception, match="Failed to instantiate"):
            Unit(path, tmp_path, "damaged", damage=damage)
        assert sentence in capsys.readouterr().out


# --- what is in the archive -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("law", "version"), [("linear_quadratic", 2), ("linear_quadratic", 3), ("drag_shuttle", 3)]
)
def test_the_validator_finds_nothing(law: str, version: Version, exported: Exporter) -> None:
    path = exported(law, version)
    assert fmpy.validation.validate_fmu(str(path)) == []
    described = fmpy.read_model_description(str(path))
    assert described.generationTool == f"ampi {ampi.__version__}"
    (build,) = described.buildConfigurations
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    assert {f"sources/{name}" for name in build.sourceFileSets[0].sourceFiles} < set(names)
    assert fmpy.supported_platforms(str(path)) == ["c-code", fmpy.platform]


def test_the_same_guidance_makes_the_same_bytes(
    exported: Exporter, guidance: Guidance, tmp_path: Path
) -> None:
    export_fmu(tmp_path / "again.fmu", model_of(guidance), blob_of(guidance))
    first = exported("linear_quadratic", 3)
    assert (tmp_path / "again.fmu").read_bytes() == first.read_bytes()


def test_without_a_compiler_there_are_sources_and_a_sentence(
    guidance: Guidance, tmp_path: Path
) -> None:
    path = tmp_path / "sources.fmu"
    made = export_fmu(path, model_of(guidance), blob_of(guidance), compiler="no-such-cc")
    assert str(made) == (
        f"{path}: FMI 3.0 co-simulation, sources only (no C compiler no-such-cc was found)"
    )
    assert fmpy.validation.validate_fmu(str(path)) == []
    assert fmpy.supported_platforms(str(path)) == ["c-code"]


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("version", VERSIONS)
def test_functions_are_those_of_the_standard_without_a_warning(
    version: Version, compiler: str, exported: Exporter, tmp_path: Path
) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"there is no {compiler}")
    headers = Path(fmpy.__file__).parent / "c-code"
    fmpy.extract(str(exported("linear_quadratic", version)), tmp_path)
    strict = "-Wall -Wextra -Wconversion -Wshadow -Wdouble-promotion -Wcast-qual -pedantic -Werror"
    for name in ("fmu", *(path.stem for path in FMI.glob(f"fmi{version}*.c"))):
        source = [str(tmp_path / "sources" / f"{name}.c"), "-fsyntax-only", "-std=c99"]
        subprocess.run([compiler, *strict.split(), *source], check=True)
        standard = ["-include", str(headers / f"fmi{version}Functions.h"), "-Werror"]
        subprocess.run([compiler, *standard, *source], check=True)
    declared = (headers / f"fmi{version}Functions.h").read_text()
    model_exchange = r"Functions for FMI2 for Model Exchange.*?Functions for FMI2 for Co-Simulation"
    names = re.findall(r"(fmi[23][A-Z]\w+)TYPE", re.sub(model_exchange, "", declared, flags=re.S))
    with Unit(exported("linear_quadratic", version), tmp_path, "all") as flight:
        assert len(names) > 30
        assert [name for name in names if not hasattr(flight.fmu.dll, name)] == []


def test_every_unit_of_a_mission_is_described() -> None:
    assert {units.symbol(units.si_key(dimension)) for dimension in units.UNITS} == set(UNITS)


def test_a_parameter_without_a_name_and_another_standard_are_refused(
    guidance: Guidance, tmp_path: Path
) -> None:
    with pytest.raises(
        ValueError, match="parameters: expected 2 different names, one for each axis"
    ):
        FmuModel("small", guidance.table, (Measured("speed", "m/s"),))
    with pytest.raises(ValueError, match="name: expected letters or digits, got ' '"):
        FmuModel(" ", guidance.table, model_of(guidance).parameters)
    with pytest.raises(ValueError, match="version: expected 2 or 3 of FMI, got 1"):
        export_fmu(tmp_path / "x.fmu", model_of(guidance), b"", version=1)  # type: ignore[arg-type]


def test_the_names_are_those_of_the_small_mission(database_file: Path) -> None:
    named = [(p.name, p.number.unit) for p in read_dataset(database_file).mission.parameters]
    assert named == [("speed", "m/s"), ("flight_path_angle", "rad")]
