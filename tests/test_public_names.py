"""What `import ampi` promises is there."""

from __future__ import annotations

from importlib.metadata import version

import pytest

import ampi


@pytest.mark.parametrize("name", ampi.__all__)
def test_every_public_name_is_there(name: str) -> None:
    assert getattr(ampi, name) is not None


def test_the_version_is_that_of_the_package() -> None:
    assert ampi.__version__ == version("ampi")
