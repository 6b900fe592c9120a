"""The file of flights: readable by any tool, whole or refused, and written without holding it."""

from __future__ import annotations

import shutil
import subprocess
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray

from ampi.onboard.reference import Mode
from ampi.simulation.flights import Flights
from ampi.simulation.flights_file import content_of, load_campaigns, save_campaigns
from ampi.simulation.flights_schema import FIELDS, SEAL, TIME
from ampi.simulation.flights_writer import Arrays, Content, write_flights
from ampi.simulation.stored_history import StoredHistory
from tests.support.flights import assert_identical

Maker = Callable[..., Flights]


def test_campaigns_survive_their_file(make_flights: Maker, tmp_path: Path) -> None:
    """In their order, more flights than are written together; one of a type and sign of everything."""
    here = make_flights(230, position_tolerance=np.inf)
    other = make_flights(17, seed=4, mode=Mode.NOMINAL)
    path = tmp_path / "campaigns.h5"
    save_campaigns(path, {"nominal": other, "ampi": here})
    loaded = load_campaigns(path)
    assert list(loaded) == ["nominal", "ampi"]
    assert_identical(loaded["ampi"], here)
    assert_identical(loaded["nominal"], other)
    assert [f.name for f in tmp_path.iterdir()] == ["campaigns.h5"]


def test_a_flight_is_read_without_the_others(make_flights: Maker, tmp_path: Path) -> None:
    here, path = make_flights(150), tmp_path / "a.h5"
    save_campaigns(path, {"ampi": here})
    lazy = load_campaigns(path)["ampi"]
    assert isinstance(lazy.states, StoredHistory)
    assert np.array_equal(np.asarray(lazy.bank_rate), here.bank_rate)
    assert isinstance(lazy.miss, np.ndarray)
    assert np.array_equal(lazy.states[120], here.states[120])
    assert np.array_equal(lazy.path[:, 2], here.path[:, 2])


def test_saving_again_replaces_the_file(make_flights: Maker, tmp_path: Path) -> None:
    """Who has loaded the first one is told; what is loaded can be saved in its own place."""
    path = tmp_path / "campaigns.h5"
    first = make_flights(5)
    save_campaigns(path, {"ampi": first, "mpi": make_flights(5, mode=Mode.MPI)})
    read, second = load_campaigns(path)["ampi"], make_flights(6, seed=2)
    save_campaigns(path, {"ampi": second})
    loaded = load_campaigns(path)
    assert list(loaded) == ["ampi"]
    assert_identical(loaded["ampi"], second)
    assert np.array_equal(read.miss, first.miss)
    with pytest.raises(OSError, match="the file has changed since it was loaded; load it again"):
        read.states[0]
    save_campaigns(path, {"ampi": loaded["ampi"]})
    assert_identical(load_campaigns(path)["ampi"], second)


def test_the_same_flights_are_the_same_bytes(make_flights: Maker, tmp_path: Path) -> None:
    for name in ("a.h5", "b.h5"):
        save_campaigns(tmp_path / name, {"ampi": make_flights(130)})
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_xarray_opens_it_with_named_dimensions(make_flights: Maker, tmp_path: Path) -> None:
    here, path = make_flights(12), tmp_path / "a.h5"
    save_campaigns(path, {"ampi": here})
    with xarray.open_dataset(path, group="ampi", engine="h5netcdf") as data:
        assert data.states.dims == ("flight", "state", "time")
        assert data.peak.dims == ("flight", "limit")
        assert np.array_equal(data.time, here.times)
        assert data.radius.attrs["units"] == "m"
        assert data.clipped.dtype == bool
        altitude = data.states.sel(state=b"altitude", flight=7)
        assert np.array_equal(altitude, here.states[7, 0])
        assert data.attrs["mode"] == "ampi"
        for name, field in FIELDS.items():
            assert (data[name].dims, data[name].attrs["units"]) == (field.dimensions, field.units)
            assert data[name].attrs["long_name"] == field.long_name


@pytest.mark.skipif(shutil.which("h5dump") is None, reason="h5dump (hdf5-tools) is not installed")
def test_h5dump_reads_it(make_flights: Maker, tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    save_campaigns(path, {"ampi": make_flights(12)})
    told = subprocess.run(
        ["h5dump", "-H", "-p", "-d", "/ampi/states", path],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    for word in ("( 12, 7, 4 )", "CHECKSUM FLETCHER32", "PREPROCESSING SHUFFLE", "DEFLATE"):
        assert word in told


def test_a_file_keeps_campaigns_of_one_mission(make_flights: Maker, tmp_path: Path) -> None:
    other = make_flights(5, mission_sha256="1" * 64, mission="other")
    with pytest.raises(ValueError, match="one mission, got a of synthetic, b of other"):
        save_campaigns(tmp_path / "two.h5", {"a": make_flights(5), "b": other})
    for name in ("", "a/b", "..", "."):
        with pytest.raises(ValueError, match="campaigns: expected names of letters, digits"):
            save_campaigns(tmp_path / "two.h5", {name: make_flights(5)})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("sealed", [False, True])
@pytest.mark.parametrize("fault", ["value", "type", "missing", "mode", "version"])
def test_a_file_changed_by_hand_is_refused(
    make_flights: Maker, tmp_path: Path, fault: str, sealed: bool
) -> None:
    """By its seal; and with a forged one, whatever is no campaign."""
    path = tmp_path / "flights.h5"
    save_campaigns(path, {"ampi": make_flights(5), "mpi": make_flights(5, mode=Mode.MPI)})
    with h5py.File(path, "r+") as file:
        if fault == "value":
            file["ampi/miss"][2] = np.nan
        elif fault == "type":
            del file["ampi/status"]
            file["ampi/status"] = np.zeros(5)
        elif fault == "missing":
            del file["mpi/peak"]
        elif fault == "mode":
            file["ampi"].attrs["mode"] = "best"
        else:
            file.attrs["schema_version"] = 99
    if sealed:
        SEAL.write(path)
    with pytest.raises(ValueError, match="not a whole file of flights"):
        load_campaigns(path)


def test_damage_of_any_byte_is_one_sentence(make_flights: Maker, tmp_path: Path) -> None:
    path = tmp_path / "flights.h5"
    save_campaigns(path, {"ampi": make_flights(5)})
    whole = path.read_bytes()
    rng = np.random.default_rng(1)
    places = [0, 511, 512, len(whole) - 1, *rng.integers(0, len(whole), 200)]
    for cut in (True, False):
        for place in places:
            damaged = bytearray(whole[:place] if cut else whole)
            if not cut:
                damaged[place] ^= 1 << int(rng.integers(8))
            path.write_bytes(damaged)
            with pytest.raises(ValueError, match="not a whole file of flights") as told:
                load_campaigns(path)
            assert "\n" not in str(told.value)


def test_what_is_no_file_of_flights_is_told_apart(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        load_campaigns(tmp_path / "absent.h5")
    (tmp_path / "a.h5.partial").mkdir()
    with pytest.raises(ValueError, match=r"not finished .*; fly the same campaign again"):
        load_campaigns(tmp_path / "a.h5")


# --- the writer -----------------------------------------------------------------------------------


class Made:
    """Batches that are made when they are asked for."""

    def __init__(self, flights: Flights, counts: list[int], points: list[int]) -> None:
        self.arrays = dict(content_of(flights).batches.arrays)  # type: ignore[attr-defined]
        self.times, self.counts, self.points = flights.times, counts, points
        self.instead = dict[str, np.ndarray]()

    def shapes(self) -> Iterator[dict[str, tuple[int, ...]]]:
        for batch in self:
            yield {name: values.shape for name, values in batch.items()}

    def __iter__(self) -> Iterator[Arrays]:
        first = 0
        for count, k in zip(self.counts, self.points, strict=True):
            chosen = np.arange(first, first + count) % len(self.arrays["miss"])
            batch = {name: values[chosen] for name, values in self.arrays.items()}
            for name, values in batch.items():
                if TIME in FIELDS[name].dimensions:
                    batch[name] = values[..., :k]
            yield {**batch, TIME: self.times[:k], **self.instead}
            first += count


def content(flights: Flights, counts: list[int], points: list[int]) -> Content:
    known = content_of(flights)
    fixed = {name: values for name, values in known.fixed.items() if name != TIME}
    return Content(known.attributes, fixed, Made(flights, counts, points))


def test_batches_that_end_sooner_are_filled_up(make_flights: Maker, tmp_path: Path) -> None:
    """The recorded times are those of the longest batch, wherever it is."""
    here, path = make_flights(50), tmp_path / "a.h5"
    write_flights(path, {"ampi": content(here, [20, 20, 10], [2, 4, 3])}, {})
    loaded = load_campaigns(path)["ampi"]
    assert np.array_equal(loaded.times, here.times)
    expected = here.states.copy()
    expected[:20, :, 2:] = np.nan
    expected[40:, :, 3:] = np.nan
    assert np.array_equal(loaded.states[()], expected, equal_nan=True)
    assert np.array_equal(loaded.miss, here.miss)
    with h5py.File(path) as file:
        assert np.array_equal(file["ampi/flight"], np.arange(50))


def test_the_memory_does_not_grow_with_the_flights(make_flights: Maker, tmp_path: Path) -> None:
    k = 40
    rng = np.random.default_rng(0)
    changes = {name: rng.standard_normal((100, 7, k)) for name in ("states", "reference_states")}
    long = make_flights(
        100,
        times=np.arange(float(k)),
        bank_rate=np.zeros((100, k)),
        angle_of_attack=np.zeros((100, k)),
        path=np.zeros((100, 5, k)),
        **changes,
    )
    peaks = []
    for batches in (3, 3, 30):  # the first time what is imported counts too
        several = content(long, [100] * batches, [k] * batches)
        tracemalloc.start()
        write_flights(tmp_path / "a.h5", {"ampi": several}, {})
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    one = sum(values.nbytes for values in changes.values())
    assert peaks[2] - peaks[1] < one  # of 27 more batches


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"taste": np.zeros(5)}, "flights.taste: expected an array of the schema"),
        ({"miss": np.zeros(4)}, r"flights.miss: expected an array \(flight\) of shape \(5,\), got"),
        ({"peak": np.zeros((5, 3))}, r"flights.peak: .*of shape \(5, 5\), got \(5, 3\)"),
        ({"miss": np.zeros((5, 1))}, r"flights.miss: .* got \(5, 1\)"),
    ],
)
def test_arrays_that_are_not_of_the_schema_are_refused(
    make_flights: Maker, tmp_path: Path, changes: dict[str, np.ndarray], message: str
) -> None:
    several = content(make_flights(5), [5], [4])
    several.batches.instead.update(changes)  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match=message):
        write_flights(tmp_path / "a.h5", {"ampi": several}, {})


def test_batches_of_other_times_are_refused(make_flights: Maker, tmp_path: Path) -> None:
    one = content(make_flights(5), [5], [4])
    other = content(make_flights(5, times=np.arange(4.0) * 2.0), [5], [4])

    class Both(Made):
        def __iter__(self) -> Iterator[Arrays]:
            yield from one.batches
            yield from other.batches

    both = Content(one.attributes, one.fixed, Both(make_flights(5), [5], [4]))
    with pytest.raises(ValueError, match=r"flights\.time: expected the same in all batches"):
        write_flights(tmp_path / "a.h5", {"ampi": both}, {})
