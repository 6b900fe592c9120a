"""f, g and their exact derivatives at every node of every case, from the one source in ampi/physics.

The equations are run on CasADi's symbols once for each structure of a mission; its numbers are arguments
(numbers). All arrays have an axis of cases and one of points,

    x (7, c, n),   û, t (c, n),   weights (m, c, n)   →   outputs (nonzeros, c, n),                 (1)

with x (8, c, n) and û (2, c, n) where the angle of attack is a state, in scaled variables. Nothing of
a case depends on its company.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ampi.physics.equations_of_motion import FlightModel, equations_of_motion
from ampi.physics.state import BANK, LONGITUDE
from ampi.tracing.node_functions import NodeFunctions
from ampi.tracing.numbers import NUMBER, Numbers, put_together, taken_apart
from ampi.tracing.vectorised import VectorisedFunction
from ampi.tracing.virtual_machine import MappedFunction

Array = NDArray[np.float64]
Entries = dict[tuple[int, int], Array]  # a sparse matrix at every point: (row, column) → (c, n)


@dataclass(frozen=True, eq=False)
class Traced:
    """The physics as expressions of scaled states (7 or 8), controls û, time (s) and numbers."""

    x: ca.SX
    u: ca.SX
    t: ca.SX
    p: ca.SX
    f: ca.SX  # as many as states
    g: ca.SX  # limits, then integrands
    jacobian: ca.SX  # ∂f/∂x
    terminal: ca.SX | None  # m(x_f)

    @property
    def n_states(self) -> int:
        """How many; the column of t among derivatives over (x, t)."""
        return int(self.x.numel())


@dataclass(frozen=True)
class Physics:
    """What is traced, and the numbers that go into it."""

    structure: Hashable
    numbers: Numbers

    @classmethod
    def of(cls, model: FlightModel, functions: NodeFunctions, rate_scale: Any) -> Physics:
        """Of a mission or a family; `rate_scale` is the bank rate (rad/s) of û = 1.

        Where the angle of attack is a state, it is the pair of both rates.
        """
        return cls(*taken_apart((model, functions, rate_scale)))


def trace(structure: Hashable, state_scale: tuple[float, ...]) -> Traced:
    """Run the physics on symbols."""
    n_states = len(state_scale)
    x, u, t = ca.SX.sym("x", n_states), ca.SX.sym("u", n_states - BANK), ca.SX.sym("t")
    p = ca.SX.sym("p", _count(structure))
    model, functions, rate_scale = put_together(structure, iter(ca.vertsplit(p)))
    scale = ca.DM(list(state_scale))
    physical = x * scale
    previous_mode = ca.GlobalOptions.getNumpyMode()
    ca.GlobalOptions.setNumpyMode(-1)
    try:
        if n_states != model.n_states:
            raise ValueError(
                f"state_scale: expected {model.n_states} scales, one for a state, got {n_states}"
            )
        scales = rate_scale if isinstance(rate_scale, tuple) else (rate_scale,)
        bank_rate, *others = (u[k] * one for k, one in enumerate(scales))
        more = {"angle_of_attack_rate": others[0]} if others else {}
        rates = equations_of_motion(model, physical, bank_rate, t, **more)
        limited = functions.path(model, physical, t)
        integrands = functions.integrands(model, physical, t)
        own = functions.terminal
        terminal = None if own is None else own.value(model, ca.vertsplit(physical))
    finally:
        ca.GlobalOptions.setNumpyMode(previous_mode)
    f = ca.vertcat(*rates) / scale
    jacobian = ca.jacobian(f, x)
    _require_quadratures(jacobian)
    return Traced(x, u, t, p, f, ca.vertcat(*limited, *integrands), jacobian, terminal)


def _count(structure: Hashable) -> int:
    """How many numbers a structure has."""
    counted: list[int] = []

    def symbols() -> Any:
        while True:
            counted.append(1)
            yield NUMBER

    put_together(structure, symbols())
    return len(counted)


def _require_quadratures(jacobian: ca.SX) -> None:
    """Condensing relies on it: no state enters a control's rate, no rate knows the longitude."""
    rows, columns = jacobian.sparsity().get_triplet()
    if max(rows) >= BANK or LONGITUDE in columns:
        raise ValueError(
            "equations of motion: expected rates of the controls without states and rates without the "
            "longitude; the condensing of the dynamics takes both as quadratures"
        )


class NodeFunction:
    """One traced function, evaluated at the points of many cases as in Eq. (1).

    `nonzeros` are (row, column) of the rows of each output. Many points are computed operation by
    operation in numpy, the nodes of one case one after the other in CasADi's virtual machine: the last
    bits of the two differ, so a caller chooses one of them once, and not by the number of its cases.
    """

    def __init__(self, inputs: list[ca.SX], outputs: list[ca.SX]) -> None:
        self.function = ca.Function("nodes", inputs, outputs, {"cse": True})
        self.nonzeros = [
            tuple(zip(*self.function.sparsity_out(k).get_triplet(), strict=True))
            for k in range(self.function.n_out())
        ]

    @cached_property
    def _vectorised(self) -> VectorisedFunction:
        return VectorisedFunction(self.function)

    @lru_cache(maxsize=8)  # noqa: B019 - lives as long as the trace, which is cached itself
    def _mapped(self, n_nodes: int) -> MappedFunction:
        return MappedFunction(self.function, n_nodes)

    def together(
        self, x: Array, u: Array, t: Array, numbers: Numbers, *weights: Array
    ) -> list[Array]:
        """All cases at once."""
        shape, rates = t.shape, u if u.ndim == 3 else u[None]
        repeated = [np.repeat(n, shape[1]) if isinstance(n, np.ndarray) else n for n in numbers]
        columns = [a.reshape(len(a), -1) for a in weights]
        found = self._vectorised(
            x.reshape(len(x), -1),
            rates.reshape(len(rates), -1),
            t.reshape(1, -1),
            repeated,
            *columns,
        )
        return [rows.reshape(-1, *shape) for rows in found]

    def one_by_one(
        self, x: Array, u: Array, t: Array, numbers: Numbers, *weights: Array
    ) -> list[Array]:
        """Case by case."""
        mapped, controls = self._mapped(t.shape[1]), u if u.ndim == 3 else u[None]
        found = []
        for k in range(len(t)):
            own = np.array([n[k] if isinstance(n, np.ndarray) else n for n in numbers])
            outputs = mapped(x[:, k].T, controls[:, k].T, t[k], own, *(a[:, k].T for a in weights))
            found.append(
                [rows.T for rows in outputs] if len(t) == 1 else [r.T.copy() for r in outputs]
            )
        return [np.stack(parts, axis=1) for parts in zip(*found, strict=True)]


class NodeDynamics:
    """The functions of one structure, each made when it is first asked for."""

    def __init__(self, structure: Hashable, state_scale: tuple[float, ...]) -> None:
        self.traced = trace(structure, state_scale)
        self._inputs = [self.traced.x, self.traced.u, self.traced.t, self.traced.p]

    @cached_property
    def values(self) -> NodeFunction:
        """f, and g with the integrands (m + k,)."""
        return NodeFunction(self._inputs, [ca.densify(self.traced.f), ca.densify(self.traced.g)])

    @cached_property
    def jacobian(self) -> NodeFunction:
        """∂f/∂x alone."""
        return NodeFunction(self._inputs, [self.traced.jacobian])

    @cached_property
    def first(self) -> NodeFunction:
        """f, ∂f/∂x, ∂f/∂t, (g, L), ∂(g, L)/∂(x, t)."""
        f, g, x, t = self.traced.f, self.traced.g, self.traced.x, self.traced.t
        over_xt = ca.jacobian(g, ca.vertcat(x, t))
        outputs = [ca.densify(f), self.traced.jacobian, ca.jacobian(f, t), ca.densify(g), over_xt]
        return NodeFunction(self._inputs, outputs)

    @cached_property
    def terminal(self) -> NodeFunction | None:
        """m, ∂m/∂x and ∂²m/∂x², dense; None where the objective has no such term."""
        if self.traced.terminal is None:
            return None
        hessian, gradient = ca.hessian(self.traced.terminal, self.traced.x)
        outputs = [self.traced.terminal, ca.densify(gradient), ca.densify(hessian)]
        return NodeFunction(self._inputs, outputs)

    @cached_property
    def second(self) -> NodeFunction:
        """∂²(μᵀf + νᵀ(g, L))/∂(x, t)², with μ as f, ν (m + k,)."""
        mu, nu = ca.SX.sym("mu", self.traced.n_states), ca.SX.sym("nu", self.traced.g.numel())
        weighted = ca.dot(mu, self.traced.f) + ca.dot(nu, self.traced.g)
        hessian = ca.hessian(weighted, ca.vertcat(self.traced.x, self.traced.t))[0]
        return NodeFunction([*self._inputs, mu, nu], [hessian])


@lru_cache(maxsize=32)
def node_dynamics(structure: Hashable, state_scale: tuple[float, ...]) -> NodeDynamics:
    """Traced once per process and structure."""
    return NodeDynamics(structure, state_scale)


def entries(nonzeros: tuple[tuple[int, int], ...], rows: Array) -> Entries:
    """An output by its place in the matrix."""
    return dict(zip(nonzeros, rows, strict=True))
