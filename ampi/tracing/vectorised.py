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

# kinds of instruction; SHARED ones have no point of their own among their operands
_BINARY_APPLY, _UNARY_APPLY, _CONSTANT, _INPUT, _OUTPUT, _SHARED_BINARY, _SHARED_UNARY = range(7)
Step = tuple[int, Any, tuple[int, ...], int]  # kind, payload, operands, result


class VectorisedFunction:
    """An SX function of dense columns; its outputs may be sparse.

    Raises
    ------
    NotImplementedError
        At construction, if the expression holds an operation without a ufunc here.
    """

    def __init__(self, function: ca.Function) -> None:
        self._nonzeros = [function.nnz_out(k) for k in range(function.n_out())]
        self._slots = function.sz_w()
        self._steps = [self._step(function, k) for k in range(function.n_instructions())]
        self._programs: dict[frozenset[tuple[int, int]], list[Step]] = {}

    def _step(self, function: ca.Function, k: int) -> Step:
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

    def _program(self, shared: frozenset[tuple[int, int]]) -> list[Step]:
        """The steps where the inputs `shared` (input, component) are one number for all points.

        What depends on those alone is computed once, and not at every point.
        """
        if shared not in self._programs:
            alike: set[int] = set()  # slots that hold one number at this place of the program
            program = []
            for kind, payload, operands, slot in self._steps:
                if kind == _OUTPUT:
                    program.append((kind, payload, operands, slot))
                    continue
                one = kind == _CONSTANT or (kind == _INPUT and operands in shared)
                if kind in (_BINARY_APPLY, _UNARY_APPLY) and alike.issuperset(operands):
                    one = True
                    kind = _SHARED_BINARY if kind == _BINARY_APPLY else _SHARED_UNARY
                (alike.add if one else alike.discard)(slot)
                program.append((kind, payload, operands, slot))
            self._programs[shared] = program
        return self._programs[shared]

    def __call__(self, *inputs: Array | list[Any]) -> list[Array]:
        """Outputs (nonzeros, points) at inputs (components, points).

        A component of an input that is given as a list may be one number for all points.
        """
        assert isinstance(inputs[0], np.ndarray)
        points = inputs[0].shape[1]
        shared = frozenset(
            (k, i)
            for k, given in enumerate(inputs)
            if isinstance(given, list)
            for i, row in enumerate(given)
            if not isinstance(row, np.ndarray)
        )
        room = list(np.empty((self._slots, points)))  # a view of every row, made once
        outputs = [np.empty((count, points)) for count in self._nonzeros]
        value: list[Any] = [None] * self._slots
        for kind, payload, operands, slot in self._program(shared):
            if kind == _BINARY_APPLY:
                left, right = operands
                value[slot] = payload(value[left], value[right], out=room[slot])
            elif kind == _UNARY_APPLY:
                value[slot] = payload(value[operands[0]], out=room[slot])
            elif kind == _CONSTANT:
                value[slot] = payload
            elif kind == _INPUT:
                value[slot] = inputs[operands[0]][operands[1]]
            elif kind == _OUTPUT:
                outputs[operands[0]][operands[1]] = value[slot]
            elif kind == _SHARED_BINARY:
                # of a comparison too: in a row of `room` it would be a number
                value[slot] = float(payload(value[operands[0]], value[operands[1]]))
            else:
                value[slot] = float(payload(value[operands[0]]))
        return outputs
