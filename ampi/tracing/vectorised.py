"""A traced function evaluated at many points by numpy, one ufunc call an operation.

CasADi's virtual machine takes the points one after the other, at some nanoseconds an operation. Here the
same instructions run over all points at once: below a few hundred points the calls cost more than they
save, at a thousand it is three times as fast. There is no compile step, and a point's values do not
depend on its company.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_BINARY: dict[int, Any] = {
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power,
    ca.OP_LT: np.less,
    ca.OP_LE: np.less_equal,
    ca.OP_EQ: np.equal,
    ca.OP_NE: np.not_equal,
    ca.OP_FMIN: np.minimum,
    ca.OP_FMAX: np.maximum,
    ca.OP_ATAN2: np.arctan2,
    ca.OP_IF_ELSE_ZERO: np.multiply,
}
_UNARY: dict[int, Any] = {
    ca.OP_NEG: np.negative,
    ca.OP_EXP: np.exp,
    ca.OP_LOG: np.log,
    ca.OP_SQRT: np.sqrt,
    ca.OP_SQ: np.square,
    ca.OP_INV: np.reciprocal,
    ca.OP_SIN: np.sin,
    ca.OP_COS: np.cos,
    ca.OP_TAN: np.tan,
    ca.OP_ASIN: np.arcsin,
    ca.OP_ACOS: np.arccos,
    ca.OP_ATAN: np.arctan,
    ca.OP_TANH: np.tanh,
    ca.OP_FABS: np.abs,
    ca.OP_SIGN: np.sign,
    ca.OP_FLOOR: np.floor,
    ca.OP_NOT: np.logical_not,
}

_BINARY_APPLY, _UNARY_APPLY, _CONSTANT, _INPUT, _OUTPUT = range(5)  # kinds of instruction


class VectorisedFunction:
    """An SX function of dense columns; its outputs may be sparse.

    Raises
    ------
    NotImplementedError
        At construction, if the expression holds an operation without a ufunc here.
    """

    def __init__(self, inputs: list[ca.SX], outputs: list[ca.SX]) -> None:
        function = ca.Function("vectorised", inputs, outputs, {"cse": True})
        self.nonzeros = [
            tuple(zip(*function.sparsity_out(k).get_triplet(), strict=True))
            for k in range(function.n_out())
        ]  # (row, column) of every row of an output
        self._slots = function.sz_w()
        self._program = [self._step(function, k) for k in range(function.n_instructions())]

    def _step(self, function: ca.Function, k: int) -> tuple[int, Any, tuple[int, ...], int]:
        """(kind, payload, operands, result) of an instruction."""
        operation = function.instruction_id(k)
        read, written = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_CONST:
            return _CONSTANT, function.instruction_constant(k), (), written[0]
        if operation == ca.OP_INPUT:
            return _INPUT, None, tuple(read), written[0]
        if operation == ca.OP_OUTPUT:
            return _OUTPUT, None, tuple(written), read[0]
        if operation == ca.OP_TWICE:
            return _BINARY_APPLY, np.add, (read[0], read[0]), written[0]
        if operation in _BINARY:
            return _BINARY_APPLY, _BINARY[operation], tuple(read), written[0]
        if operation in _UNARY:
            return _UNARY_APPLY, _UNARY[operation], (read[0],), written[0]
        raise NotImplementedError(f"no ufunc for CasADi's operation {operation}")

    def __call__(self, *inputs: Array) -> list[Array]:
        """Outputs (nonzeros, points) at inputs (components, points)."""
        points = inputs[0].shape[1]
        room = list(np.empty((self._slots, points)))  # a view of every row, made once
        outputs = [np.empty((len(rows), points)) for rows in self.nonzeros]
        value: list[Any] = [None] * self._slots
        for kind, payload, operands, slot in self._program:
            if kind == _BINARY_APPLY:
                left, right = operands
                value[slot] = payload(value[left], value[right], out=room[slot])
            elif kind == _UNARY_APPLY:
                value[slot] = payload(value[operands[0]], out=room[slot])
            elif kind == _CONSTANT:
                value[slot] = payload
            elif kind == _INPUT:
                value[slot] = inputs[operands[0]][operands[1]]
            else:
                outputs[operands[0]][operands[1]] = value[slot]
        return outputs
