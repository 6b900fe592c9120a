"""Parameters that several commands share, and what a text given for one of them may say."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from pathlib import Path
from typing import Annotated, TypeVar

import typer

Member = TypeVar("Member", bound=Enum)
Text = TypeVar("Text", bound=str)


class _Cores:
    """Cores that this process may use, counted when that is shown or used: joblib loads numpy."""

    def __call__(self) -> int:
        import joblib

        return int(joblib.cpu_count())

    def __str__(self) -> str:
        return str(self())


MissionArgument = Annotated[str, typer.Argument(help="Name of a shipped mission, or a .toml file.")]
DatabaseArgument = Annotated[Path, typer.Argument(help="Trajectory database (.h5).")]
Jobs = Annotated[
    int, typer.Option("--jobs", "-j", min=1, help="Worker processes.", default_factory=_Cores())
]
Json = Annotated[bool, typer.Option("--json", help="Print numbers as JSON.")]
Force = Annotated[
    bool,
    typer.Option(
        "--force",
        help="Replace flights, and files of other commands, that are already there.",
    ),
]
HolesOption = Annotated[
    str, typer.Option("--holes", help="Of a database with unsolved cases: refuse it, or fly it.")
]
WorldOption = Annotated[
    str,
    typer.Option(
        help="Comma-separated: entry, hexeract, factors, everything, arctic, arctic_january, or "
        ".toml files."
    ),
]
LawOption = Annotated[
    str,
    typer.Option(help="Comma-separated: linear_quadratic, drag_sliding_mode, drag_shuttle."),
]
ModulateOption = Annotated[
    bool,
    typer.Option(
        "--modulate", help="Laws change the angle of attack, too, as far as the mission allows."
    ),
]
CorrectionOption = Annotated[
    str,
    typer.Option(
        "--correction",
        help="Of the plan in flight, comma-separated: none, bank, bank_and_angle (of attack).",
    ),
]
MODES = "nominal, mpi, ampi, nearest, quadratic, cubic, second_differences, hermite"
ONE_MODE = f"One of {MODES}."
ModesOption = Annotated[str, typer.Option(help=f"Comma-separated: {MODES}.")]
EngineOption = Annotated[
    str,
    typer.Option(help="What computes: native (compiled), numpy, or auto: native if it is built."),
]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of the campaign.")]
PoolOption = Annotated[str, typer.Option(help="Of draws: reported, or tuning.")]


def one_of(values: Iterable[Text], text: str, option: str) -> Text:
    """The value that the text is."""
    values = list(values)
    for value in values:
        if value == text:
            return value
    expected = " or ".join(values) if len(values) == 2 else f"one of {', '.join(values)}"
    raise ValueError(f"{option}: expected {expected}, got {text!r}")


def member(enumeration: type[Member], text: str, option: str) -> Member:
    """The member of an enumeration with this value."""
    return enumeration(one_of([each.value for each in enumeration], text, option))


def key_and_value(text: str, option: str) -> tuple[str, float]:
    """Both sides of KEY=NUMBER."""
    key, _, value = text.partition("=")
    try:
        return key.strip(), float(value)
    except ValueError:
        raise ValueError(f"{option}: expected KEY=NUMBER, got {text!r}") from None
