"""Functions in numpy's ufuncs recorded as a graph of values: every operation once, none of them changed.

The physics is run on `Symbol`s, which record what numpy is asked for. CasADi's trace (dynamics) has
derivatives, but simplifies; here each operation is the one that numpy performs on arrays, in its order,
so that an engine that performs them again comes to the same bits.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

INPUT, CONSTANT = "input", "constant"

_NAMES: dict[Any, str] = {
    np.add: "add",
    np.subtract: "sub",
    np.multiply: "mul",
    np.divide: "div",
    np.power: "pow",
    np.less: "lt",
    np.less_equal: "le",
    np.equal: "eq",
    np.not_equal: "ne",
    np.minimum: "min",
    np.maximum: "max",
    np.arctan2: "atan2",
    np.negative: "neg",
    np.absolute: "abs",
    np.sqrt: "sqrt",
    np.sign: "sign",
    np.floor: "floor",
    np.exp: "exp",
    np.log: "log",
    np.sin: "sin",
    np.cos: "cos",
    np.tan: "tan",
    np.arcsin: "asin",
    np.arccos: "acos",
    np.arctan: "atan",
    np.tanh: "tanh",
}
_TURNED = {np.greater: np.less, np.greater_equal: np.less_equal}  # a > b as b < a


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

    def levels(self, of_inputs: Sequence[int]) -> list[int]:
        """The highest level of what each value depends on; those of the inputs are given."""
        found: list[int] = []
        for value in self.values:
            if value.operation == INPUT:
                found.append(of_inputs[int(value.payload)])
            else:
                found.append(max((found[k] for k in value.operands), default=0))
        return found


class Recorder:
    """Makes the symbols of a graph, and numbers its values."""

    def __init__(self) -> None:
        self._numbers: dict[Value, int] = {}
        self._inputs = 0

    def inputs(self, count: int) -> list[Symbol]:
        """The next inputs."""
        self._inputs += count
        return [
            self.applied(INPUT, (), float(k)) for k in range(self._inputs - count, self._inputs)
        ]

    def applied(self, operation: str, operands: tuple[int, ...], payload: float = 0.0) -> Symbol:
        """The value of an operation, which is recorded once."""
        value = Value(operation, operands, payload)
        return Symbol(self, self._numbers.setdefault(value, len(self._numbers)))

    def number(self, value: Any) -> int:
        """Of a symbol, or of a constant."""
        if isinstance(value, Symbol):
            return value.number
        return self.applied(CONSTANT, (), float(value)).number

    def graph(self, outputs: Iterable[Iterable[Any]]) -> ValueGraph:
        """All that was recorded; outputs are symbols or numbers."""
        rows = tuple(tuple(self.number(value) for value in output) for output in outputs)
        return ValueGraph(tuple(self._numbers), rows)


class Symbol(np.lib.mixins.NDArrayOperatorsMixin):
    """Stands for an array in a function of ufuncs and operators."""

    def __init__(self, recorder: Recorder, number: int) -> None:
        self.recorder, self.number = recorder, number

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Symbol:
        """Records it.

        Raises
        ------
        NotImplementedError
            Of a ufunc that is not among those above, or one that writes to another array.
        """
        in_place = options == {"out": inputs[:1]}  # `a *= b` gives the name to a new value
        if method != "__call__" or not (in_place or not options):
            raise NotImplementedError(f"no trace of {ufunc.__name__}.{method} with {options}")
        if ufunc in _TURNED:
            ufunc, inputs = _TURNED[ufunc], inputs[::-1]
        if ufunc is np.power and isinstance(inputs[1], int | float):
            return self._power(*inputs)
        if ufunc is np.square:
            ufunc, inputs = np.multiply, inputs * 2
        if ufunc not in _NAMES:
            raise NotImplementedError(f"no trace of numpy's {ufunc.__name__}")
        operands = tuple(self.recorder.number(value) for value in inputs)
        return self.recorder.applied(_NAMES[ufunc], operands)

    def _power(self, base: Symbol, exponent: float) -> Symbol:
        """x**k of a number k: what numpy does for some k is no power."""
        own = self.recorder
        if exponent == 0.0:
            return own.applied(CONSTANT, (), 1.0)
        if exponent == 1.0:
            return base
        if exponent == 2.0:
            return own.applied("mul", (base.number, base.number))
        if exponent == 0.5:
            return own.applied("sqrt", (base.number,))
        if exponent == -1.0:
            return own.applied("div", (own.number(1.0), base.number))
        return own.applied("pow", (base.number, own.number(exponent)))
