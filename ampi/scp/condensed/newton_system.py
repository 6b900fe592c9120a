"""Eq. (1) of `newton` for every case: its matrices, and its solutions with the limits that are held."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ampi.scp.condensed.condensing import Cases, CondensedDynamics
from ampi.scp.condensed.convexify import STIFF
from ampi.scp.condensed.cost import (
    add_rate_curvature,
    integrand_gradient,
    integrand_multipliers,
    smooth_gradient,
)
from ampi.scp.condensed.curvature import (
    Curvature,
    CurvatureSettings,
    gauss_newton,
    hold_given_angles,
)
from ampi.scp.condensed.dual_steps import LimitedStep
from ampi.scp.condensed.kkt_factors import KktFactors
from ampi.scp.condensed.limit_rows import LimitRows, Sides, following
from ampi.scp.condensed.points import Points, zero_states
from ampi.scp.condensed.settings import NewtonSettings
from ampi.tracing.dynamics import entries

Array = NDArray[np.float64]

STIFFEST = (
    1e3  # of rows that are known to hold, in place of `STIFF`: two digits less, fewer refused
)


@dataclass(eq=False)
class Multipliers:
    """λ of the rows that always hold (c, r); ν of the limits' rows, and which are held (c, rows)."""

    target: Array
    limits: Array
    side: Sides

    def keep(self, chosen: NDArray[np.bool_]) -> None:
        """Go on with these cases."""
        self.target, self.limits = self.target[chosen], self.limits[chosen]
        self.side = self.side[chosen]

    def copy(self) -> Multipliers:
        """Others of the same values."""
        return Multipliers(self.target.copy(), self.limits.copy(), self.side.copy())


@dataclass(frozen=True, eq=False)
class NewtonStep:
    """A solution of Eq. (1); not a number for a case that has none."""

    z: Array  # (c, n_z)
    change: Array  # Z z, (s, c, n)
    target: Array  # λ, (c, r)
    limits: Array  # ν, (c, rows)


@dataclass(frozen=True, eq=False)
class NewtonSystem:
    """Eq. (1) where its matrices were made."""

    points: Points
    condensed: CondensedDynamics
    rows: LimitRows
    curvature: Curvature
    hessian: Array  # H, (c, n_z, n_z)
    held_map: Array  # the rows of K that always hold, (c, r, n_z)
    compliance: Array  # 1/2w of those, (c, r)
    factors: list[KktFactors | None]  # with the limits that are held; None: there is no solution

    @classmethod
    def of(cls, points: Points, multipliers: Multipliers) -> NewtonSystem:
        """At the present points."""
        problem, condensed = points.problem, points.condensed()
        target, t = problem.target, points.transcription
        held_map, compliance = (
            condensed.final_map[:, target.state[target.held]],
            _compliance(points),
        )
        for k, _ in problem.given_rates:
            row = np.zeros((len(points), 1, condensed.n_variables))
            row[:, 0, k : condensed.n_controls * len(t.entry_rate) : condensed.n_controls] = (
                t.entry_rate
            )
            held_map = np.concatenate([held_map, row], axis=1)
        rows = LimitRows.of(problem, condensed)
        curvature, hessian = _second_order(points, condensed, rows, multipliers)
        factors: list[KktFactors | None] = [None] * len(points)
        return cls(points, condensed, rows, curvature, hessian, held_map, compliance, factors)

    def with_curvature_of(self, multipliers: Multipliers) -> NewtonSystem:
        """The same, its Hessian weighed by other multipliers."""
        curvature, hessian = _second_order(self.points, self.condensed, self.rows, multipliers)
        return replace(self, curvature=curvature, hessian=hessian)

    def with_numbers_of(self, points: Points) -> NewtonSystem:
        """The same matrices and factors, for the residual of other problems at other points.

        The curvature and the rows over z stay; bounds and weights are those of the other problems.
        """
        rows = LimitRows.of(points.problem, self.condensed)
        return replace(self, points=points, rows=rows, compliance=_compliance(points))

    def right_side(self, shift: Array) -> tuple[Array, Array, Array]:
        """Gradient (c, n_z), errors of the rows that always hold, values of the limits' rows."""
        points, problem, condensed = self.points, self.points.problem, self.condensed
        everyone = points.everyone
        gradient = smooth_gradient(problem, points.transcription, points.u, points.final_time)
        if problem.functions.n_smooth:
            values = points.functions[problem.n_limits, :, 1:]
            jacobian = condensed.derivatives.gradient_of(problem.n_limits)[:, 1:]
            gradient += integrand_gradient(condensed, values, jacobian, condensed.half, everyone)
        terminal = points.terminal(everyone)
        if terminal is not None:
            gradient += (terminal.gradient[:, None] @ condensed.final_map)[:, 0]
        over_states, over_time = self.curvature.product(shift, everyone)
        gradient += condensed.projected(over_states, everyone)
        gradient[:, condensed.time_column] += over_time
        return gradient, points.errors(everyone, shift), self.limit_values(shift, everyone)

    def limit_values(self, shift: Array, cases: Cases) -> Array:
        """Of the limits' rows after `shift`, (k, rows)."""
        points, change = self.points, zero_states(self.points, cases)
        change[:, :, 1:] = shift.transpose(2, 0, 1)
        rate = points.rate(cases)
        value = self.rows.value(
            points.problem.at(cases).target, points.x[:, cases], rate, points.path[:, cases]
        )
        return value + self.rows.moved(change, 0.0 * rate, np.zeros(len(cases)), cases)

    def gauss_newton(self, settings: CurvatureSettings) -> NewtonSystem:
        """The same with the effort's curvature alone: convex whatever the multipliers are."""
        points = self.points
        diagonal = gauss_newton(points.problem, points.transcription, points.final_time, settings)
        hessian = np.zeros_like(self.hessian)
        at = np.arange(diagonal.shape[1])
        hessian[:, at, at] = diagonal
        return replace(self, hessian=hessian)

    def solution(
        self,
        gradient: Array,
        errors: Array,
        value: Array,
        side: Sides,
        settings: NewtonSettings,
        cases: Cases | None = None,
    ) -> NewtonStep:
        """Of Eq. (1), of `cases` or of all; NaN where the held set does not settle."""
        points, rows = self.points, self.rows
        changes = np.zeros_like(points.x)
        z, on_target = np.full_like(gradient, np.nan), np.full_like(errors, np.nan)
        on_limits, pending = np.zeros_like(value), points.everyone if cases is None else cases
        for exchange in range(settings.exchanges + 1):
            if exchange == settings.exchanges:
                for case in pending:
                    self._one_by_one(case, side, gradient, errors, value, settings.dual_steps)
            for case in pending:
                self.factors[case] = self._factored(case, side[case])
                found = self.held_solution(
                    case, side[case], gradient[case], errors[case], value[case]
                )
                z[case], on_target[case], on_limits[case] = found
            changes[:, pending] = change = self.condensed.change(z[pending], pending)
            there = value[pending] + self.moved(z[pending], change, pending)
            bounds = (rows.lower[pending], rows.upper[pending])
            now = following(side[pending], on_limits[pending], there, *bounds)
            changed = (now != side[pending]).any(axis=1)
            side[pending] = now
            pending = pending[changed]
            if not len(pending):
                break
        z[pending] = np.nan
        return NewtonStep(z, changes, on_target, on_limits)

    def held_step(self, gradient: Array, errors: Array, value: Array, side: Sides) -> NewtonStep:
        """Of Eq. (1) with the rows `side` held, whatever it leads to; NaN where there is none."""
        z, on_target = np.full_like(gradient, np.nan), np.full_like(errors, np.nan)
        on_limits, everyone = np.zeros_like(value), self.points.everyone
        for case in everyone.tolist():
            self.factors[case] = self._factored(case, side[case], STIFFEST)
            z[case], on_target[case], on_limits[case] = self.held_solution(
                case, side[case], gradient[case], errors[case], value[case]
            )
        return NewtonStep(z, self.condensed.change(z, everyone), on_target, on_limits)

    def moved(self, z: Array, change: Array, cases: Cases) -> Array:
        """What z (k, n_z) adds to the values of the limits' rows, with `change` = Z z."""
        m, column = self.condensed.n_controls, self.condensed.time_column
        rate = self.points.transcription.nodal_rate(z[:, :column], m)
        return self.rows.moved(change, rate, z[:, column], cases)

    def _one_by_one(
        self, case: int, side: Sides, gradient: Array, errors: Array, value: Array, most: int
    ) -> None:
        """Set `side` of one case by dual steps, if they settle."""
        own, none = np.array([case]), np.zeros_like(side[case])

        def values(z: Array) -> Array:
            return np.asarray(self.moved(z[None], self.condensed.change(z[None], own), own)[0])

        limited = LimitedStep(
            factored=lambda held: self._factored(case, held),
            row=lambda row: self.rows.matrix(case, np.array([row]))[0],
            values=values,
            lower=self.rows.lower[case],
            upper=self.rows.upper[case],
            always=errors.shape[1],
        )
        self.factors[case] = self._factored(case, none)
        z, _, _ = self.held_solution(case, none, gradient[case], errors[case], value[case])
        if np.isfinite(z[0]):
            found = limited.side(value[case] + values(z), most)
            side[case] = none if found is None else found

    def held_solution(
        self, case: int, side: Sides, gradient: Array, errors: Array, value: Array
    ) -> tuple[Array, Array, Array]:
        """z, λ and ν of one case with the rows `side` held; not a number if it has no factors."""
        on_limits, factors, held = np.zeros_like(value), self.factors[case], np.flatnonzero(side)
        if factors is None:
            return np.full_like(gradient, np.nan), np.full_like(errors, np.nan), on_limits
        bound = np.where(side > 0, self.rows.upper[case], self.rows.lower[case])
        error = np.concatenate([errors, (value - bound)[held]])
        z, found = factors.solution(gradient, error)
        on_limits[held] = found[len(errors) :]
        return z, found[: len(errors)], on_limits

    def _factored(self, case: int, side: Sides, stiffness: float = STIFF) -> KktFactors | None:
        held = np.flatnonzero(side)
        kkt, compliance = self.held_map[case], self.compliance[case]
        if len(kkt) + len(held) > len(self.hessian[case]):
            return None  # rows that depend on each other
        if len(held):
            kkt = np.concatenate([kkt, self.rows.matrix(case, held)])
            compliance = np.concatenate([compliance, np.zeros(len(held))])
        return KktFactors.of(self.hessian[case], kkt, compliance, stiffness)


def _compliance(points: Points) -> Array:
    """1/2w of the rows that always hold, zero where they hold exactly, (c, r)."""
    problem, target = points.problem, points.problem.target
    weight = np.broadcast_to(target.weight[..., target.held], (len(points), len(target.held)))
    found = np.zeros((len(points), len(target.held) + len(problem.given_rates)))
    weighted = found[:, : len(target.held)]
    np.divide(0.5, weight, out=weighted, where=weight > 0.0)
    return found


def _second_order(
    points: Points, condensed: CondensedDynamics, rows: LimitRows, multipliers: Multipliers
) -> tuple[Curvature, Array]:
    """The curvature of the Lagrangian and H (c, n_z, n_z), with μ from λ and ν."""
    problem, t, m = points.problem, points.transcription, points.problem.n_limits
    derivatives, everyone = condensed.derivatives, points.everyone
    gradient, _ = rows.node_gradient(multipliers.limits, rows.path_gradient)
    gradient[:, -1, problem.target.state[problem.target.held]] += multipliers.target[
        :, : len(problem.target.held)
    ]
    none = np.zeros((len(points), 0))
    omega = integrand_multipliers(problem, t, points.final_time, none)
    running = None
    if len(omega):
        running = omega[0][..., None] * derivatives.gradient_of(m)[:, 1:]
        gradient += running[:, :, :-1]
    terminal = points.terminal(everyone)
    if terminal is not None:
        gradient[:, -1] += terminal.gradient
    mu = condensed.multipliers(gradient, everyone)
    weights = np.concatenate([rows.path_multipliers(multipliers.limits), omega])
    function = problem.dynamics.second
    (second,) = points.evaluate(function, everyone, -condensed.half * mu, weights, first=1)
    over_xt = entries(function.nonzeros[0], second)
    if terminal is not None:
        terminal.add_curvature(over_xt, len(t.weights))
    curvature = Curvature.of(condensed, over_xt, mu, running)
    hessian = curvature.reduced()
    add_rate_curvature(hessian, problem, t, points.u, points.final_time)
    hold_given_angles(hessian, problem)
    return curvature, hessian
