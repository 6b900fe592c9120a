"""A campaign flies where there is no compiled engine, and is told why."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ampi._native import engine
from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.simulation import closed_loop, engines, native_loop
from ampi.simulation.world_loading import load_world


@pytest.fixture
def _no_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> Any:
        raise ImportError(f"No module named {name!r}")

    monkeypatch.setattr(engine, "import_module", missing)
    found, why = engine._loaded()
    monkeypatch.setattr(engine, "_core", found)
    monkeypatch.setattr(engine, "WHY_NOT", why)


@pytest.mark.usefixtures("_no_compiler")
def test_without_a_compiler_the_package_says_so_and_flies_in_numpy(
    short: Mission, short_guidance: Guidance
) -> None:
    assert not engine.is_available()
    with pytest.raises(ImportError, match="without its compiled engine"):
        engine.core()
    truth = load_world("entry").draw(short, 2, 1)
    guidance = short_guidance.on_engine("numpy").at_cycle(2.0)
    batch = engines.fly_batch(short.family(truth.parameters), guidance, truth)
    assert np.isfinite(batch.final_states).all()


def test_the_engine_of_the_guidance_flies(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, loop in (("native", native_loop), ("numpy", closed_loop)):
        monkeypatch.setattr(loop, "fly_batch", lambda *given, own=name, **named: (own, given))
        guidance: Any = SimpleNamespace(engine=name)
        assert engines.fly_batch(1, guidance, 2, 3.0) == (name, (1, guidance, 2, 3.0))  # type: ignore[arg-type,comparison-overlap]
