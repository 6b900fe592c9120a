"""Tracking gains at every vertex: a Riccati sweep along each optimum, in its predicted miss.

The tracker steers the bank rate, δu = −K(t) δx with δx the seven-state error at equal time, and K
minimises along the optimum

    ½ Σ_j w_j y_j(t_f)² + ½ (1/t_f) ∫ (δu/u_r)² + (δσ/σ_r)² dt,   δẋ = A δx + e_σ δu.     (1)

Guided flight ends where the speed reaches its target, not at a time. A flight with errors δx at t_f
crosses that speed δt = −δV/V̇ later, so the miss that counts is, for each coordinate j of position,

    y_j(t_f) = δx_j − (ẋ_j/V̇) δV.                                                        (2)

There is no running weight on position: the reference between entry and target is a means, and an
interpolated one is not quite a flight; holding on to it would pass its defects on to the target.

That leaves four states of the seven. With z the six without the bank angle, the miss predicted at t
if the bank angle keeps to the reference is y(t) = Λ(t)ᵀ z(t), where

    −Λ̇ = A_zzᵀ Λ,  Λ(t_f) from Eq. (2);      ẏ = c δσ,  c = Λᵀ A_zσ,  δσ̇ = δu.             (3)

The Riccati equation of (y, δσ) is solved backwards by Strang's splitting: what the dynamics and the
running cost do to S (S ← ΦᵀSΦ + Q dt, with Φ = I + ∫c dt e_yσ) between halves of what the control
does, −Ṡ = −S e_σ e_σᵀ S / R. Both have exact flows, so S stays positive however long the step; the
error is of second order, 2 % of the greatest gain with `STEP`, and lies in the last half minute.

Who steers the angle of attack as well, by δα = −K_α δx about the reference, adds (δα/α_r)²/t_f to the
running cost, and d δα to the rate of the miss:

    ẏ = c δσ + d δα,  d = Λᵀ A_zα,      −Ṡ = … − S (e_σ e_σᵀ/R + d dᵀ/R_α) S,  K_α = dᵀS/R_α,   (4)
    R_α = [1 + (T/(t_f − t))²] / (α_r² t_f).

The second term of R_α takes the angle out of the last seconds. It acts at once, so without that term
K_α would grow like 1/(t_f − t), faster than a vehicle can turn and than nodes seconds apart can say.
Both sizes are chosen by campaigns in a wrong world: of 200 flights of SHEFEX-3, 27 optima, 24 % pass by
the bank alone, 52 % with 0.3° and no T, 70 to 76 % with 2 to 3° and 40 to 60 s.
The flows of both controls commute, so one after the other they are still exact. The bank rate's gains
are then others, smaller: it leaves to the angle of attack what that does cheaper.

Cases of about equal final time share one grid and are swept at once; the grid depends on the case
alone, so its gains do not depend on its company.

References
----------
Bryson & Ho (1975), Chapter 5 (free final time: Section 5.5; the predicted miss: Section 5.3).
Strang (1968), SIAM J. Numer. Anal. 5(3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.missions.family import MissionFamily
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.state import BANK, N_STATES
from ampi.pseudospectral.lagrange import interpolation_matrix
from ampi.pseudospectral.mesh import Mesh, Segment
from ampi.tracing.dynamics import Physics, node_dynamics
from ampi.tracing.node_functions import NodeFunctions
from ampi.tracker_design.second_control import SecondControl, angle_of_attack_effect

Array = NDArray[np.float64]

STEP = 1.5  # s
HORIZON = (
    100.0  # s: flights are swept together whose final times round up to the same multiple of it
)
DEGREE = float(np.pi / 180.0)


@dataclass(frozen=True, kw_only=True)
class GainSettings:
    """Acceptable sizes (Bryson's rule) for Eq. (1)."""

    horizontal_miss: float = 500.0  # m
    altitude_error: float = 200.0  # m
    bank_rate: float = 0.5 * DEGREE  # rad/s over the whole flight
    bank_deviation: float = 5.0 * DEGREE  # rad over the whole flight


@dataclass(frozen=True, kw_only=True)
class SteeringSettings(GainSettings):
    """The same for Eq. (4), where the angle of attack may leave its reference."""

    angle_of_attack_change: float = 3.0 * DEGREE  # rad over the whole flight
    last_seconds: float = 60.0  # s, T of Eq. (4)


def vertex_gains(
    family: MissionFamily,
    mesh: Mesh,
    states: Array,
    final_time: Array,
    settings: GainSettings,
    *,
    swept_as: Array | None = None,
) -> Array:
    """K at the nodes, (c, 7, n), of trajectories `states` (c, 7 or 8, n), `final_time` (c,).

    Row i multiplies the error of state i (SI, rad); the command is u_ref − K · δx (rad/s). They are
    swept on the grids of flights of final times `swept_as` (c,); None: their own. Gains need the same
    grids to be compared to more digits than a sweep is accurate to.
    """
    return _swept(family, mesh, states, final_time, settings, None, swept_as)


def steering_gains(
    family: MissionFamily,
    mesh: Mesh,
    states: Array,
    final_time: Array,
    settings: SteeringSettings,
    *,
    swept_as: Array | None = None,
) -> Array:
    """K and K_α of Eq. (4) at the nodes, (c, 14, n); the arguments are those of `vertex_gains`.

    The first seven rows are of the bank rate (rad/s), the others of the change of the angle of attack
    (rad): the commands are u_ref − K · δx and α_ref − K_α · δx.
    """
    return _swept(family, mesh, states, final_time, settings, settings, swept_as)


def _swept(
    family: MissionFamily,
    mesh: Mesh,
    states: Array,
    final_time: Array,
    settings: GainSettings,
    steering: SteeringSettings | None,
    swept_as: Array | None,
) -> Array:
    """(c, 7, n), or (c, 14, n) with the angle of attack (`steering`): on grids of like flights."""
    rows = N_STATES if steering is None else 2 * N_STATES
    gains = np.zeros((len(states), rows, mesh.n_nodes))
    horizon = HORIZON * np.ceil((final_time if swept_as is None else swept_as) / HORIZON)
    for longest in np.unique(horizon):
        part = np.flatnonzero(horizon == longest)
        alike = family.take(part)
        fine = [_fine_grid(s, float(longest)) for s in mesh.segments]
        gains[part] = _sweep(alike, mesh, fine, states[part], final_time[part], settings, steering)
    return gains


def _fine_grid(segment: Segment, final_time: float) -> Array:
    """τ of a segment: between nodes even steps, at most `STEP` long in a flight of `final_time`."""
    half = segment.half_length[0] + segment.half_length[1] * final_time
    nodes = segment.rule.nodes
    counts = np.ceil(half * np.diff(nodes) / STEP).astype(int)
    gaps = zip(nodes[:-1], nodes[1:], counts, strict=True)
    return np.concatenate([*(np.linspace(*gap, endpoint=False) for gap in gaps), nodes[-1:]])


def _sweep(
    family: MissionFamily,
    mesh: Mesh,
    fine: list[Array],
    states: Array,
    final_time: Array,
    settings: GainSettings,
    steering: SteeringSettings | None,
) -> Array:
    """Backwards over the fine grids of the segments; S is (4, 4, c), Λ (c, 6, 3)."""
    cases = len(states)
    gains = np.zeros((cases, 7 if steering is None else 14, mesh.n_nodes))
    rate_weight = 1.0 / (settings.bank_rate**2 * final_time)
    bank_weight = 1.0 / (settings.bank_deviation**2 * final_time)
    nodal = _nodal_jacobians(family, mesh, states, final_time)
    angle = None
    if steering is not None:
        effect = angle_of_attack_effect(family, mesh, states, final_time)
        weight = 1.0 / (steering.angle_of_attack_change**2 * final_time)
        angle = SecondControl(mesh, final_time, effect, weight, steering.last_seconds)
        nodal = np.concatenate([nodal, effect], axis=2)
    miss = _final_miss(family, states, final_time, settings)
    cost = np.zeros((4, 4, cases))
    cost[range(3), range(3)] = 1.0  # y is counted in acceptable misses
    for s, tau in zip(reversed(mesh.segments), reversed(fine), strict=True):
        # along a segment A is as smooth as the states: its values at the nodes give it everywhere
        between = 0.5 * (tau[1:] + tau[:-1])
        matrix = interpolation_matrix(s.rule.nodes, s.rule.barycentric, between)
        transposed = (matrix @ nodal[:, s.nodes]).reshape(cases, len(between), -1, 6)
        steps = (s.half_length[0] + s.half_length[1] * final_time) * np.diff(tau)[:, None]
        on_node = np.searchsorted(tau, s.rule.nodes)
        node_at = {int(k): s.nodes.start + j for j, k in enumerate(on_node)}
        for k in reversed(range(len(steps))):
            dt = steps[k]
            forward = transposed[:, k] * dt[:, None, None]
            moved = forward @ (miss + 0.5 * (forward[:, :6] @ miss))  # midpoint rule, Eq. (3)
            miss = miss + moved[:, :6]
            cost = _controlled(cost, 0.5 * dt, rate_weight)
            if angle is not None:
                push = angle.over_step(s, between[k], moved[:, 7].T / dt)
                cost = push.controlled(cost, 0.5 * dt)
            cost = _continued(cost, moved[:, 6].T)
            cost[3, 3] += bank_weight * dt
            cost = _controlled(cost, 0.5 * dt, rate_weight)
            if angle is not None:
                cost = push.controlled(cost, 0.5 * dt)
            if k in node_at:
                gains[:, :7, node_at[k]] = _over_states(cost[3] / rate_weight, miss)
                if angle is not None:
                    at_node = angle.at_node(node_at[k], miss).gain(cost)
                    gains[:, 7:, node_at[k]] = _over_states(at_node, miss)
    return gains


def _over_states(gain: Array, miss: Array) -> Array:
    """(c, 7), of the states, from a gain (4, c) of the miss and the bank angle."""
    found = np.empty((gain.shape[1], N_STATES))
    found[:, :6] = (miss @ gain.T[:, :3, None])[:, :, 0]
    found[:, 6] = gain[3]
    return found


def _controlled(cost: Array, dt: Array, rate_weight: Array) -> Array:
    """S before `dt` of the control alone: the exact flow of −Ṡ = −S e_σ e_σᵀ S / R."""
    return cost - cost[3][:, None] * (cost[3] * (dt / (rate_weight + dt * cost[3, 3])))


def _continued(cost: Array, shift: Array) -> Array:
    """ΦᵀSΦ where δσ moves y by `shift` (3, c)."""
    found = cost.copy()
    moved = (cost[:3] * shift[:, None]).sum(axis=0)
    found[3] += moved
    found[:, 3] += moved
    found[3, 3] += (moved[:3] * shift).sum(axis=0)
    return found


def _final_miss(
    family: MissionFamily, states: Array, final_time: Array, settings: GainSettings
) -> Array:
    """Λ(t_f) of Eq. (2) over the acceptable misses, (c, 6, 3): altitude, longitude, latitude."""
    final = states[:, :, -1]
    model = family.flight_model()
    rates = equations_of_motion(model, final.T, np.zeros(len(final)), final_time)
    rate = np.stack(rates[:BANK], axis=1)
    miss = np.zeros((len(final), 6, 3))
    miss[:, :3] = np.eye(3)
    miss[:, 3] = -rate[:, :3] / rate[:, 3:4]
    radius = np.reshape(model.planet.equatorial_radius, (-1, 1))  # one, or one per case
    miss[:, :, 0] /= settings.altitude_error
    miss[:, :, 1] *= radius * np.cos(final[:, 2, None]) / settings.horizontal_miss
    miss[:, :, 2] *= radius / settings.horizontal_miss
    return miss


def _nodal_jacobians(family: MissionFamily, mesh: Mesh, states: Array, final_time: Array) -> Array:
    """(A_zz A_zσ)ᵀ at the nodes, (c, n, 7·6)."""
    jacobian = np.zeros((len(states), mesh.n_nodes, 42))
    fixed, free = mesh.node_time
    times = fixed + free * final_time[:, None]
    physics = Physics.of(family.flight_model(), NodeFunctions(), 1.0)
    function = node_dynamics(physics.structure, (1.0,) * states.shape[1]).jacobian
    x = np.ascontiguousarray(states.transpose(1, 0, 2))
    still = np.zeros((states.shape[1] - BANK, *times.shape))
    (found,) = function.together(x, still, times, physics.numbers)
    for (row, column), values in zip(function.nonzeros[0], found, strict=True):
        if row < BANK and column < N_STATES:
            jacobian[:, :, 6 * column + row] = values
    return jacobian
