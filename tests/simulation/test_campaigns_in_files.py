"""Campaigns in a file: the same bytes whoever flies and whoever dies, and each flight again."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator
from copy import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

from ampi.dataset import partial_folder
from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.simulation import monte_carlo
from ampi.simulation.campaign_records import CampaignError
from ampi.simulation.estimates.stopping import StopRule
from ampi.simulation.flights import Flights
from ampi.simulation.flights_file import load_campaigns
from ampi.simulation.flights_schema import FIELDS, FLIGHT, SCALES, TIME
from ampi.simulation.monte_carlo import Scheme, fly, fly_again, fly_schemes
from ampi.simulation.outcomes import flown
from ampi.simulation.world_loading import load_world
from tests.support.flights import assert_identical
from tests.support.worlds import HEAD, write_draws

pytestmark = pytest.mark.slow

N, BATCH = 7, 2
OPTIONS: dict[str, Any] = {"seed": 3, "cycle": 1.0, "record_every": 5.0}
HARSH = """
[density]
factor = { distribution = "normal", three_sigma = 0.2 }
noise = 0.05
[wind]
north_m_per_s = 20.0
noise_m_per_s = 10.0
[navigation]
altitude_noise_m = 30.0
dropout = 0.05
latency_s = 0.3
[actuator]
lag_s = 0.5
[draws]
table = "draws.csv"
"""


@pytest.fixture(scope="module", autouse=True)
def _small_batches() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(monte_carlo, "BATCH", BATCH)
        yield


@pytest.fixture(scope="module")
def harsh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A world with profiles, noise and a table of draws."""
    path = tmp_path_factory.mktemp("world") / "harsh.toml"
    write_draws(path.with_name("draws.csv"))
    path.write_text(HEAD + HARSH)
    return path


@pytest.fixture(scope="module")
def schemes(short_guidance: Guidance, harsh: Path) -> dict[str, Scheme]:
    nominal = short_guidance.in_mode(Mode.NOMINAL)
    return {"ampi": Scheme(short_guidance), "harsh": Scheme(nominal, load_world(harsh))}


@pytest.fixture(scope="module")
def quiet(
    short: Mission, schemes: dict[str, Scheme], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The file of a campaign that nobody disturbs, flown in this process."""
    path = tmp_path_factory.mktemp("quiet") / "a.h5"
    fly_schemes(short, schemes, N, output=path, n_jobs=1, **OPTIONS)
    return path


def descendants(process: int) -> list[int]:
    """Processes below one that have none below them: workers."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
        except OSError:  # it has ended
            continue
    leaves, open_ = [], [process]
    while open_:
        one = open_.pop()
        below = [child for child, parent in parents.items() if parent == one]
        open_ += below
        leaves += [] if below or one == process else [one]
    return leaves


# --- the same bytes -------------------------------------------------------------------------------


def test_what_streams_to_a_file_is_what_stays_in_memory(
    short: Mission, schemes: dict[str, Scheme], quiet: Path
) -> None:
    loaded = load_campaigns(quiet)
    here = fly_schemes(short, schemes, N, n_jobs=1, **OPTIONS)
    assert list(loaded) == list(here) == ["ampi", "harsh"]
    for name, flights in here.items():
        assert_identical(loaded[name], flights)
    assert here["harsh"].profiles == "density wind"


@pytest.mark.parametrize("n_jobs", [2, 3])
def test_any_number_of_workers_writes_the_same_bytes(
    short: Mission, schemes: dict[str, Scheme], quiet: Path, tmp_path: Path, n_jobs: int
) -> None:
    path, seen = tmp_path / "a.h5", list[int]()
    fly_schemes(short, schemes, N, output=path, n_jobs=n_jobs, advance=seen.append, **OPTIONS)
    assert path.read_bytes() == quiet.read_bytes()
    assert sum(seen) == 2 * N
    assert [file.name for file in tmp_path.iterdir()] == ["a.h5"]


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="finds workers in /proc")
def test_a_worker_that_is_killed_costs_its_batch(
    short: Mission, schemes: dict[str, Scheme], quiet: Path, tmp_path: Path
) -> None:
    path, killed = tmp_path / "a.h5", list[int]()

    def kill_one(count: int) -> None:
        if not killed:
            killed.extend(descendants(os.getpid())[:1])
            os.kill(killed[0], signal.SIGKILL)

    fly_schemes(short, schemes, N, output=path, n_jobs=2, advance=kill_one, **OPTIONS)
    assert killed
    assert path.read_bytes() == quiet.read_bytes()


DRIVER = f"""
import pickle, sys
from pathlib import Path
from ampi.simulation import monte_carlo
monte_carlo.BATCH = {BATCH}
mission, schemes = pickle.loads(Path(sys.argv[1]).read_bytes())
monte_carlo.fly_schemes(mission, schemes, {N}, output=sys.argv[2], n_jobs=2, **{OPTIONS})
"""


def test_a_driver_that_is_killed_leaves_what_is_flown(
    short: Mission, schemes: dict[str, Scheme], quiet: Path, tmp_path: Path
) -> None:
    """Flown again it is not; nor by another campaign, which is refused."""
    path, told = tmp_path / "a.h5", tmp_path / "told"
    told.write_bytes(pickle.dumps((short, schemes)))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    process = subprocess.Popen([sys.executable, "-c", DRIVER, told, path], env=environment)
    folder = partial_folder(path)

    def kept() -> dict[str, int]:
        return {file.name: file.stat().st_mtime_ns for file in folder.glob("*.rec")}

    while len(kept()) < 3:
        assert process.poll() is None
        time.sleep(0.005)
    process.kill()
    process.wait()
    before, seen = kept(), list[dict[str, int]]()
    assert not path.exists()
    for changes in ({"seed": 4}, {"pool": "tuning"}, {"cycle": 0.5}, {"record_every": 2.0}):
        with pytest.raises(CampaignError, match="holds results of another campaign"):
            fly_schemes(short, schemes, N, output=path, **{**OPTIONS, **changes})
    with pytest.raises(CampaignError, match="different scheme ampi"):
        fly_schemes(short, {**schemes, "ampi": schemes["harsh"]}, N, output=path, **OPTIONS)
    fly_schemes(
        short,
        schemes,
        N,
        output=path,
        n_jobs=1,
        advance=lambda count: seen.append(kept()),
        **OPTIONS,
    )
    assert path.read_bytes() == quiet.read_bytes()
    assert 3 <= len(before) < 8
    assert all(before.items() <= now.items() for now in seen)


def test_a_whole_file_is_not_flown_again_nor_overwritten(
    short: Mission, schemes: dict[str, Scheme], quiet: Path, tmp_path: Path
) -> None:
    path, seen = tmp_path / "a.h5", list[int]()
    path.write_bytes(quiet.read_bytes())
    same = fly_schemes(short, schemes, N, output=path, advance=seen.append, **OPTIONS)
    assert not seen
    assert_identical(same["ampi"], load_campaigns(quiet)["ampi"])
    with pytest.raises(
        CampaignError, match=r"another campaign \(different flights \(7 there, 2 he"
    ):
        fly_schemes(short, schemes, 2, output=path, **OPTIONS)
    options: dict[str, Any] = {**OPTIONS, "resume": False, "n_jobs": 1}
    few = fly_schemes(short, schemes, 2, output=path, **options)
    assert few["ampi"].n == 2


def test_a_cluster_writes_the_same_bytes(
    short: Mission, schemes: dict[str, Scheme], quiet: Path, tmp_path: Path
) -> None:
    """Also when one of its workers is killed."""
    distributed = pytest.importorskip("distributed")
    options: dict[str, Any] = {"processes": True, "dashboard_address": None}
    path, killed = tmp_path / "a.h5", list[int]()
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, **options) as cluster,
        distributed.Client(cluster) as client,
    ):

        def kill_one(count: int) -> None:
            if not killed:
                killed.append(next(iter(client.run(os.getpid).values())))
                os.kill(killed[0], signal.SIGKILL)

        fly_schemes(short, schemes, N, output=path, client=client, advance=kill_one, **OPTIONS)
    assert killed
    assert path.read_bytes() == quiet.read_bytes()


def test_xarray_reads_a_campaign(quiet: Path) -> None:
    flights = load_campaigns(quiet)["harsh"]
    truth, states = flights.truth, flights.states[4]
    with xarray.open_dataset(quiet, group="harsh", engine="h5netcdf") as data:
        assert data.attrs["world"] == "w"
        assert data.attrs["world_toml"] == flights.world_toml
        assert dict(data.sizes)[FLIGHT] == N
        own = data.sel(flight=4)
        drawn = own.numbers.sel(uncertainty=b"density_factor")
        assert float(drawn) == truth.numbers["density_factor"][4]
        assert np.array_equal(own.states, states, equal_nan=True)
        assert own.wind.sel(direction=b"north", altitude=50e3) == truth.wind[1, 4, 50]


# --- a flight again -------------------------------------------------------------------------------


def assert_again(again: Flights, flights: Flights, case: int, stride: int) -> None:
    back = {scale: name for name, scale in SCALES.items()}
    for name, field in FIELDS.items():
        if FLIGHT not in field.dimensions or name == FLIGHT:
            continue
        one = getattr(again, back.get(name, name))[0]
        all_ = getattr(flights, back.get(name, name))[case]
        if TIME in field.dimensions:
            one = one[..., ::stride]
            assert np.isnan(all_[..., one.shape[-1] :]).all()
            all_ = all_[..., : one.shape[-1]]
        assert np.array_equal(one, all_, equal_nan=np.asarray(one).dtype.kind == "f"), name


def test_any_flight_again_from_the_file_alone(
    short: Mission, guidance: Guidance, harsh: Path, quiet: Path
) -> None:
    """The world file and its table have gone; the database is all that is needed beside the flights."""
    for file in harsh.parent.iterdir():
        file.rename(file.with_suffix(".gone"))
    campaigns = load_campaigns(quiet)
    for name, case in (("harsh", 0), ("harsh", 3), ("harsh", 6), ("ampi", 5)):
        flights = campaigns[name]
        again = fly_again(short, guidance, case, flights)
        assert (again.n, again.mode, again.cycle) == (1, flights.mode, 1.0)
        assert again.world_toml == flights.world_toml
        assert np.all(np.diff(again.times) == 1.0)
        assert_again(again, flights, case, 5)
        assert again.failures[0] == flights.failures[case]
        assert_again(fly_again(short, guidance, 0, again), again, 0, 1)


def test_a_guidance_that_has_flown_before_flies_the_same(
    mission: Mission, guidance: Guidance
) -> None:
    """To the end of the references, batch after batch by one process; a flight again by a new one."""
    flights = fly(mission, guidance, n=2 * BATCH, n_jobs=1, cycle=1.0)
    new = pickle.loads(pickle.dumps(guidance))
    case = 2 * BATCH - 1
    assert_again(fly_again(mission, new, case, flights), flights, case, 5)


@pytest.mark.parametrize("case", [-1, N, 1.0, True])
def test_a_flight_that_is_none(short: Mission, guidance: Guidance, quiet: Path, case: Any) -> None:
    with pytest.raises(ValueError, match=f"case: expected a flight from 0 to 6, got {case}"):
        fly_again(short, guidance, case, load_campaigns(quiet)["ampi"])


def test_a_flight_of_another_table_or_mission(
    short: Mission, mission: Mission, guidance: Guidance, quiet: Path
) -> None:
    flights = load_campaigns(quiet)["ampi"]
    other = copy(guidance)
    other.table = copy(guidance.table)
    object.__setattr__(other.table, "values", guidance.table.values * (1.0 + 1e-15))
    for arguments in ((mission, guidance), (short, other)):
        with pytest.raises(ValueError, match=r"flights: expected those of shefex3 with this guid"):
            fly_again(*arguments, 0, flights)


# --- many flights, cheaply ------------------------------------------------------------------------

Fake = Callable[..., dict[str, np.ndarray]]


@pytest.fixture
def cheap(
    short: Mission, schemes: dict[str, Scheme], monkeypatch: pytest.MonkeyPatch
) -> list[tuple[Mode, int]]:
    """Flights in no time: one, again and again; nominal ones arrive every other time. Which were."""
    scheme, flown_so_far = schemes["ampi"], list[tuple[Mode, int]]()
    guidance = scheme.guidance.at_cycle(1.0)
    one = flown(short, guidance, scheme.loaded_world.draw(short, 1, 3), 1.0)

    def fake(
        mission: Mission, guidance: Guidance, truth: Any, record_every: float
    ) -> dict[str, np.ndarray]:
        n = len(truth)
        flown_so_far.append((guidance.mode, n))
        found = {
            name: np.repeat(values, n, axis=0) if FLIGHT in FIELDS[name].dimensions else values
            for name, values in one.items()
        }
        every_other = np.arange(n) % 2 * (1e6 if guidance.mode is Mode.NOMINAL else 0.0)
        return {**found, "miss": every_other}

    monkeypatch.setattr("ampi.simulation.batches.flown", fake)
    monkeypatch.setattr(monte_carlo, "BATCH", 100)
    return flown_so_far


def test_the_memory_does_not_grow_with_the_flights(
    short: Mission, schemes: dict[str, Scheme], cheap: Any, tmp_path: Path
) -> None:
    guidance, peaks = schemes["ampi"].guidance, []
    options: dict[str, Any] = {**OPTIONS, "n_jobs": 1}
    for i, n in enumerate((200, 200, 1000)):  # the first time what is imported counts too
        tracemalloc.start()
        fly(short, guidance, n=n, output=tmp_path / f"{i}.h5", **options)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    flights = load_campaigns(tmp_path / "2.h5")["flights"]
    batch = sum(
        getattr(flights, name).dtype.itemsize * np.prod(getattr(flights, name).shape) / 10
        for name in ("states", "reference_states", "path", "density", "wind")
    )
    assert peaks[2] - peaks[1] < 0.9 * batch  # of 8 more


def test_the_stop_rule_stops_all_schemes_at_the_same_batch(
    short: Mission, schemes: dict[str, Scheme], cheap: list[tuple[Mode, int]], tmp_path: Path
) -> None:
    """A share of 1 is known after 100 flights, one of ½ after 200."""
    pair = {
        mode.value: Scheme(schemes["ampi"].guidance.in_mode(mode))
        for mode in (Mode.NOMINAL, Mode.MPI)
    }
    rule, options = StopRule(5e3, 0.15), {**OPTIONS, "n_jobs": 1}
    for output in (None, tmp_path / "a.h5"):
        cheap.clear()
        flown_ = fly_schemes(short, pair, 950, stop=rule, output=output, **options)
        assert [flights.n for flights in flown_.values()] == [200, 200]
        assert len(cheap) == 4
    alone = fly(short, pair["mpi"].guidance, n=950, stop=rule, **options)
    assert alone.n == 100
    never = fly(short, pair["mpi"].guidance, n=250, stop=StopRule(5e3, 1e-3), **options)
    assert never.n == 250
