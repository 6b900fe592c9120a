"""Tracking gains at every vertex: a Riccati sweep along each optimum.

The tracker steers the bank rate, δu = −K(t) δx with δx the seven-state error at equal time, and K
minimises along the optimum

    ½ δx_fᵀ S_f δx_f + ½ (1/t_f) ∫ (δu/u_r)² + (δσ/σ_r)² dt,                     (1)
    −Ṡ = AᵀS + SA + Q − S B R⁻¹ Bᵀ S,   S(t_f) = S_f,   K = R⁻¹ Bᵀ S.             (2)

Guided flight ends where the speed reaches its target, not at a time. A flight with errors δx at t_f
crosses that speed δt = −δV/V̇ later, so the error that counts is Π δx with

    Π = I − ẋ_f e_Vᵀ / V̇_f,   S_f = Πᵀ W Π,                                      (3)

W weighing position and altitude there. There is no running weight on position: the reference between
entry and target is a means, and an interpolated one is not quite a flight; holding on to it would pass
its defects on to the target.

The sweep is an exact discrete-time recursion on a fine grid that contains the nodes, with zero-order
hold in u over steps of at most `STEP` seconds. Cases of about equal final time share one grid and are
swept at once; the grid depends on the case alone, so its gains do not depend on its company.

References
----------
Bryson & Ho (1975), Chapter 5 (terminal controllers with free final time: Section 5.5).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ampi.missions.family import MissionFamily
from ampi.physics.equations_of_motion import FlightModel, equations_of_motion
from ampi.pseudospectral.lagrange import interpolation_matrix
from ampi.pseudospectral.mesh import Mesh, Segment
from ampi.scp.derivatives import trace
from ampi.scp.node_functions import NodeFunctions
from ampi.scp.vectorised import VectorisedFunction

Array = NDArray[np.float64]

STEP = 0.75  # s
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


def vertex_gains(
    family: MissionFamily, mesh: Mesh, states: Array, final_time: Array, settings: GainSettings
) -> Array:
    """K at the nodes, (c, 7, n), of trajectories `states` (c, 7, n), `final_time` (c,).

    Row i multiplies the error of state i (SI, rad); the command is u_ref − K · δx (rad/s).
    """
    gains = np.zeros((len(states), 7, mesh.n_nodes))
    horizon = HORIZON * np.ceil(final_time / HORIZON)
    for longest in np.unique(horizon):
        part = np.flatnonzero(horizon == longest)
        alike = MissionFamily(tuple(family.missions[i] for i in part))
        fine = [_fine_grid(s, float(longest)) for s in mesh.segments]
        gains[part] = _sweep(alike, mesh, fine, states[part], final_time[part], settings)
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
) -> Array:
    """Eq. (2) backwards over the fine grids of the segments."""
    n = mesh.n_nodes
    gains = np.zeros((len(states), 7, n))
    cost = _terminal_cost(family, states, final_time, settings)
    rate_weight = 1.0 / (settings.bank_rate**2 * final_time)
    bank_weight = 1.0 / (settings.bank_deviation**2 * final_time)
    nodal = _nodal_jacobians(family, mesh, states, final_time)
    for s, tau in zip(reversed(mesh.segments), reversed(fine), strict=True):
        # along a segment A is as smooth as the states: its values at the nodes give it everywhere
        matrix = interpolation_matrix(s.rule.nodes, s.rule.barycentric, tau)
        jacobian = (matrix @ nodal[:, s.nodes]).reshape(len(states), -1, 7, 7)
        half = s.half_length[0] + s.half_length[1] * final_time
        times = half[:, None] * tau
        on_node = np.searchsorted(tau, s.rule.nodes)
        node_at = {int(k): s.nodes.start + j for j, k in enumerate(on_node)}
        if s.nodes.stop == n:
            gains[:, :, n - 1] = cost[:, 6, :] / rate_weight[:, None]
        for k in reversed(range(len(tau) - 1)):
            dt = times[:, k + 1] - times[:, k]
            gain, cost = _riccati_step(
                0.5 * (jacobian[:, k] + jacobian[:, k + 1]), dt, cost, rate_weight, bank_weight
            )
            if k in node_at:
                gains[:, :, node_at[k]] = gain
    return gains


def _terminal_cost(
    family: MissionFamily, states: Array, final_time: Array, settings: GainSettings
) -> Array:
    """S_f of Eq. (3), (c, 7, 7)."""
    final = states[:, :, -1]
    no_rate = np.zeros(len(final))
    model = family.flight_model()
    rate = np.stack(equations_of_motion(model, final.T, no_rate, final_time), axis=1)
    project = np.tile(np.eye(7), (len(final), 1, 1))
    project[:, :, 3] -= rate / rate[:, 3:4]
    radius = model.planet.equatorial_radius
    weight = np.zeros((len(final), 7))
    weight[:, 0] = 1.0 / settings.altitude_error**2
    weight[:, 1] = (radius * np.cos(final[:, 2]) / settings.horizontal_miss) ** 2
    weight[:, 2] = (radius / settings.horizontal_miss) ** 2
    return project.transpose(0, 2, 1) @ (weight[:, :, None] * project)


def _nodal_jacobians(family: MissionFamily, mesh: Mesh, states: Array, final_time: Array) -> Array:
    """A at the nodes, (c, n, 49)."""
    jacobian = np.zeros((len(states), mesh.n_nodes, 49))
    fixed, free = mesh.node_time
    times = fixed + free * final_time[:, None]
    cases: dict[FlightModel, list[int]] = {}  # a model is traced once, then serves all its cases
    for case, mission in enumerate(family.missions):
        cases.setdefault(mission.flight_model, []).append(case)
    for model, alike in cases.items():
        function = _traced_jacobian(model)
        x = states[alike].transpose(1, 0, 2).reshape(7, -1)
        t = times[alike].reshape(1, -1)
        found = function(x, np.zeros_like(t), t)[0]
        for (row, column), values in zip(function.nonzeros[0], found, strict=True):
            jacobian[alike, :, 7 * row + column] = values.reshape(len(alike), -1)
    return jacobian


@lru_cache(maxsize=16)
def _traced_jacobian(model: FlightModel) -> VectorisedFunction:
    traced = trace(model, NodeFunctions(), (1.0,) * 7, 1.0)
    return VectorisedFunction([traced.x, traced.u, traced.t], [traced.jacobian])


def _riccati_step(
    a: Array, dt: Array, cost: Array, rate_weight: Array, bank_weight: Array
) -> tuple[Array, Array]:
    """One backward step of the discrete recursion: (K, S) at the step's begin."""
    h = dt[:, None, None]
    squared = a @ a
    transition = np.eye(7) + h * a + 0.5 * h**2 * squared + h**3 / 6.0 * (squared @ a)
    # ∫ e^{A s} B ds with B = e_σ: the last column of h (I + hA/2 + h²A²/6)
    column = (h * np.eye(7) + 0.5 * h**2 * a + h**3 / 6.0 * squared)[:, :, 6]
    weighted = np.einsum("cij,cj->ci", cost, column)
    denominator = rate_weight * dt + np.einsum("ci,ci->c", column, weighted)
    cross = np.einsum("ci,cij->cj", weighted, transition)
    gain = cross / denominator[:, None]
    cost = transition.transpose(0, 2, 1) @ cost @ transition
    cost -= cross[:, :, None] * gain[:, None, :]
    cost[:, 6, 6] += bank_weight * dt
    return gain, 0.5 * (cost + cost.transpose(0, 2, 1))
