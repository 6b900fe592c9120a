"""What flies pulls in numpy alone: seen from a fresh interpreter."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

GROUND = ("scipy", "casadi", "h5py", "clarabel", "cvxpy", "joblib", "pydantic", "numba")
FLIES = (
    "ampi.onboard",
    "ampi.tracking",
    "ampi.estimation.estimator",
    "ampi.correction.corrected_cycle",
    "ampi.guidance",
)
PARTS = tuple(
    f"onboard.{name}"
    for name in (
        "reference",
        "table",
        "row_layout",
        "subspace",
        "interpolation",
        "aerodynamic_forms",
        "flight_model",
        "certificate",
    )
)
LAWS = (
    "tracking.bank_limiter",
    "tracking.linear_quadratic",
    "tracking.drag_sliding_mode",
    "tracking.drag_shuttle",
    "guidance_cycle",
    "compiled_cycle",
    "guidance",
)

PROGRAM = """
import importlib, json, sys
import numpy
before = set(sys.modules)
for name in sys.argv[1:]:
    importlib.import_module(name)
tops = {m.partition(".")[0] for m in set(sys.modules) - before}
own = sorted(m for m in sys.modules if m.partition(".")[0] in ("ampi", "database"))
print(json.dumps({"own": own, "tops": sorted(tops)}))
"""


def loaded_by(*names: str) -> dict[str, list[str]]:
    """Modules loaded by importing `names` after numpy, in a new process."""
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM, *names], capture_output=True, text=True, check=True
    )
    return dict(json.loads(run.stdout))


@pytest.mark.parametrize("name", [*FLIES, *(f"ampi.{part}" for part in (*PARTS, *LAWS))])
def test_importing_it_loads_numpy_and_the_standard_library_alone(name: str) -> None:
    loaded = loaded_by(name)
    assert not set(loaded["tops"]) & set(GROUND)
    strangers = set(loaded["tops"]) - set(sys.stdlib_module_names) - {"ampi", "numpy"}
    assert not strangers
    assert name in loaded["own"]


def test_all_of_it_loads_no_other_room() -> None:
    loaded = loaded_by(*FLIES, *(f"ampi.{part}" for part in (*PARTS, *LAWS)))
    rooms = {name.split(".")[1] for name in loaded["own"] if "." in name}
    assert rooms == {
        "onboard",
        "shown",
        "tracking",
        "estimation",
        "correction",
        "guidance",
        "guidance_cycle",
        "compiled_cycle",
        "export",  # of it the table as the C reads it
        "_native",
        "outcome",
    }  # the last by the standard library


def test_the_probe_sees_what_is_loaded() -> None:
    assert {"scipy", "h5py", "pydantic"} <= set(loaded_by("ampi.dataset", "ampi.scp.guess")["tops"])
