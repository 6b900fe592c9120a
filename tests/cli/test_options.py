"""What a text given for an option may say, and that its help names all of it."""

from __future__ import annotations

import pytest

from ampi.cli.options import key_and_value, one_of
from ampi.loading import HOLES, LAWS
from ampi.onboard.reference import Mode
from ampi.papers.reproduction import PAPERS
from ampi.simulation.world_loading import shipped_worlds
from tests.support.command_line import run

MODES = [mode.value for mode in Mode]


@pytest.mark.parametrize(
    ("command", "choices"),
    [
        ("guide", [*MODES, *HOLES]),
        ("fly", [*MODES, *HOLES, *shipped_worlds(), *LAWS]),
        ("reproduce", list(PAPERS)),
    ],
)
def test_the_help_names_every_choice(command: str, choices: list[str]) -> None:
    """They are written there by hand: to read them would load numpy before a command runs."""
    told = run(command, "--help").stdout
    assert [choice for choice in choices if choice not in told] == []


def test_a_choice_is_one_of_its_values() -> None:
    assert one_of(HOLES, "fly", "--holes") == "fly"
    with pytest.raises(ValueError, match="--holes: expected refuse or fly, got 'Fly'"):
        one_of(HOLES, "Fly", "--holes")
    with pytest.raises(ValueError, match=r"paper: expected one of zhou2021, liu2015, .*, got ''"):
        one_of(PAPERS, "", "paper")


def test_a_pair_is_a_key_and_a_number() -> None:
    assert key_and_value(" mass_kg = 5e2", "--drop") == ("mass_kg", 500.0)
    for text in ("mass_kg", "mass_kg=", "mass_kg=heavy"):
        with pytest.raises(ValueError, match="--drop: expected KEY=NUMBER, got 'mass_kg"):
            key_and_value(text, "--drop")
