"""A formulation: one way to write the entry problem as an optimal control problem.

Two are in use: over time with the rates of the bank angle and, where it is steered, of the angle of
attack as controls (`time_domain`: Zhou 2021, Wang 2020, Liu 2024), and over energy with cos σ and sin σ
(`energy_domain`: Liu 2015). A formulation names its states and controls, traces its functions once,

    x' = f(x, u, s),   g(x, s) ≤ 1,
    J = Σ_k c_k ∫ l_k(x, u, s) ds (or ∫ |l_k|) + c_s s_f + m(x_f),                             (1)

and says how a trajectory is read from its solution. All arrays are in scaled units, node-major.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ampi.missions.final_states import FinalState
from ampi.pseudospectral.mesh import Mesh
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]


class TermKind(Enum):
    """How an integrand enters the convex cost."""

    LINEAR = "linearised"
    CONVEX = "with its second derivative, where positive"  # Liu 2015, Eqs. (29)–(35)
    ABSOLUTE = "absolute value, epigraph"  # Wang 2020, Eqs. (33)–(35)


@dataclass(frozen=True)
class Term:
    """c_k ∫ l_k ds; integrands are traced in the order of the terms."""

    name: str
    weight: float
    kind: TermKind


@dataclass(frozen=True)
class Linearisation:
    """Values and derivatives at n nodes: k limits, m integrands."""

    rates: Array  # (n, n_x)
    state_jacobian: Array  # (n, n_x, n_x)
    control_jacobian: Array  # (n, n_x, n_u)
    drift: Array  # (n, n_x), ∂f/∂s
    limits: Array  # g (n, k)
    limit_jacobian: Array  # (n, k, n_x)
    limit_drift: Array  # (n, k)
    integrands: Array  # l (n, m)
    integrand_state: Array  # (n, m, n_x)
    integrand_control: Array  # (n, m, n_u)
    integrand_curvature: Array  # (n, m, n_x + n_u), diagonal of ∂²l


class Formulation(Protocol):
    """What the successive convexification needs to know."""

    @property
    def n_states(self) -> int:
        """Number of states."""
        ...

    @property
    def n_controls(self) -> int:
        """Number of controls."""
        ...

    @property
    def state_scale(self) -> Array:
        """SI or rad per scaled unit (n_x,)."""
        ...

    @property
    def final_scale(self) -> float:
        """Of the subproblem's δs."""
        ...

    @property
    def entry(self) -> Array:
        """(n_x,), NaN where free."""
        ...

    @property
    def entry_controls(self) -> Array:
        """u at the first node (n_u,), NaN where free."""
        ...

    @property
    def target(self) -> tuple[FinalState, ...]:
        """Final states that are held."""
        ...

    @property
    def terms(self) -> tuple[Term, ...]:
        """Terms of the objective."""
        ...

    @property
    def final_cost(self) -> float:
        """C_s."""
        ...

    @property
    def final_is_free(self) -> bool:
        """Whether s_f is free."""
        ...

    @property
    def state_bounds(self) -> tuple[Array, Array]:
        """(n_x,) each."""
        ...

    @property
    def control_bounds(self) -> tuple[Array, Array]:
        """(n_u,) each."""
        ...

    @property
    def control_cone(self) -> bool:
        """Whether ‖u‖ ≤ 1 holds at every node."""
        ...

    @property
    def limit_names(self) -> tuple[str, ...]:
        """Kinds of limits, in order."""
        ...

    def linearise(self, mesh: Mesh, x: Array, u: Array, final: float) -> Linearisation:
        """Eq. (1) and its derivatives at the nodes."""
        ...

    def curvature(self, mesh: Mesh, x: Array, u: Array, final: float, mu: Array, w: Array) -> Array:
        """∂²(w·l + μ·f)/∂x_k² at the nodes with μ (n, n_x), w (n, terms): (n, n_x)."""
        ...

    def terminal(self, x: Array) -> tuple[float, Array]:
        """Value of m and its gradient at a final state (n_x,)."""
        ...

    def rates(self, x: Array, u: Array, s: Array) -> Array:
        """f alone, at any points: (n, n_x)."""
        ...

    def limits(self, x: Array, u: Array, s: Array) -> Array:
        """g alone, at any points: (n, k)."""
        ...

    def trajectory(self, mesh: Mesh, x: Array, u: Array, final: float) -> Trajectory:
        """The flight in SI over time, without status and statistics."""
        ...


Expressions = tuple[list[Any], list[Any], list[Any]]


class TracedFunctions:
    """f, g, l, m and their derivatives, traced by CasADi from plain numpy expressions."""

    def __init__(
        self,
        n_states: int,
        n_controls: int,
        build: Callable[[Any, Any, Any], Expressions],
        final_cost: Callable[[Any], Any] = lambda _: ca.SX(0.0),
    ) -> None:
        x, u, s = ca.SX.sym("x", n_states), ca.SX.sym("u", n_controls), ca.SX.sym("s")
        previous = ca.GlobalOptions.getNumpyMode()
        ca.GlobalOptions.setNumpyMode(-1)
        try:
            rates, limits, integrands = build(x, u, s)
            terminal = final_cost(x)
        finally:
            ca.GlobalOptions.setNumpyMode(previous)
        f, g = ca.vertcat(*rates), ca.vertcat(*limits)
        integrand: Any = ca.vertcat(*integrands)
        xu = ca.vertcat(x, u)
        second: list[Any] = [ca.hessian(integrand[k], xu)[0] for k in range(integrand.numel())]
        curvature: Any = ca.vertcat(*(ca.diag(h).T for h in second)) if second else ca.SX(0, 0)
        outputs: list[Any] = [
            *(f, ca.jacobian(f, x), ca.jacobian(f, u), ca.jacobian(f, s)),
            *(g, ca.jacobian(g, x), ca.jacobian(g, s)),
            *(integrand, ca.jacobian(integrand, x), ca.jacobian(integrand, u), curvature),
        ]
        costates, weights = ca.SX.sym("mu", f.numel()), ca.SX.sym("w", integrand.numel())
        hamiltonian: Any = ca.dot(weights, integrand) + ca.dot(costates, f)
        diagonal: Any = ca.diag(ca.hessian(hamiltonian, x)[0])
        arguments = [x, u, s, costates, weights]
        self._curvature = ca.Function("curvature", arguments, [ca.densify(diagonal)])
        self._all = ca.Function("all", [x, u, s], [ca.densify(o) for o in outputs])
        self._rates = ca.Function("rates", [x, u, s], [ca.densify(f)])
        self._limits = ca.Function("limits", [x, u, s], [ca.densify(g)])
        by_state = ca.densify(ca.gradient(terminal, x))
        self._terminal = ca.Function("terminal", [x], [terminal, by_state])
        self._mapped: dict[tuple[str, int], Any] = {}

    def _map(self, function: Any, n: int) -> Any:
        key = (function.name(), n)
        if key not in self._mapped:
            self._mapped[key] = function.map(n)
        return self._mapped[key]

    def rates(self, x: Array, u: Array, s: Array) -> Array:
        """f at n points, (n, n_x)."""
        return np.array(self._map(self._rates, len(x))(x.T, u.T, s[None])).T

    def limits(self, x: Array, u: Array, s: Array) -> Array:
        """g at n points, (n, k)."""
        return np.array(self._map(self._limits, len(x))(x.T, u.T, s[None])).T

    def terminal(self, x: Array) -> tuple[float, Array]:
        """Value of m and its gradient at one state (n_x,)."""
        value, gradient = self._terminal(x)
        return float(value), np.array(gradient).ravel()

    def curvature(self, x: Array, u: Array, s: Array, mu: Array, w: Array) -> Array:
        """∂²(w·l + μ·f)/∂x_k² at n points with μ (n, n_x), w (n, m): (n, n_x)."""
        return np.array(self._map(self._curvature, len(x))(x.T, u.T, s[None], mu.T, w.T)).T

    def linearise(self, x: Array, u: Array, s: Array) -> Linearisation:
        """Everything at n points."""
        n, columns = len(x), x.shape[1] + u.shape[1]
        found = self._map(self._all, n)(x.T, u.T, s[None])

        def stack(value: Any, width: int) -> Array:
            return np.asarray(np.array(value).reshape(-1, n, width).transpose(1, 0, 2))

        f, fx, fu, fs, g, gx, gs, value, lx, lu, lxx = found
        n_x, n_u = x.shape[1], u.shape[1]
        return Linearisation(
            rates=np.array(f).T,
            state_jacobian=stack(fx, n_x),
            control_jacobian=stack(fu, n_u),
            drift=np.array(fs).T,
            limits=np.array(g).T,
            limit_jacobian=stack(gx, n_x),
            limit_drift=np.array(gs).T,
            integrands=np.array(value).T,
            integrand_state=stack(lx, n_x),
            integrand_control=stack(lu, n_u),
            integrand_curvature=stack(lxx, columns),
        )
