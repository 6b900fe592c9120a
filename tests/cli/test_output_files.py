"""A command looks at what it is to write before the work, and replaces nothing that is dear."""

import os

import pytest

from ampi.cli.output_files import check_figures, check_output
from ampi.simulation.flights_schema import SEAL


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
        ("flights.h5", b"PK", "needs this file for something else"),
    ],
)
def test_no_force_takes_a_mission_a_database_or_an_input(tmp_path, name, content, refusal):
    path = tmp_path / name
    path.write_bytes(content)
    (tmp_path / "link").symlink_to(path)
    for output in (path, tmp_path / "link"):
        with pytest.raises(ValueError, match=refusal):
            check_output(output, force=True, others=[None, tmp_path / "flights.h5"])


def test_flights_are_replaced_if_asked(tmp_path):
    """They are HDF5 as databases are, and begin otherwise."""
    path = tmp_path / "flights.h5"
    path.write_bytes(SEAL.text.ljust(512) + b"\x89HDF\r\n\x1a\n")
    with pytest.raises(ValueError, match="already there"):
        check_output(path)
    check_output(path, force=True)


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
