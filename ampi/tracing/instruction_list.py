"""A traced function as lists of instructions for the interpreter in ampi/_native.

The interpreter computes many flights at once. A *place* holds one number of each of them, a *scalar* one
number of all. An instruction reads and writes places, and some of its operands may be scalars:

    operation, result, second result, operand, operand, operand          six numbers of 16 bits

What depends on scalars alone is computed when a program is made, what depends on numbers of a flight
alone when the flight begins, and the rest at each evaluation. Places are used again as soon as their
value has been read for the last time, so that all of them stay in the processor's first cache.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.tracing.instruction_selection import HORNER, SINCOS, Operation, selected
from ampi.tracing.value_graph import CONSTANT, INPUT, ValueGraph

Array = NDArray[np.float64]
SHARED, FLIGHT, MOMENT = range(3)  # what a value depends on at the most
NOWHERE = 0xFFFF
FILL = "fill"  # a place with a scalar


@dataclass(frozen=True, eq=False)
class InstructionList:
    """Instructions, and the places of the outputs when they are done."""

    code: NDArray[np.uint16]  # (m, 6)
    outputs: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Program:
    """Lists that share their places: first those of the inputs that change, then of a flight's inputs.

    A scalar that is an input or an operation of them is computed from `shared`, for which there is a
    list of its own.
    """

    shared: InstructionList  # from the inputs that are the same for all flights, then `constants`
    constants: tuple[float, ...]
    begin: InstructionList  # once per flight
    entries: tuple[InstructionList, ...]  # at each evaluation
    inputs: tuple[
        int, ...
    ]  # places of the inputs in order; of those that change, then of a flight's
    places: int
    scalars: int


class Assembler:
    """Programs of a graph; `levels` are those of its inputs, `opcodes` the interpreter's numbers."""

    def __init__(
        self, graph: ValueGraph, levels: Sequence[int], opcodes: Mapping[str, int]
    ) -> None:
        self.graph, self.opcodes = graph, opcodes
        self.levels = graph.levels(levels)
        inputs = {int(v.payload): k for k, v in enumerate(graph.values) if v.operation == INPUT}
        self.place: dict[int, int] = {}  # of values that keep theirs
        self.count = 0
        self._inputs = []
        for level in (MOMENT, FLIGHT):
            for k in (k for k, own in enumerate(levels) if own == level):
                self._inputs.append(self._new_place(inputs.get(k, -1 - k)))
        self._shared_inputs = [
            inputs.get(k, -1 - k) for k, own in enumerate(levels) if own == SHARED
        ]
        self.scalars: list[int] = []  # the value of each
        self._scalar: dict[tuple[int, ...], int] = {}
        self._filled: list[int] = []  # scalars that are wanted at a place
        self._kept: list[int] = []  # values of a flight that are wanted at each evaluation
        self._pairs: dict[
            int, tuple[int, int, int]
        ] = {}  # of an angle: sine, cosine, the angle then

    def program(self, entries: Sequence[Sequence[int]]) -> Program:
        """Each entry computes some outputs of the graph."""
        outputs = [[v for k in entry for v in self.graph.outputs[k]] for entry in entries]
        chosen = [self._operations(wanted, MOMENT) for wanted in outputs]
        for operations, wanted in zip(chosen, outputs, strict=True):
            self._keep(operations, wanted)
            self._remember(operations)
        begins = self._operations(self._kept, FLIGHT)
        self._keep(begins, ())
        base = self.count
        lists = [_Allocation(self, base) for _ in range(len(entries) + 1)]
        found = [
            a.assembled(operations, wanted)
            for a, operations, wanted in zip(
                lists, [begins, *chosen], [self._kept, *outputs], strict=True
            )
        ]
        fills = [
            (self.opcodes[FILL], self.place[v], NOWHERE, self.scalar((v,)), 0, 0)
            for v in self._filled
        ]
        begin = InstructionList(np.concatenate([coded(fills), found[0].code]), found[0].outputs)
        shared, constants = self._shared_list()
        return Program(
            shared,
            constants,
            begin,
            tuple(found[1:]),
            tuple(self._inputs),
            max(a.highest for a in lists),
            len(self.scalars),
        )

    def is_scalar(self, value: int) -> bool:
        """Whether a value is the same for all flights."""
        return self.levels[value] == SHARED

    def scalar(self, values: tuple[int, ...]) -> int:
        """Where scalars lie side by side: the first of them."""
        if values not in self._scalar:
            self._scalar[values] = len(self.scalars)
            self.scalars += values
        return self._scalar[values]

    def opcode(self, operation: Operation) -> int | None:
        """Of an operation with just these operands; None where all have to lie at places."""
        if operation.name == HORNER:
            return self.opcodes[HORNER]
        kinds = "".join("s" if self.is_scalar(k) else "v" for k in operation.operands)
        return self.opcodes.get(f"{operation.name}_{kinds}")

    def _new_place(self, value: int) -> int:
        self.place[value] = self.count
        self.count += 1
        return self.place[value]

    def _operations(self, wanted: Sequence[int], level: int) -> list[Operation]:
        def known(value: int) -> bool:
            return self.levels[value] < level or self.graph.values[value].operation == INPUT

        return selected(self.graph, wanted, known, self.is_scalar)

    def _keep(self, operations: list[Operation], wanted: Sequence[int]) -> None:
        """Places of what comes from before: numbers of a flight, and scalars that must lie at one."""
        made = {r for operation in operations for r in operation.results}
        read = set(wanted) | {k for one in operations for k in one.operands}
        apart = {k for one in operations if self.opcode(one) is None for k in one.operands}
        for value in sorted(read - made):
            if value in self.place:
                continue
            if not self.is_scalar(value):
                self._kept.append(value)
            elif value in apart or value in wanted:
                self._filled.append(value)
            else:
                continue
            self._new_place(value)

    def _remember(self, operations: list[Operation]) -> None:
        """Sines and cosines at each evaluation keep their places: an angle may be the one before."""
        for operation in operations:
            if operation.name != SINCOS:
                continue
            (angle,) = operation.operands
            if angle not in self._pairs:
                first, self.count = self.count, self.count + 3
                self._pairs[angle] = (first, first + 1, first + 2)
            for value, place in zip(operation.results, self._pairs[angle], strict=False):
                if value is not None:
                    self.place[value] = place

    def pair(self, operation: Operation) -> tuple[int, int, int] | None:
        """Where sine, cosine and the angle before lie, if this is a pair that is remembered."""
        return self._pairs.get(operation.operands[0]) if operation.name == SINCOS else None

    def _shared_list(self) -> tuple[InstructionList, tuple[float, ...]]:
        """Computes the scalars, all of them at places, from the shared inputs and the constants."""
        wanted = list(self.scalars)

        def known(value: int) -> bool:
            return self.graph.values[value].operation in (INPUT, CONSTANT)

        operations = selected(self.graph, wanted, known, lambda value: False)
        read = set(wanted) | {k for one in operations for k in one.operands}
        constants = [k for k in sorted(read) if self.graph.values[k].operation == CONSTANT]
        own = Assembler.__new__(Assembler)
        own.graph, own.opcodes, own.levels = self.graph, self.opcodes, [MOMENT] * len(self.levels)
        own._pairs = {}
        own.place = {v: k for k, v in enumerate([*self._shared_inputs, *constants])}
        found = _Allocation(own, len(own.place)).assembled(operations, wanted)
        return found, tuple(self.graph.values[k].payload for k in constants)


class _Allocation:
    """Gives places to the values of one list, again and again."""

    def __init__(self, assembler: Assembler, base: int) -> None:
        self._assembler, self.highest = assembler, base
        self._place: dict[int, int] = {}
        self._free: list[int] = []

    def assembled(self, operations: list[Operation], wanted: Sequence[int]) -> InstructionList:
        """The list of some operations, of whose results some are `wanted` in the end."""
        last = {k: i for i, one in enumerate(operations) for k in one.operands}
        last.update(dict.fromkeys(wanted, len(operations)))
        code: list[Sequence[int]] = []
        for i, operation in enumerate(operations):
            opcode, *operands = self._operands(operation)
            for value in {k for k in operation.operands if last[k] == i}:
                if value in self._place:
                    self._free.append(self._place[value])
            if (pair := self._assembler.pair(operation)) is not None:
                code.append((opcode, *pair[:2], operands[0], pair[2], 0))
                continue
            first, second = (*self._results(operation, last), NOWHERE)[:2]
            if operation.name == SINCOS:
                operands[1] = NOWHERE
            code.append((opcode, first, second, *operands))
        return InstructionList(coded(code), tuple(self._at(value) for value in wanted))

    def _operands(self, operation: Operation) -> tuple[int, int, int, int]:
        """Operation and where its operands lie."""
        own, opcode = self._assembler, self._assembler.opcode(operation)
        if operation.name == HORNER:
            x, *coefficients = operation.operands
            assert opcode is not None
            return opcode, self._at(x), own.scalar(tuple(coefficients)), len(coefficients)
        if opcode is None:
            opcode = own.opcodes[f"{operation.name}_{'v' * len(operation.operands)}"]
            places = [self._at(k) for k in operation.operands]
        else:
            places = [
                own.scalar((k,)) if own.is_scalar(k) else self._at(k) for k in operation.operands
            ]
        one, two, three = (*places, 0, 0)[:3]
        return opcode, one, two, three

    def _at(self, value: int) -> int:
        own = self._assembler.place
        return own[value] if value in own else self._place[value]

    def _results(self, operation: Operation, last: dict[int, int]) -> list[int]:
        """Where the results go; of a pair, the one that is not wanted goes to a place that is free."""
        places = [self._result(value) for value in operation.results]
        self._free += [
            place
            for value, place in zip(operation.results, places, strict=True)
            if value is None or (value not in last and value in self._place)
        ]
        return places

    def _result(self, value: int | None) -> int:
        if value in self._assembler.place:
            return self._assembler.place[value]
        if not self._free:
            self._free.append(self.highest)
            self.highest += 1
        place = self._free.pop()
        if value is not None:
            self._place[value] = place
        return place


def coded(instructions: Sequence[Sequence[int]]) -> NDArray[np.uint16]:
    """As the interpreter reads them, (m, 6)."""
    return np.array(instructions, dtype=np.uint16).reshape(-1, 6)
