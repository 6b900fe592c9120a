"""A traced function as a graph of values: each operation once, in the order of its computation.

CasADi's instructions work on a few places that are written again and again. Here every result has a
number of its own, so that what depends on what can be asked: what is the same for all points is computed
once, and the rest is given places anew (instruction_list).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

INPUT, CONSTANT = "input", "constant"

_BINARY = {
    ca.OP_ADD: "add",
    ca.OP_SUB: "sub",
    ca.OP_MUL: "mul",
    ca.OP_DIV: "div",
    ca.OP_POW: "pow",
    ca.OP_CONSTPOW: "pow",
    ca.OP_LT: "lt",
    ca.OP_LE: "le",
    ca.OP_EQ: "eq",
    ca.OP_NE: "ne",
    ca.OP_FMIN: "min",
    ca.OP_FMAX: "max",
    ca.OP_ATAN2: "atan2",
    ca.OP_IF_ELSE_ZERO: "mul",  # as the numpy that was traced has it
}
_UNARY = {
    ca.OP_NEG: "neg",
    ca.OP_EXP: "exp",
    ca.OP_LOG: "log",
    ca.OP_SQRT: "sqrt",
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
    ca.OP_TAN: "tan",
    ca.OP_ASIN: "asin",
    ca.OP_ACOS: "acos",
    ca.OP_ATAN: "atan",
    ca.OP_TANH: "tanh",
    ca.OP_FABS: "abs",
    ca.OP_SIGN: "sign",
    ca.OP_FLOOR: "floor",
    ca.OP_NOT: "not",
}


class Value(NamedTuple):
    """One value: an operation of earlier values, an input or a constant."""

    operation: str
    operands: tuple[int, ...] = ()
    payload: float = 0.0  # of a constant; of an input its place among all inputs


@dataclass(frozen=True)
class ValueGraph:
    """Values in order, and those that are the outputs, output after output."""

    values: tuple[Value, ...]
    outputs: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]) -> ValueGraph:
        """Of the dense columns `outputs` as functions of the columns `inputs`.

        Raises
        ------
        NotImplementedError
            If they hold an operation that is not among those above.
        """
        dense = [ca.densify(output) for output in outputs]
        return _Reader(ca.Function("values", list(inputs), dense, {"cse": True})).graph()

    def levels(self, of_inputs: Sequence[int]) -> list[int]:
        """The highest level of what each value depends on; those of the inputs are given."""
        found: list[int] = []
        for value in self.values:
            if value.operation == INPUT:
                found.append(of_inputs[int(value.payload)])
            else:
                found.append(max((found[k] for k in value.operands), default=0))
        return found


class _Reader:
    """Follows the instructions of a function."""

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        self._first = [0]
        for k in range(function.n_in()):
            self._first.append(self._first[-1] + function.nnz_in(k))
        self._numbers: dict[Value, int] = {}

    def _number(self, operation: str, operands: tuple[int, ...] = (), payload: float = 0.0) -> int:
        value = Value(operation, operands, payload)
        return self._numbers.setdefault(value, len(self._numbers))

    def graph(self) -> ValueGraph:
        """All of it."""
        function, held = self._function, {}
        outputs = [[0] * function.nnz_out(k) for k in range(function.n_out())]
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            read, written = function.instruction_input(k), function.instruction_output(k)
            if operation == ca.OP_OUTPUT:
                outputs[written[0]][written[1]] = held[read[0]]
            elif operation == ca.OP_INPUT:
                held[written[0]] = self._number(INPUT, (), self._first[read[0]] + read[1])
            elif operation == ca.OP_CONST:
                constant = function.instruction_constant(k)
                held[written[0]] = self._number(CONSTANT, (), constant)
            else:
                held[written[0]] = self._applied(operation, tuple(held[slot] for slot in read))
        return ValueGraph(tuple(self._numbers), tuple(tuple(output) for output in outputs))

    def _applied(self, operation: int, operands: tuple[int, ...]) -> int:
        one = operands[:1]
        if operation == ca.OP_SQ:
            return self._number("mul", one * 2)
        if operation == ca.OP_TWICE:
            return self._number("add", one * 2)
        if operation == ca.OP_INV:
            return self._number("div", (self._number(CONSTANT, (), 1.0), *one))
        if operation in _BINARY:
            return self._number(_BINARY[operation], operands[:2])
        if operation in _UNARY:
            return self._number(_UNARY[operation], one)
        raise NotImplementedError(f"no operation of ours for CasADi's operation {operation}")
