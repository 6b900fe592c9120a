"""A result gets its name when it is whole; what fails leaves what was there."""

import errno
import os
import resource

import pytest

from ampi.outputs import check_figures, check_output, written


def test_the_file_has_its_name_when_the_block_ends(tmp_path):
    path = tmp_path / "result.csv"
    path.write_text("old")
    with written(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
        assert temporary.suffix == ".csv"  # writers go by it
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def test_a_link_stays_one(tmp_path):
    (tmp_path / "there").mkdir()
    link = tmp_path / "link.csv"
    link.symlink_to(tmp_path / "there" / "real.csv")
    with written(link) as temporary:
        temporary.write_text("new")
    assert link.is_symlink()
    assert (tmp_path / "there" / "real.csv").read_text() == "new"


def test_what_fails_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "result.csv"
    path.write_text("old")
    with pytest.raises(RuntimeError), written(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_no_room_names_the_file_that_was_asked_for(tmp_path):
    path = tmp_path / "result.csv"
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with (
            pytest.raises(OSError, match=r"File too large.*result\.csv") as caught,
            written(path) as temporary,
        ):
            temporary.write_bytes(bytes(5000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert caught.value.errno == errno.EFBIG
    assert list(tmp_path.iterdir()) == []


def test_two_writers_of_one_name_do_not_mix(tmp_path):
    path = tmp_path / "result.csv"
    with written(path) as first, written(path) as second:
        first.write_text("first")
        second.write_text("second")
        assert first != second
    assert path.read_text() == "first"  # its block ended last


def test_what_another_made_is_replaced_only_if_asked(tmp_path):
    path = tmp_path / "result.png"
    check_output(path)
    path.write_bytes(b"a picture of the family")
    for made_by in (None, "ampi solve"):
        with pytest.raises(ValueError, match=r"already there.*--force"):
            check_output(path, made_by=made_by)
        check_output(path, made_by=made_by, force=True)
    path.write_bytes(b"made by ampi solve" + bytes(9000))
    check_output(path, made_by="ampi solve")
    path.write_bytes(bytes(9000) + b"made by ampi solve")  # a PDF says so at its end
    check_output(path, made_by="ampi solve")
    with pytest.raises(ValueError, match="already there"):
        check_output(path, made_by="ampi guide")


@pytest.mark.parametrize(
    ("name", "content", "refusal"),
    [
        ("m.toml", b"", "is a mission file"),
        ("M.TOML", b"", "is a mission file"),
        ("whole.h5", b"\x89HDF\r\n\x1a\n", "is a trajectory database"),
        ("sealed.dat", bytes(512) + b"\x89HDF\r\n\x1a\n", "is a trajectory database"),
        ("flights.npz", b"PK", "needs this file for something else"),
    ],
)
def test_no_force_takes_a_mission_a_database_or_an_input(tmp_path, name, content, refusal):
    path = tmp_path / name
    path.write_bytes(content)
    (tmp_path / "link").symlink_to(path)
    for output in (path, tmp_path / "link"):
        with pytest.raises(ValueError, match=refusal):
            check_output(output, force=True, others=[None, tmp_path / "flights.npz"])


def test_two_outputs_are_two_files(tmp_path):
    with pytest.raises(ValueError, match="needs this file for something else"):
        check_output(tmp_path / "one", others=[tmp_path / "sub" / ".." / "one"])


def test_a_device_is_no_file(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ValueError, match="got a device or a pipe"):
        check_output(tmp_path / "pipe", force=True)


def test_figures_of_others_in_a_folder_stay(tmp_path):
    check_figures(tmp_path / "new", ["a.png"], made_by="ampi audit")
    (tmp_path / "a.png").write_bytes(b"ampi audit")
    (tmp_path / "b.png").write_bytes(b"another")
    check_figures(tmp_path, ["a.png"], made_by="ampi audit")
    with pytest.raises(ValueError, match=r"b\.png is already there"):
        check_figures(tmp_path, ["a.png", "b.png"], made_by="ampi audit")
