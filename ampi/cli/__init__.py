"""The command line `ampi`: parse, hand over, print. The only room that may import everything.

A family of commands is a file. What a command needs it imports when it runs: `ampi --help` costs what
typer and rich cost.
"""

from __future__ import annotations

import sys

import typer

from ampi.cli import (
    atmosphere,
    audit,
    authoring,
    build,
    cases,
    check,
    diff,
    doctor,
    explore,
    export,
    fly,
    guide,
    missions,
    papers,
    report,
    sensitivity,
    solve,
)
from ampi.cli.console import error_out, out, print_error
from ampi.cli.endings import watch_signals
from ampi.cli.terminal import discard, standard_stream

app = typer.Typer(
    help="Entry guidance from a database of optimal trajectories.",
    epilog="Exit status: 0 done; 1 done in part, and the output says what is missing; 2 refused, "
    "not solved or damaged, and one sentence on standard error says why; 130 interrupted, and what "
    "is solved is kept.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for command in (  # in the order of --help
    missions.missions,
    missions.worlds,
    authoring.new,
    authoring.schema,
    atmosphere.atmosphere,
    check.check,
    solve.solve,
    build.build,
    cases.rerun,
    cases.verify,
    audit.audit,
    build.refine,
    build.crop,
    diff.diff,
    guide.guide,
    fly.fly,
    sensitivity.sensitivity,
    report.report,
    explore.explore,
    export.export,
    papers.reproduce,
    doctor.doctor,
):
    app.command()(command)


def main() -> None:
    """Entry point. What cannot be shown on standard output changes no result."""
    sys.stdout, sys.stderr = map(standard_stream, (sys.stdout, sys.stderr))
    out.file, error_out.file = sys.stdout, sys.stderr  # their encoding decides on a table's lines
    watch_signals()
    try:
        try:
            app()
        finally:
            sys.stdout.flush()
    except OSError as error:
        discard(sys.stdout)
        if isinstance(error, BrokenPipeError):  # the reader has seen enough
            sys.exit(1)
        print_error(f"standard output: {error.strerror}")
        sys.exit(2)
