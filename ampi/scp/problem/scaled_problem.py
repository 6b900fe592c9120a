"""The optimal control problem in scaled variables.

    minimise   Σ_i w_i e_i² + J(u, x, t_f)
    subject to ẋ = f(x, u, t),  x(t_0) = x₀ but for the angles that are steered (steered_angles),
               e = x(t_f) − x_target,  e_lo ≤ e ≤ e_hi,
               |σ| ≤ σ_max,  α_lo ≤ α ≤ α_up,  |u| ≤ u_max,  g(x, t) ≤ 1        (1)

with J of `objective` and g of `node_functions`. A final state is free (no row), weighted (Sagliano et
al. 2016, Eq. (1): w > 0, no bounds), met exactly (e_lo = e_hi = 0) or kept in a range. `Scaling` is the
one place where SI becomes dimensionless; time stays in seconds.

The problem of a family has arrays over its cases, (c, …), where that of one mission has numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.missions.family import MissionFamily
from ampi.missions.final_states import held_by, held_states
from ampi.missions.mission import Mission
from ampi.missions.sections import TARGET_WEIGHTS
from ampi.physics.angles import on_turn_of
from ampi.physics.state import ALTITUDE, CIRCULAR_STATES, LATITUDE, LONGITUDE, SPEED
from ampi.pseudospectral.mesh import Mesh
from ampi.scp.problem.objective import Objective
from ampi.scp.problem.problem_numbers import ProblemNumbers
from ampi.scp.problem.steered_angles import SteeredAngle, steered_angles
from ampi.tracing.dynamics import NodeDynamics, Physics, node_dynamics
from ampi.tracing.node_functions import NodeFunctions, TerminalCost
from ampi.tracing.numbers import Numbers, at_cases, is_zero

Array = NDArray[np.float64]
Cases = NDArray[np.intp]


def by_case(value: Any) -> Array:
    """A number, or an array over cases (c,), as a column that broadcasts over the points of each."""
    return np.reshape(np.asarray(value, dtype=float), (-1, 1))


@dataclass(frozen=True)
class Scaling:
    """x = states · x̂, angles as they are; the bank rate is measured in its limit."""

    states: tuple[float, ...] = (
        1e4,
        1.0,
        1.0,
        1e3,
        1.0,
        1.0,
        1.0,
    )  # m, rad, m/s; angles after them: 1
    final_time: float = 100.0  # s per unit of δt_f in the subproblem

    def of_states(self, count: int) -> Scaling:
        """The same for so many states."""
        more = count - len(self.states)
        return replace(self, states=(*self.states, *[1.0] * more)) if more > 0 else self


@dataclass(frozen=True, eq=False)
class Target:
    """The rows of e in Eq. (1), scaled: m of them; of a family the arrays of numbers are (c, m)."""

    state: NDArray[np.intp]  # (m,), which final state
    reference: Array  # (m,)
    weight: Array  # (m,), zero where the row is bounded
    lower: Array  # (m,), −∞ where the row is weighted
    upper: Array  # (m,)

    def __len__(self) -> int:
        return len(self.state)

    @cached_property
    def ranged(self) -> NDArray[np.intp]:
        """Rows that are kept in a range."""
        inside = (self.weight == 0.0) & (self.lower < self.upper)
        return np.flatnonzero(np.atleast_2d(inside).any(axis=0))

    @cached_property
    def held(self) -> NDArray[np.intp]:
        """All others: weighted, or met exactly."""
        return np.setdiff1d(np.arange(len(self)), self.ranged)

    def error(self, final_state: Array) -> Array:
        """e (…, m) of scaled final states (…, 7): of an angle, the short way round."""
        error = np.asarray(final_state[..., self.state] - self.reference)
        for row in self._circular:
            error[..., row] = on_turn_of(error[..., row], 0.0)
        return error

    @cached_property
    def _circular(self) -> list[int]:
        return [row for row, state in enumerate(self.state.tolist()) if state in CIRCULAR_STATES]

    def miss(self, error: Array) -> Array:
        """`error` (…, m) of weighted and exact rows; of a ranged one what lies outside its range."""
        inside = np.where(np.isfinite(self.upper), np.clip(error, self.lower, self.upper), 0.0)
        return np.asarray(error - inside)

    def quadratic(self, error: Array) -> Any:
        """Σ w e², (…)."""
        return (self.weight * error**2).sum(axis=-1)

    @classmethod
    def of(cls, numbers: ProblemNumbers, scale: Array, cost_scale: Any) -> Target:
        """The states that the mission holds, weighted, met exactly or in their ranges."""
        target, objective = numbers.section("target"), numbers.section("objective")
        weights = dict(zip((ALTITUDE, LONGITUDE, LATITUDE, SPEED), TARGET_WEIGHTS, strict=True))
        rows: list[tuple[int, Any, Any, Any]] = []  # state, middle, weight, half width
        for held in held_states(numbers.mission):
            field = held_by(numbers.mission.target, held) or ""
            span, weight = target(field), None
            if held in weights and not field.endswith("_range"):
                weight = objective(weights[held])
            low, high = span if isinstance(span, tuple) else (span, span)
            rows.append((held, 0.5 * (low + high), weight, 0.5 * (high - low)))
        state = np.array([row[0] for row in rows], dtype=np.intp)
        bound = [np.inf if weight is not None else half for _, _, weight, half in rows]
        weight = [0.0 if weight is None else weight for _, _, weight, _ in rows]
        unit = scale[state]
        upper = _columns(bound) / unit
        return cls(
            state=state,
            reference=_columns([row[1] for row in rows]) / unit,
            weight=_columns(weight) * unit**2 / _beside(cost_scale),
            lower=-upper,
            upper=upper,
        )


def _taken(value: Any, cases: Cases | int, axes: int) -> Any:
    """Some cases of an array that has an axis of them, and so many axes."""
    return value[cases] if isinstance(value, np.ndarray) and value.ndim == axes else value


def _columns(values: list[Any]) -> Array:
    """(m,), or (c, m) where one of them is an array over cases."""
    return np.stack(np.broadcast_arrays(*values), axis=-1) if values else np.zeros(0)


def _over(weight: Any, scale: Any) -> Any:
    """A weight over a scale: zero for all cases stays the number that it is, and the term away."""
    return weight if is_zero(weight) else weight / scale


def _terminal(numbers: ProblemNumbers, cost_scale: Any) -> TerminalCost | None:
    """m(x_f), scaled, where the objective has it."""
    if not numbers.mission.objective.has_terminal:
        return None
    given, entry = numbers.section("objective"), numbers.section("entry")
    start = (entry(name) for name in ("longitude", "latitude", "azimuth"))
    return TerminalCost(
        given("final_speed") / cost_scale, given("cross_range") * 1e-3 / cost_scale, *start
    )


def _beside(value: Any) -> Any:
    """An array over cases as a column, for arrays with an axis of rows."""
    return value[:, None] if isinstance(value, np.ndarray) and value.ndim else value


@dataclass(frozen=True, eq=False)
class OptimalControlProblem:
    """Eq. (1) for one mission, or for c of one structure. Arrays are in scaled units."""

    planet_radius: Any  # m
    mesh: Mesh
    scaling: Scaling
    entry: Array  # (6,)
    angles: tuple[SteeredAngle, ...]  # the bank angle, then the angle of attack if it is one
    target: Target
    objective: Objective
    functions: NodeFunctions
    target_tolerance: Array  # (2,): altitude, speed
    dynamics: NodeDynamics  # the traced functions, shared by all problems of this structure
    numbers: Numbers  # what goes into them

    @classmethod
    def of(
        cls, source: Mission | MissionFamily, scaling: Scaling | None = None
    ) -> OptimalControlProblem:
        """Scale the problem of a mission or a family."""
        numbers = ProblemNumbers.of(source)
        scaling = (scaling or Scaling()).of_states(numbers.model.n_states)
        scale = np.array(scaling.states)
        objective = Objective.of(numbers)
        given, target = numbers.section("objective"), numbers.section("target")
        limits, angles = numbers.limits, steered_angles(numbers)
        tolerances = [target("altitude_tolerance") / scale[0], target("speed_tolerance") / scale[3]]
        entry = source.entry_state if isinstance(source, Mission) else source.entry_states
        functions = NodeFunctions(
            limits=limits,
            shares=tuple(numbers.share(name) for name in limits.on_the_path),
            heat_load=_over(given("heat_load") * 1e-6, objective.cost_scale),
            ground_range=_over(given("ground_range") * 1e-3, objective.cost_scale),
            desired_altitude_rate=given("desired_altitude_rate"),
            terminal=_terminal(numbers, objective.cost_scale),
        )
        rates = tuple(angle.rate_limit for angle in angles)
        physics = Physics.of(numbers.model, functions, rates[0] if len(rates) == 1 else rates)
        return cls(
            planet_radius=numbers.model.planet.equatorial_radius,
            mesh=numbers.mission.pseudospectral_mesh,
            scaling=scaling,
            entry=entry / scale[:6],
            angles=angles,
            target=Target.of(numbers, scale, objective.cost_scale),
            objective=objective,
            functions=functions,
            target_tolerance=_columns(tolerances),
            dynamics=node_dynamics(physics.structure, scaling.states),
            numbers=physics.numbers,
        )

    def at(self, cases: Cases | int) -> OptimalControlProblem:
        """The problem of some cases of a family, or of one, which has no axis of them.

        `functions` stay those of all.
        """
        everyone = isinstance(cases, np.ndarray) and len(cases) == len(self.entry)
        if self.entry.ndim == 1 or everyone:
            return self
        if self._differs_in_entry_alone:
            return replace(self, entry=self.entry[cases])
        target = self.target
        rows = ("reference", "weight", "lower", "upper")
        return replace(
            self,
            planet_radius=_taken(self.planet_radius, cases, axes=1),
            entry=_taken(self.entry, cases, axes=2),
            angles=tuple(angle.at(cases) for angle in self.angles),
            target=replace(
                target, **{name: _taken(getattr(target, name), cases, axes=2) for name in rows}
            ),
            objective=self.objective.at(cases),
            target_tolerance=_taken(self.target_tolerance, cases, axes=2),
            numbers=at_cases(self.numbers, cases),
        )

    @cached_property
    def _differs_in_entry_alone(self) -> bool:
        parts = (self.target.reference, self.target.weight, self.target.upper)
        numbers = [*self.objective.numbers]
        numbers += [self.planet_radius, *self.numbers]
        numbers += [number for angle in self.angles for number in angle.numbers]
        arrays = any(isinstance(number, np.ndarray) for number in numbers)
        return not (arrays or any(p.ndim > 1 for p in (*parts, self.target_tolerance)))

    @cached_property
    def n_states(self) -> int:
        """Seven, or eight."""
        return len(self.scaling.states)

    @cached_property
    def n_controls(self) -> int:
        """One, or two."""
        return len(self.angles)

    @cached_property
    def given_rates(self) -> tuple[tuple[int, Any], ...]:
        """(control, û at the first node) of those that are given."""
        rates = ((k, angle.scaled_entry_rate) for k, angle in enumerate(self.angles))
        return tuple((k, rate) for k, rate in rates if rate is not None)

    def in_si(self, rates: Array) -> Array:
        """Rates û of the controls (m, n) in rad/s."""
        return np.stack([r * a.rate_limit for r, a in zip(rates, self.angles, strict=True)])

    @cached_property
    def n_limits(self) -> int:
        """How many path limits there are."""
        return len(self.functions.names)

    @cached_property
    def n_functions(self) -> int:
        """How many limits and integrands."""
        return self.n_limits + self.functions.n_smooth + self.functions.n_absolute

    @cached_property
    def multiplier_scale(self) -> Array:
        """Scaled multipliers of the target over those in SI (m,)."""
        units = np.array(self.scaling.states)[self.target.state]
        return np.asarray(units / _beside(self.objective.cost_scale))

    def reference_cost(self, final_time: float) -> float:
        """Effort of one linear sweep from −σ_max to σ_max over the flight, at its reference weight."""
        bank = self.angles[0]
        rate = 2.0 * bank.upper / (bank.rate_limit * final_time)
        return float(self.objective.reference_effort[0] * rate**2 * final_time)
