"""What is printed of a Health."""

from __future__ import annotations

import pytest

from ampi.onboard.health import Health


@pytest.mark.parametrize("health", list(Health))
def test_it_prints_its_name_and_counts_as_its_number(health: Health) -> None:
    assert str(health) == f"{health}" == health.name
    assert health == int(health)
    assert len(health.sentence) > 10
    assert health.sentence.endswith(".")


def test_every_health_has_a_number_and_a_sentence_of_its_own() -> None:
    assert len({h.sentence for h in Health}) == len({int(h) for h in Health}) == len(Health)
