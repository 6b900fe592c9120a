"""A recorded function as JavaScript does what numpy does."""

from __future__ import annotations

import json
import shutil
import subprocess
from typing import Any

import numpy as np
import pytest

from ampi.export.javascript import javascript
from ampi.tracing.value_graph import Recorder


def everything(x: Any, y: Any) -> list[Any]:
    """Every operation that a trace may hold."""
    plain = [x + y, x - 2.5, 3.0 * x, x / y, -x, np.abs(-y), np.sqrt(y), np.sign(x)]
    roots = [np.floor(3.7 * x), np.exp(x), np.log(y), np.sin(x), np.cos(x), np.tan(x)]
    turns = [np.arcsin(0.1 * x), np.arccos(0.1 * x), np.arctan(x), np.tanh(x), np.arctan2(x, y)]
    chosen = [np.minimum(x, y), np.maximum(x, -1.0), (x < y) * 1.0, (x <= 0.7) * y]
    return [*plain, *roots, *turns, *chosen, np.power(y, 1.7), x * (y == 2.0), x * (y != 2.0)]


def test_javascript_computes_what_numpy_computes() -> None:
    if shutil.which("node") is None:
        pytest.skip("NOT CHECKED: no node, the physics of the page is checked in the browser alone")
    recorder = Recorder()
    source = javascript(recorder.graph([[], everything(*recorder.inputs(2))]), "f", [1])
    points = [[0.7, 2.0], [-1.3, 0.4], [0.0, 5.0]]
    call = f"{points}.map((i) => {{ const o = []; f(i, o); return o; }})"
    program = f"{source}console.log(JSON.stringify({call}))"
    told = subprocess.run(["node", "-e", program], check=True, capture_output=True, text=True)
    for (x, y), found in zip(points, json.loads(told.stdout), strict=True):
        own = [float(value) for value in everything(np.float64(x), np.float64(y))]
        np.testing.assert_allclose(found, own, rtol=1e-14, atol=1e-300)
