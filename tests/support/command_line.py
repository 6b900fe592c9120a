"""The command line in this process: what a command prints, and its exit status."""

from __future__ import annotations

from contextlib import chdir
from pathlib import Path

from typer.testing import CliRunner, Result

from ampi.cli import app


def run(*arguments: str | Path, cwd: Path = Path(), code: int = 0) -> Result:
    """`ampi` with these arguments in a folder; it must end with this exit status, and orderly."""
    with chdir(cwd):
        done = CliRunner().invoke(app, [*map(str, arguments)])
    assert done.exit_code == code, done.output
    assert done.exception is None or isinstance(done.exception, SystemExit)
    return done


def unwrapped(text: str) -> str:
    """Without the line breaks of a narrow terminal."""
    return " ".join(text.split())
