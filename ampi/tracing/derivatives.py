"""Exact derivatives of the physics at every node, by CasADi, from the one source in ampi/physics.

The traced expression graph is evaluated in CasADi's virtual machine: there is no compile step. One
call evaluates all nodes, reading and writing numpy memory directly.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ampi.physics.equations_of_motion import FlightModel, equations_of_motion
from ampi.physics.state import BANK, LONGITUDE
from ampi.tracing.node_functions import NodeFunctions

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NodeDerivatives:
    """At every node, in scaled variables: f, g, L and their derivatives; n nodes, m limits."""

    rates: Array  # (n, 7)
    state_jacobian: Array  # (n, 7, 7), ∂f/∂x
    time_derivative: Array  # (n, 7), ∂f/∂t
    path: Array  # (n, m), g over its limit
    path_jacobian: Array  # (n, m, 8), ∂g/∂(x, t)
    integrand: Array  # (n, k), L of the objective
    integrand_jacobian: Array  # (n, k, 8), ∂L/∂(x, t)


@dataclass(frozen=True, eq=False)
class Traced:
    """The physics as expressions of scaled states (7), control û and time (s)."""

    x: ca.SX
    u: ca.SX
    t: ca.SX
    f: ca.SX  # (7,)
    g: ca.SX  # (n_limits + k,): limits, then integrands
    n_limits: int
    jacobian: ca.SX  # ∂f/∂x


def trace(
    model: FlightModel,
    functions: NodeFunctions,
    state_scale: tuple[float, ...],
    rate_scale: float,
) -> Traced:
    """Run the physics on symbols."""
    x, u, t = ca.SX.sym("x", 7), ca.SX.sym("u"), ca.SX.sym("t")
    scale = ca.DM(list(state_scale))
    physical = x * scale
    previous_mode = ca.GlobalOptions.getNumpyMode()
    ca.GlobalOptions.setNumpyMode(-1)
    try:
        rates = equations_of_motion(model, physical, u * rate_scale, t)
        limited = functions.path(model, physical, t)
        integrands = functions.integrands(model, physical, t)
    finally:
        ca.GlobalOptions.setNumpyMode(previous_mode)
    f = ca.vertcat(*rates) / scale
    jacobian = ca.jacobian(f, x)
    _require_quadratures(jacobian)
    return Traced(x, u, t, f, ca.vertcat(*limited, *integrands), len(limited), jacobian)


class ScaledDynamics:
    """f, g, L and derivatives of scaled states on n nodes, evaluated in one call each.

    The output arrays are overwritten by the next call of the same kind.
    """

    def __init__(
        self,
        model: FlightModel,
        functions: NodeFunctions,
        state_scale: tuple[float, ...],
        rate_scale: float,
        n_nodes: int,
    ) -> None:
        traced = trace(model, functions, state_scale, rate_scale)
        x, u, t, f, g = traced.x, traced.u, traced.t, traced.f, traced.g
        self.n_limits, jacobian = traced.n_limits, traced.jacobian
        mu, nu = ca.SX.sym("mu", 7), ca.SX.sym("nu", g.numel())
        xt = ca.vertcat(x, t)
        hessian = ca.hessian(ca.dot(mu, f) + ca.dot(nu, g), xt)[0]

        def batch(inputs: list[ca.SX], outputs: list[ca.SX]) -> _Buffered:
            dense = [ca.densify(out) for out in outputs]
            function = ca.Function(
                "nodes", inputs, dense, {"cse": True}
            )  # a quarter fewer operations
            return _Buffered(function.map(n_nodes), n_nodes)

        self._first = batch([x, u, t], [f, jacobian, ca.jacobian(f, t), g, ca.jacobian(g, xt)])
        self._values = batch([x, u, t], [f, g])
        self._second = batch([x, u, t, mu, nu], [hessian])

    def values(self, x: Array, u: Array, t: Array) -> tuple[Array, Array]:
        """f (n, 7) and (g, L) (n, m + k)."""
        f, g = self._values(x, u, t)
        return f[:, 0], g[:, 0]

    def first(self, x: Array, u: Array, t: Array) -> NodeDerivatives:
        """f, g, L and first derivatives; x (n, 7), u (n,), t (n,)."""
        f, fx, ft, g, gx = self._first(x, u, t)
        m = self.n_limits
        return NodeDerivatives(
            rates=f[:, 0].copy(),
            state_jacobian=fx.transpose(0, 2, 1).copy(),
            time_derivative=ft[:, 0].copy(),
            path=g[:, 0, :m].copy(),
            path_jacobian=gx.transpose(0, 2, 1)[:, :m].copy(),
            integrand=g[:, 0, m:].copy(),
            integrand_jacobian=gx.transpose(0, 2, 1)[:, m:].copy(),
        )

    def hessian(self, x: Array, u: Array, t: Array, mu: Array, nu: Array) -> Array:
        """Σ μ ∇²f + Σ ν ∇²(g, L) over (x, t): (n, 8, 8); `nu` (n, m + k)."""
        (h,) = self._second(x, u, t, mu, nu)
        return h


def _require_quadratures(jacobian: ca.SX) -> None:
    """Condensing relies on it: no state enters the bank angle's rate, no rate knows the longitude."""
    rows, columns = jacobian.sparsity().get_triplet()
    if BANK in rows or LONGITUDE in columns:
        raise ValueError(
            "equations of motion: expected a bank-angle rate without states and rates without the "
            "longitude; the condensing of the dynamics takes both as quadratures"
        )


class _Buffered:
    """A mapped CasADi function bound to numpy buffers; node-major, so (n, columns, rows)."""

    def __init__(self, function: Any, n: int) -> None:
        self._buffer, self._evaluate = function.buffer()
        self._inputs: list[Array] = [
            np.zeros((n, function.size1_in(i))) for i in range(function.n_in())
        ]
        self._outputs: list[Array] = [
            np.zeros((n, function.size2_out(i) // n, function.size1_out(i)))
            for i in range(function.n_out())
        ]
        for i, array in enumerate(self._inputs):
            self._buffer.set_arg(i, array.data)
        for i, array in enumerate(self._outputs):
            self._buffer.set_res(i, array.data)

    def __call__(self, *arguments: Array) -> list[Array]:
        for stored, given in zip(self._inputs, arguments, strict=True):
            stored[...] = given.reshape(stored.shape)
        self._evaluate()
        return self._outputs


@lru_cache(maxsize=16)
def scaled_dynamics(
    model: FlightModel,
    functions: NodeFunctions,
    state_scale: tuple[float, ...],
    rate_scale: float,
    n_nodes: int,
) -> ScaledDynamics:
    """The traced functions, built once per process and model."""
    return ScaledDynamics(model, functions, state_scale, rate_scale, n_nodes)
