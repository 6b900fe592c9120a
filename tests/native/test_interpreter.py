"""The interpreter, operation by operation and as whole programs, against numpy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi._native.engine import core, is_available
from ampi.simulation.native_program import scalars_of
from ampi.tracing.instruction_list import FLIGHT, MOMENT, SHARED, Assembler, coded
from ampi.tracing.value_graph import Recorder

Array = NDArray[np.float64]
NOWHERE = 0xFFFF
SPECIAL = np.array([0.0, -0.0, 1.0, -1.0, np.nan, np.inf, -np.inf, 1e-310, 1e300, -750.0, 1e7, 0.5])

NUMPY: dict[str, Callable[..., Any]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "mul_add": lambda a, b, c: a * b + c,
    "mul_sub": lambda a, b, c: a * b - c,
    "sub_mul": lambda a, b, c: c - a * b,
    "min": np.minimum,
    "max": np.maximum,
    "lt": np.less,
    "le": np.less_equal,
    "eq": np.equal,
    "ne": np.not_equal,
    "pow": np.power,
    "atan2": np.arctan2,
    "neg": np.negative,
    "abs": np.abs,
    "sqrt": np.sqrt,
    "sign": np.sign,
    "floor": np.floor,
    "exp": np.exp,
    "log": np.log,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "tanh": np.tanh,
}
EXACT = {
    "add",
    "sub",
    "mul",
    "div",
    "mul_add",
    "mul_sub",
    "sub_mul",
    "min",
    "max",
    "lt",
    "le",
    "eq",
}
EXACT |= {"ne", "neg", "abs", "sqrt", "sign", "floor"}
ELSEWHERE = {"fill", "horner", "sincos_v"}
OPERATIONS = sorted(set(core().OPCODES) - ELSEWHERE) if is_available() else []


def sets() -> list[str]:
    return [core().BASELINE, core().INSTRUCTION_SET]


def evaluated(
    code: list[list[int]], outputs: list[int], scalars: Array, inputs: Array, instruction_set: str
) -> Array:
    found = np.empty((len(outputs), inputs.shape[1]))
    core().evaluate(
        coded(code),
        np.array(outputs, dtype=np.uint16),
        8,
        scalars,
        np.ascontiguousarray(inputs),
        inputs.shape[1],
        found,
        instruction_set,
    )
    return found


@pytest.fixture
def points() -> Array:
    """(3, n): random numbers of all sizes, and every pair of special ones; n is no multiple of 64."""
    rng = np.random.default_rng(17)
    random = rng.standard_normal((3, 500)) * 10.0 ** rng.integers(-8, 8, (3, 500))
    pairs = np.array(np.meshgrid(SPECIAL, SPECIAL, [0.7, np.nan])).reshape(3, -1)
    return np.concatenate([random, pairs], axis=1)


@pytest.mark.parametrize("name", OPERATIONS)
def test_an_operation_is_numpys(name: str, points: Array) -> None:
    operation, _, kinds = name.rpartition("_")
    scalars = np.array([0.3, -2.5, 3.0])
    code = [[core().OPCODES[name], 3, NOWHERE, 0, 1, 2][:6]]
    operands = [
        points[k] if kind == "v" else np.full(points.shape[1], scalars[k])
        for k, kind in enumerate(kinds)
    ]
    with np.errstate(all="ignore"):
        expected = np.asarray(NUMPY[operation](*operands), dtype=float)
    for instruction_set in sets():
        found = evaluated(code, [3], scalars, points, instruction_set)[0]
        assert np.array_equal(np.isnan(found), np.isnan(expected))
        if operation in EXACT:
            assert np.array_equal(found, expected, equal_nan=True)
        else:
            with np.errstate(all="ignore"):
                near = np.abs(found - expected) <= 4.0 * np.spacing(np.abs(expected))
            assert np.all(near | (found == expected) | np.isnan(expected))


def test_sine_and_cosine_share_an_instruction(points: Array) -> None:
    code = [[core().OPCODES["sincos_v"], 3, 4, 0, NOWHERE, 0]]
    angles = np.concatenate([points, np.tile(np.linspace(-7.0, 7.0, 999), (3, 1))], axis=1)
    with np.errstate(all="ignore"):
        expected = np.stack([np.sin(angles[0]), np.cos(angles[0])])
    for instruction_set in sets():
        found = evaluated(code, [3, 4], np.zeros(0), angles, instruction_set)
        assert np.array_equal(np.isnan(found), np.isnan(expected))
        assert np.nanmax(np.abs(found - expected)) <= 2.3e-16


def test_a_polynomial_is_horners_rule(points: Array) -> None:
    scalars = np.array([9.0, 2.0, -3.0, 0.1, 5.0])
    code = [[core().OPCODES["horner"], 3, NOWHERE, 0, 1, 4]]
    with np.errstate(all="ignore"):
        expected = ((2.0 * points[0] - 3.0) * points[0] + 0.1) * points[0] + 5.0
    for instruction_set in sets():
        found = evaluated(code, [3], scalars, points, instruction_set)[0]
        assert np.array_equal(found, expected, equal_nan=True)


def formula(x: Any, y: Any, m: Any, k: Any, ufuncs: Any = np) -> list[Any]:
    """Something of everything: x, y change, m is a flight's, k is shared."""
    angle = m * x + 0.25 * k
    rows = ufuncs.sin(angle) * ufuncs.cos(angle) - y * y / (1.0 + k * k)
    polynomial = ((2.0 * x + k) * x - 0.5) * x + 3.0
    held = ufuncs.minimum(ufuncs.maximum(polynomial, -m), 2.0) * (y <= k)
    return [rows + held, ufuncs.sqrt(m * m + k) ** 3 - ufuncs.exp(-ufuncs.abs(y)), 1.5 * k, m / k]


def test_a_program_computes_what_was_recorded() -> None:
    """In one evaluation each: what is shared, what is a flight's, and the rest."""
    recorder = Recorder()
    x, y, m, k = recorder.inputs(4)
    graph = recorder.graph([formula(x, y, m, k)])
    levels = [MOMENT, MOMENT, FLIGHT, SHARED]
    program = Assembler(graph, levels, core().OPCODES).program([(0,)])
    rng = np.random.default_rng(3)
    xs, ys, ms = rng.standard_normal((3, 100))
    expected = np.stack([np.broadcast_to(row, 100) for row in formula(xs, ys, ms, 0.7)])
    scalars = scalars_of(program, np.array([0.7]))
    whole = np.concatenate([program.begin.code, program.entries[0].code])
    found = np.empty((4, 100))
    core().evaluate(
        whole,
        np.array(program.entries[0].outputs, dtype=np.uint16),
        program.places,
        scalars,
        np.stack([xs, ys, ms]),
        100,
        found,
        "",
    )
    assert np.allclose(found, expected, rtol=1e-15, atol=1e-15)


def test_no_instruction_reads_beyond_its_places() -> None:
    for bad in ([0, 9, 0, 0, 0, 0], [core().OPCODES["add_vv"], 3, NOWHERE, 8, 0, 0], [999] * 6):
        with pytest.raises(ValueError, match="instruction 0"):
            evaluated([bad], [3], np.zeros(1), np.zeros((1, 2)), "")
    with pytest.raises(ValueError, match="outputs: expected places below 8, got 8"):
        evaluated([], [8], np.zeros(1), np.zeros((1, 2)), "")
