"""A traced function as JavaScript: the same operations in the same order, for a page.

What the browser's Math computes may differ from numpy in the last bit; all else is IEEE arithmetic.
"""

from __future__ import annotations

from collections.abc import Iterable

from ampi.tracing.value_graph import CONSTANT, INPUT, Value, ValueGraph

_INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
_COMPARED = {"lt": "<", "le": "<=", "eq": "===", "ne": "!=="}
_LITERALS = {"inf": "Infinity", "-inf": "-Infinity", "nan": "NaN"}


def javascript(graph: ValueGraph, name: str, outputs: Iterable[int]) -> str:
    """A function `name(i, o)` of a graph.

    Parameters
    ----------
    graph
        Of `ampi.tracing.value_graph.Recorder`.
    name
        Of the function.
    outputs
        Which outputs of the graph are written to `o`, one behind the other; `i` holds all inputs.
    """
    wanted = [number for output in outputs for number in graph.outputs[output]]
    lines = [
        f"const v{number} = {_expression(graph.values, number)};"
        for number in _needed(graph.values, wanted)
        if graph.values[number].operation not in (INPUT, CONSTANT)
    ]
    lines += [f"o[{k}] = {_operand(graph.values, number)};" for k, number in enumerate(wanted)]
    return "\n".join([f"function {name}(i, o) {{", *lines, "}"]) + "\n"


def _needed(values: tuple[Value, ...], wanted: list[int]) -> list[int]:
    """The values on which the wanted ones depend, in order."""
    found, left = set[int](), list(wanted)
    while left:
        number = left.pop()
        if number not in found:
            found.add(number)
            left += values[number].operands
    return sorted(found)


def _operand(values: tuple[Value, ...], number: int) -> str:
    value = values[number]
    if value.operation == INPUT:
        return f"i[{int(value.payload)}]"
    if value.operation == CONSTANT:
        text = repr(value.payload)
        return _LITERALS.get(text, f"({text})" if text.startswith("-") else text)
    return f"v{number}"


def _expression(values: tuple[Value, ...], number: int) -> str:
    operation = values[number].operation
    operands = [_operand(values, k) for k in values[number].operands]
    if operation in _INFIX:
        return f" {_INFIX[operation]} ".join(operands)
    if operation in _COMPARED:
        return f"{operands[0]} {_COMPARED[operation]} {operands[1]} ? 1 : 0"
    if operation == "neg":
        return f"-{operands[0]}"
    return f"Math.{operation}({', '.join(operands)})"
