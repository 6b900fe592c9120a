"""Which instructions compute some values of a graph: pairs and chains of operations become one.

    sin x, cos x   → sincos          share the reduction to a quadrant
    a b + c        → mul_add         also a b − c and c − a b; each operation is still rounded
    ((c₀ x + c₁) x + …)  → horner    a polynomial with coefficients that are the same at all points

No bit changes by it. A value that is the same at all points is a *scalar*, read from one place.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from ampi.tracing.value_graph import ValueGraph

COMMUTATIVE = frozenset({"add", "mul", "min", "max", "eq", "ne"})
SINCOS, HORNER = "sincos", "horner"
SHORT = 3  # x and two coefficients: a mul_add
IsScalar = Callable[[int], bool]


@dataclass(frozen=True)
class Operation:
    """Computes the values `results` (None: not wanted) from the values `operands`."""

    name: str
    operands: tuple[int, ...]
    results: tuple[int | None, ...]


def selected(
    graph: ValueGraph, wanted: Sequence[int], known: Callable[[int], bool], is_scalar: IsScalar
) -> list[Operation]:
    """Operations, in order, that compute `wanted` from the values that are `known`."""
    needed = _needed(graph, wanted, known)
    uses = Counter(k for i in needed for k in graph.values[i].operands)
    uses.update(wanted)
    single = frozenset(k for k, count in uses.items() if count == 1) & needed
    operations = _fused(graph, sorted(needed), single, is_scalar)
    return _chained(_paired(operations), single, is_scalar)


def _needed(
    graph: ValueGraph, wanted: Iterable[int], known: Callable[[int], bool]
) -> frozenset[int]:
    found: set[int] = set()
    open_ = list(wanted)
    while open_:
        value = open_.pop()
        if value not in found and not known(value):
            found.add(value)
            open_ += graph.values[value].operands
    return frozenset(found)


def _fused(
    graph: ValueGraph, needed: Sequence[int], single: frozenset[int], is_scalar: IsScalar
) -> list[Operation]:
    """One operation a value, but for products that are added to something and not wanted elsewhere."""
    values, gone, found = graph.values, set[int](), list[Operation]()

    def product(k: int) -> tuple[int, ...] | None:
        return values[k].operands if k in single and values[k].operation == "mul" else None

    for i in needed:
        name, operands, _ = values[i]
        if name in ("add", "sub"):
            left, right = operands
            if (factors := product(left)) is not None:
                gone.add(left)
                name = "mul_add" if name == "add" else "mul_sub"
                operands = (*_scalar_last(factors, is_scalar), right)
            elif (factors := product(right)) is not None:
                gone.add(right)
                name = "mul_add" if name == "add" else "sub_mul"
                operands = (*_scalar_last(factors, is_scalar), left)
        if name in COMMUTATIVE:
            operands = _scalar_last(operands, is_scalar)
        found.append(Operation(name, operands, (i,)))
    return [operation for operation in found if operation.results[0] not in gone]


def _scalar_last(operands: tuple[int, ...], is_scalar: IsScalar) -> tuple[int, ...]:
    return tuple(sorted(operands, key=is_scalar))


def _paired(operations: list[Operation]) -> list[Operation]:
    """Sine and cosine of the same angle in one, where the first of them stands."""
    places: dict[int, int] = {}
    found: list[Operation] = []
    for operation in operations:
        if operation.name not in ("sin", "cos"):
            found.append(operation)
            continue
        (angle,), (result,) = operation.operands, operation.results
        own = (result, None) if operation.name == "sin" else (None, result)
        if angle in places:
            sine, cosine = found[places[angle]].results
            both = (own[0] if sine is None else sine, own[1] if cosine is None else cosine)
            found[places[angle]] = replace(found[places[angle]], results=both)
        else:
            places[angle] = len(found)
            found.append(Operation(SINCOS, operation.operands, own))
    return found


def _chained(
    operations: list[Operation], single: frozenset[int], is_scalar: IsScalar
) -> list[Operation]:
    """Polynomials: x first, then their coefficients, the highest power's first."""
    chains: dict[int | None, Operation] = {}
    for operation in operations:
        if operation.name != "mul_add":
            continue
        (one, other, last), result = operation.operands, operation.results
        if is_scalar(one) or not is_scalar(last):
            continue
        if is_scalar(other):
            chains[result[0]] = Operation(HORNER, (one, other, last), result)
            continue
        for before, x in ((one, other), (other, one)):
            chain = chains.get(before)
            if chain is not None and before in single and chain.operands[0] == x:
                chains[result[0]] = Operation(HORNER, (*chain.operands, last), result)
                del chains[before]
                break
    chains = {k: one for k, one in chains.items() if len(one.operands) > SHORT}
    within = {r for one in chains.values() for r in _links(one, operations)}
    return [
        chains.get(operation.results[0], operation)
        for operation in operations
        if operation.results[0] not in within
    ]


def _links(chain: Operation, operations: list[Operation]) -> Iterable[int | None]:
    """Results within a chain, which nobody else wants."""
    by_result = {operation.results[0]: operation for operation in operations}
    at, count = chain.results[0], len(chain.operands) - 3
    for _ in range(count):
        one, other, _ = by_result[at].operands
        at = other if one == chain.operands[0] else one
        yield at
