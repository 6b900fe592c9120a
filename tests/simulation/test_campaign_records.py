"""Records of campaigns: what is flown stays flown, whoever dies, and only for the same campaign."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ampi.correction.corrector import CorrectionOutcome
from ampi.dataset import partial_folder
from ampi.physics.state import N_STATES
from ampi.simulation.campaign_records import (
    COPIES,
    BatchRecords,
    CampaignError,
    CampaignRecords,
    Heading,
    is_flown,
)
from ampi.simulation.flights_file import load_campaigns
from ampi.simulation.profiles import ALTITUDES
from ampi.simulation.uncertainties import BY_NAME
from ampi.workers.job import JobError

HERE = Path(__file__).parent
IDENTITY = {"mission_sha256": "0" * 64, "table_sha256": "1" * 64, "seed": "7", "flights": "18"}
COUNT, SIZE, POINTS = 6, 3, (4, 2, 4, 3, 4, 4)
CAMPAIGNS = ("nominal", "ampi")


@dataclass(frozen=True)
class Batch:
    """Three flights that are random numbers; leaves a mark for every time that it is flown."""

    records: BatchRecords
    number: int
    marks: Path
    dies: bool = False  # the first time
    waits: bool = False  # until there is a file `go`

    def compute(self, announce: Callable[[int], None]) -> Future[Path]:
        announce(0)
        begun = len(list(self.marks.glob(f"{self} *")))
        (self.marks / f"{self} {begun}").touch()
        while self.waits and not (self.marks / "go").exists():
            time.sleep(0.01)
        if self.dies and not begun:
            os.kill(os.getpid(), signal.SIGKILL)
        return self.records.keep(self.number, flown(self.records.campaign, self.number))

    def __str__(self) -> str:
        return f"{self.records.campaign} {self.number}"

    def without(self, attempt: int) -> Batch:
        return self

    def give_up(self, reason: str) -> Path:
        raise JobError(f"{self}: {reason}")


def flown(campaign: str, number: int) -> dict[str, np.ndarray]:
    """A batch, the same on every call."""
    rng, k = np.random.default_rng([CAMPAIGNS.index(campaign), number]), POINTS[number]
    numbers = ("final_time", "miss", "along", "across", "altitude_error", "speed_error")
    counted = ("saturation", "activity", "rebound", "distance", "least_range", "greatest_range")
    return {
        "numbers": rng.random((SIZE, len(BY_NAME))),
        "density": rng.random((SIZE, len(ALTITUDES))),
        "wind": rng.random((SIZE, 2, len(ALTITUDES))),
        "seeds": rng.integers(2**52, size=SIZE).astype(np.uint64),
        "parameters": rng.standard_normal((SIZE, 2)),
        "clipped": rng.random(SIZE) < 0.5,
        "hole": rng.random(SIZE) < 0.5,
        "status": np.zeros(SIZE, dtype=np.int64),
        "final_states": rng.standard_normal((SIZE, N_STATES)),
        **{name: rng.random(SIZE) for name in (*numbers, *counted)},
        "time": 5.0 * np.arange(k),
        "states": rng.standard_normal((SIZE, N_STATES, k)),
        "reference_states": rng.standard_normal((SIZE, N_STATES, k)),
        **{name: rng.standard_normal((SIZE, k)) for name in ("bank_rate", "angle_of_attack")},
        "corrections": rng.integers(0, 9, (SIZE, len(CorrectionOutcome))),
        "path": rng.random((SIZE, 1, k)),
        "peak": rng.random((SIZE, 1)),
    }


def heading(mode: str) -> Heading:
    words = ("world", "world_sha256", "world_toml", "drawn", "pool", "law", "correction")
    words += ("guidance_sha256",)
    numbers = ("position_tolerance", "altitude_tolerance", "speed_tolerance", "entry_altitude")
    attributes = {
        "mission": "synthetic",
        "mission_sha256": "0" * 64,
        "mode": mode,
        "profiles": "density wind",
        "seed": 7,
        "cycle": 0.1,
        "engine": "numpy",
        **{name: f"{name} {mode}" for name in words},
        **dict.fromkeys(numbers, 1e3),
    }
    fixed = {"radius": np.array([3e3]), "limit": np.array(["heat_flux"], "S20")}
    return Heading(COUNT, attributes, fixed)


def fly(
    path: Path,
    marks: Path,
    *,
    n_jobs: int = 1,
    client: Any = None,
    seen: Callable[[Path], None] = lambda kept: None,
    **options: Any,
) -> None:
    """A runner of campaigns as far as records are concerned."""
    with CampaignRecords.open(path, IDENTITY) as records:
        of = {name: records.of(name) for name in CAMPAIGNS}
        missing = [(one, number) for one in of.values() for number in one.missing(COUNT)]
        jobs = (Batch(one, number, marks, **options) for one, number in missing)
        for kept in records.fly("test_campaign_records", jobs, n_jobs, client):
            seen(kept)
        records.merge({name: heading(name) for name in of})


@pytest.fixture
def marks(tmp_path: Path) -> Path:
    where = tmp_path / "marks"
    where.mkdir()
    return where


@pytest.fixture(scope="module")
def quiet(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The file of a campaign that nobody disturbs, flown in this process."""
    where = tmp_path_factory.mktemp("quiet")
    fly(where / "a.h5", where)
    return (where / "a.h5").read_bytes()


@pytest.fixture
def importable(monkeypatch: pytest.MonkeyPatch) -> Any:
    """This file as a module that workers can import."""
    monkeypatch.syspath_prepend(HERE)
    import test_campaign_records

    return test_campaign_records


def flown_again(marks: Path) -> list[str]:
    return sorted(mark.name[:-2] for mark in marks.glob("* 1"))


def test_the_file_holds_what_was_flown(tmp_path: Path, quiet: bytes) -> None:
    path = tmp_path / "a.h5"
    path.write_bytes(quiet)
    loaded = load_campaigns(path)
    assert list(loaded) == list(CAMPAIGNS)
    for name, flights in loaded.items():
        batches = [flown(name, k) for k in range(COUNT)]
        for one in ("miss", "clipped", "parameters", "peak", "seeds", "wind", "greatest_range"):
            assert np.array_equal(
                getattr(flights, one)[()], np.concatenate([b[one] for b in batches])
            )
        for k, batch in enumerate(batches):
            states = flights.states[SIZE * k : SIZE * (k + 1)]
            assert np.array_equal(states[..., : POINTS[k]], batch["states"])
            assert np.isnan(states[..., POINTS[k] :]).all()
        assert flights.times.tolist() == [0.0, 5.0, 10.0, 15.0]
        assert (flights.mode.value, flights.limits) == (name, ("heat_flux",))
        assert flights.drawn == f"drawn {name}"
    assert is_flown(path, IDENTITY)
    assert not is_flown(tmp_path / "absent.h5", IDENTITY)


def test_a_whole_file_of_another_campaign_is_not_overwritten(tmp_path: Path, quiet: bytes) -> None:
    path = tmp_path / "a.h5"
    path.write_bytes(quiet)
    message = (
        r"a\.h5 holds results of another campaign \(different seed \(7 there, 8 here\)\); nothing"
    )
    with pytest.raises(CampaignError, match=message):
        is_flown(path, {**IDENTITY, "seed": "8"})
    with pytest.raises(CampaignError, match=r"different seed \(7 there, none here\)"):
        is_flown(path, {name: value for name, value in IDENTITY.items() if name != "seed"})
    path.write_bytes(quiet[:-1])  # a file that is not whole has nothing to lose
    assert not is_flown(path, IDENTITY)


def test_a_worker_that_is_killed_costs_its_batch(
    tmp_path: Path, marks: Path, quiet: bytes, importable: Any
) -> None:
    path = tmp_path / "a.h5"
    importable.fly(path, marks, n_jobs=2, dies=True)
    assert len(flown_again(marks)) == len(CAMPAIGNS) * COUNT  # each killed its worker once
    assert path.read_bytes() == quiet
    assert sorted(f.name for f in tmp_path.iterdir()) == ["a.h5", "marks"]


def driver(path: Path, marks: Path, n_jobs: int) -> subprocess.Popen[str]:
    call = "import sys; from pathlib import Path; from test_campaign_records import fly; "
    call += "fly(Path(sys.argv[1]), Path(sys.argv[2]), n_jobs=int(sys.argv[3]), waits=True)"
    return subprocess.Popen(
        [sys.executable, "-c", call, path, marks, str(n_jobs)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE), *sys.path])},
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_for_a_batch(marks: Path, process: subprocess.Popen[str]) -> None:
    """Whichever is the first: batches are handed out in order, and begin as threads are scheduled."""
    while not list(marks.glob("nominal * 0")):
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.01)


def test_a_driver_that_is_killed_leaves_what_is_flown(
    tmp_path: Path, marks: Path, quiet: bytes
) -> None:
    """And meanwhile no other flies for the same file."""
    path = tmp_path / "a.h5"
    with CampaignRecords.open(path, IDENTITY) as records:
        for number in (0, 1):
            records.of("nominal").keep(number, flown("nominal", number)).result()
    first = driver(path, marks, 2)
    wait_for_a_batch(marks, first)
    with pytest.raises(CampaignError, match=rf"a\.h5 is being flown by process {first.pid} on .*"):
        fly(path, marks)
    first.kill()
    first.communicate()
    with pytest.raises(ValueError, match="the campaign is not finished"):
        load_campaigns(path)
    (partial_folder(path) / "nominal.000003.rec.elsewhere.12.tmp").touch()  # of a worker that died
    fly(path, marks)
    assert path.read_bytes() == quiet
    assert not list(marks.glob("nominal [01] *"))
    assert sorted(f.name for f in tmp_path.iterdir()) == ["a.h5", "marks"]


def interrupted(path: Path, marks: Path, after: int) -> Path:
    """The folder of a campaign that somebody has stopped."""
    seen: list[Path] = []

    def stop(kept: Path) -> None:
        seen.append(kept)
        if len(seen) == after:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fly(path, marks, seen=stop)
    return partial_folder(path)


@pytest.mark.parametrize("fault", ["cut", "flipped", "absent", "another batch", "another campaign"])
def test_a_record_that_is_not_whole_or_not_ours_is_flown_again(
    tmp_path: Path, marks: Path, quiet: bytes, fault: str
) -> None:
    path = tmp_path / "a.h5"
    folder = interrupted(path, marks, after=COUNT + 4)
    record = folder / "ampi.000002.rec"
    raw = record.read_bytes()
    if fault == "cut":
        record.write_bytes(raw[: len(raw) // 2])
    elif fault == "flipped":
        record.write_bytes(bytes([*raw[:700], raw[700] ^ 4, *raw[701:]]))
    elif fault == "absent":
        record.unlink()
    elif fault == "another batch":
        record.write_bytes((folder / "ampi.000001.rec").read_bytes())
    else:
        record.write_bytes((folder / "nominal.000002.rec").read_bytes())
    fly(path, marks)
    assert path.read_bytes() == quiet
    assert flown_again(marks) == ["ampi 2"]


def test_results_of_another_campaign_are_refused(tmp_path: Path, marks: Path) -> None:
    path = tmp_path / "a.h5"
    folder = interrupted(path, marks, after=2)
    other = {**IDENTITY, "table_sha256": "2" * 64, "seed": "8"}
    message = (
        r"holds results of another campaign \(different table_sha256, seed \(7 there, 8 here\)\)"
    )
    with pytest.raises(CampaignError, match=message), CampaignRecords.open(path, other):
        pass
    less = {name: value for name, value in IDENTITY.items() if name != "seed"}
    with (
        pytest.raises(CampaignError, match=r"different seed \(7 there, none here\)"),
        CampaignRecords.open(path, less),
    ):
        pass
    assert len(list(folder.glob("*.rec"))) == 2
    with CampaignRecords.open(path, other, resume=False) as records:
        assert records.of("nominal").missing(COUNT) == list(range(COUNT))


def test_records_of_nobody_knows_what_are_refused(
    tmp_path: Path, marks: Path, quiet: bytes
) -> None:
    """One copy of what they belong to is enough."""
    path = tmp_path / "a.h5"
    folder = interrupted(path, marks, after=2)
    text = (folder / COPIES[0]).read_text()
    for name in COPIES:
        (folder / name).write_text("?")
    with pytest.raises(CampaignError, match=r"nobody knows what its 2 finished batches belong to"):
        fly(path, marks)
    (folder / COPIES[1]).write_text(text)
    fly(path, marks)
    assert path.read_bytes() == quiet
    assert not flown_again(marks)


def test_other_software_is_another_campaign(
    tmp_path: Path, marks: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.h5"
    interrupted(path, marks, after=2)
    monkeypatch.setattr(
        "ampi.simulation.campaign_records.software", lambda: {"numpy_version": "9.9"}
    )
    with pytest.raises(CampaignError, match=r"numpy_version \(\d\S* there, 9\.9 here\)"):
        fly(path, marks)


def test_a_record_lost_at_the_end_is_one_sentence(tmp_path: Path, marks: Path) -> None:
    path = tmp_path / "a.h5"

    def lose(kept: Path) -> None:
        if kept.name == "ampi.000005.rec":
            (kept.parent / "nominal.000003.rec").unlink()

    with pytest.raises(
        CampaignError, match=r"disappeared or changed .*: fly the same campaign"
    ) as e:
        fly(path, marks, seen=lose)
    assert "11 finished batches are kept" in str(e.value)
    assert not path.exists()
    assert not path.with_name("a.h5.tmp").exists()


def test_a_path_that_cannot_be_is_one_sentence(tmp_path: Path, marks: Path) -> None:
    with pytest.raises(CampaignError, match=r"a\.h5: the folder .*absent does not exist"):
        fly(tmp_path / "absent" / "a.h5", marks)
    with pytest.raises(CampaignError, match="expected a file to write, got a folder"):
        fly(marks, marks)
