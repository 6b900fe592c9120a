"""From a database file to the guidance that flies it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ampi.correction.onboard_correction import Correction
from ampi.dataset import DatasetError, TrajectoryDataset, read_dataset
from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.onboard.certificate import Certifier
from ampi.onboard.reference import Mode, order_of
from ampi.onboard.row_layout import RowKind, RowLayout
from ampi.onboard.segments import Segments
from ampi.onboard.subspace import Order
from ampi.onboard.table import GuidanceTable, nearest_solved
from ampi.onboard_model import certifier_of, correction_of
from ampi.physics.state import N_STATES
from ampi.pseudospectral.mesh import Mesh
from ampi.table_sensitivities import loads, steered_gains, table_sensitivities
from ampi.tracking.angle_limiter import ANY_ANGLE, AngleRange, ModulationLimits
from ampi.tracking.bank_limiter import BankLimits
from ampi.tracking.drag_shuttle import DragShuttle
from ampi.tracking.drag_sliding_mode import DragSlidingMode
from ampi.tracking.law import TrackingLaw
from ampi.tracking.linear_quadratic import LinearQuadratic

Array = NDArray[np.float64]
Holes = Literal["refuse", "fly"]
HOLES: tuple[Holes, ...] = get_args(Holes)
CORRECTIONS = ("none", "bank", "bank_and_angle")


def law_of(law: TrackingLaw | str, mission: Mission, modulate: bool = False) -> TrackingLaw:
    """A law by its name, of the mission's planet; one that is a law already comes back.

    With `modulate` it asks for changes of the angle of attack as well.

    Raises
    ------
    ValueError
        If there is no law of that name.
    """
    if not isinstance(law, str):
        return law
    if law not in LAWS:
        raise ValueError(f"law: expected a tracking law or one of {', '.join(LAWS)}, got {law!r}")
    return LAWS[law](mission, modulate)


def _linear_quadratic(mission: Mission, modulate: bool) -> TrackingLaw:
    return LinearQuadratic(modulates=modulate)


def _drag_sliding_mode(mission: Mission, modulate: bool) -> TrackingLaw:
    planet = mission.flight_model.planet
    return DragSlidingMode(
        gravitational_parameter=planet.gravitational_parameter,
        radius=planet.equatorial_radius,
        modulates=modulate,
    )


def _drag_shuttle(mission: Mission, modulate: bool) -> TrackingLaw:
    planet = mission.flight_model.planet
    return DragShuttle(
        gravitational_parameter=planet.gravitational_parameter,
        radius=planet.equatorial_radius,
        modulates=modulate,
    )


LAWS: dict[str, Callable[[Mission, bool], TrackingLaw]] = {
    "linear_quadratic": _linear_quadratic,
    "drag_sliding_mode": _drag_sliding_mode,
    "drag_shuttle": _drag_shuttle,
}


def guidance_table(
    dataset: TrajectoryDataset,
    holes: Holes = "refuse",
    law: TrackingLaw | str = "linear_quadratic",
) -> GuidanceTable:
    """Pack what a law flies by, of every case of a database, into the table that flies.

    With `holes="fly"` a case without solution takes the rows of the nearest one that has one, and the
    table says so. Where the file holds sensitivities, so does the table.

    Raises
    ------
    DatasetError
        If a case has no solution and the table was not asked to fly all the same; or if none has one.
    """
    if holes not in HOLES:
        raise ValueError(f"holes: expected {' or '.join(HOLES)}, got {holes!r}")
    solved = dataset.solved
    missing = np.flatnonzero(~solved.ravel())
    if len(missing) and (holes == "refuse" or not solved.any()):
        first = int(missing[0])
        told = (
            dataset.message.ravel()[first].decode("utf-8", "replace").split("; ")
        )  # every attempt
        raise DatasetError(
            f"{len(missing)} of {solved.size} cases have no solution, the first is case "
            f"{first}: {told[0].rstrip('.')}. A table with holes cannot fly unless it is asked to "
            "(holes='fly', --holes fly); or leave them out with: ampi crop"
        )
    layout = law_of(law, dataset.mission).layout
    if dataset.mission.n_states > N_STATES:
        layout = layout.with_angle_of_attack
    rows = layout.stacked(_parts(dataset, layout))
    final_time = dataset.final_time
    if len(missing):
        nearest = nearest_solved(dataset.axes, solved).ravel()
        cases = rows.reshape(-1, *rows.shape[-2:])
        cases[missing] = cases[nearest[missing]]
        final_time = final_time.ravel()[nearest].reshape(final_time.shape)
    nominal = dataset.mission.nominal_parameters
    return GuidanceTable(
        axes=dataset.axes,
        values=rows,
        final_time=final_time,
        segments=segments_of(dataset.mission.pseudospectral_mesh),
        conversion=dataset.conversion,
        high_density_time=(dataset.high_density_time[0], dataset.high_density_time[1]),
        centre=tuple(
            int(np.argmin(np.abs(axis - x))) for axis, x in zip(dataset.axes, nominal, strict=True)
        ),
        solved=solved if len(missing) else None,
        circular=tuple(i for i, p in enumerate(dataset.mission.parameters) if p.number.is_circular),
        layout=layout,
        sensitivities=table_sensitivities(dataset, layout, rows, final_time),
    )


def segments_of(mesh: Mesh) -> Segments:
    """The polynomials of a mesh as what flies reads them."""
    return Segments.of(
        [segment.rule.nodes for segment in mesh.segments],
        [segment.start for segment in mesh.segments],
        [segment.half_length for segment in mesh.segments],
    )


def _parts(dataset: TrajectoryDataset, layout: RowLayout) -> dict[RowKind, Array]:
    """Rows (p…, r, n) of each kind that the layout has: those of the file, and those of the physics."""
    kinds = {row.kind for row in layout.rows}
    parts = {
        RowKind.STATE: dataset.states[..., :N_STATES, :],
        RowKind.CONTROL: dataset.bank_rate[..., None, :],
        RowKind.ANGLE: dataset.states[..., N_STATES:, :],
    }
    if RowKind.ANGLE_GAIN in kinds:
        parts[RowKind.GAIN], parts[RowKind.ANGLE_GAIN] = steered_gains(dataset)
    elif RowKind.GAIN in kinds:
        parts[RowKind.GAIN] = dataset.gains
    if RowKind.LOAD in kinds:
        parts[RowKind.LOAD] = loads(dataset)
    return parts


def load_guidance(
    path: str | Path,
    *,
    mode: Mode | str = Mode.AMPI,
    holes: Holes = "refuse",
    cycle: float | None = None,
    law: TrackingLaw | str = "linear_quadratic",
    modulate: bool = False,
    orders: Mapping[str, Order | str] | None = None,
    correction: Correction | str = "none",
    engine: str = "auto",
) -> Guidance:
    """Guidance from a database file, checked: schema version, checksums, completeness.

    Parameters
    ----------
    path
        File made by `database.build`.
    mode
        Name of a `Mode`; "ampi" is the paper's.
    holes
        Of a database in which cases have no solution: "refuse" it, or "fly" it, with references flagged
        where they need such a case (`Reference.hole`).
    cycle
        Nominal guidance cycle (s). Guidance measures its own; this one is that of the first command,
        which changes next to nothing if none is stated. Simulated flights take 0.5 s then.
    law
        What tracks the reference: "linear_quadratic" (default), "drag_sliding_mode" or "drag_shuttle",
        with the gains that they come with; or a law with gains of one's own.
    modulate
        Whether a law that is given by its name changes the angle of attack, too, within the limits of
        the mission (limits.angle_of_attack_change, …_rate, …_acceleration).
    orders
        Orders of interpolation by the names of parameters, {"speed": "quadratic"}; all others are
        the mode's.
    correction
        What corrects the plan in flight: "none", the reference is tracked; "bank"; "bank_and_angle",
        with the angle of attack as far as the mission allows; or one with settings of one's own,
        from `ampi.onboard_model.correction_of`.
    engine
        What computes: "native", "numpy", or "auto", native where it is built.

    Raises
    ------
    DatasetError
        If the file cannot be trusted; the message says why and what to do.
    """
    return guidance_of(
        read_dataset(path),
        mode=mode,
        holes=holes,
        cycle=cycle,
        law=law,
        modulate=modulate,
        orders=orders,
        correction=correction,
        engine=engine,
    )


def guidance_of(
    dataset: TrajectoryDataset,
    *,
    mode: Mode | str = Mode.AMPI,
    holes: Holes = "refuse",
    cycle: float | None = None,
    law: TrackingLaw | str = "linear_quadratic",
    modulate: bool = False,
    orders: Mapping[str, Order | str] | None = None,
    correction: Correction | str = "none",
    engine: str = "auto",
) -> Guidance:
    """The same from a database that has been read."""
    limits, names = dataset.mission.limits, dataset.names
    tracker = law_of(law, dataset.mission, modulate)
    modulation = modulation_limits(dataset.mission)
    if tracker.modulates and modulation is None:
        raise ValueError(
            f"modulate: expected False, for {dataset.mission.name} does not say by how much its angle "
            "of attack may change (limits.angle_of_attack_change_deg), got True"
        )
    table = guidance_table(dataset, holes, tracker)
    return Guidance(
        table,
        BankLimits(limits.bank_angle, limits.bank_rate, limits.bank_acceleration),
        mode,
        law=tracker,
        modulation=modulation,
        angles=_angles(dataset.mission),
        cycle=cycle,
        limit_axes={
            limit: names.index(f"limits.bank_{limit}")
            for limit in ("angle", "rate", "acceleration")
            if f"limits.bank_{limit}" in names
        },
        mission_sha256=dataset.mission.digest,
        orders=_orders(names, Mode(mode), orders),
        certifier=_certifier(dataset.mission, table),
        correction=_correction(dataset.mission, correction),
        engine=engine,
    )


def modulation_limits(mission: Mission) -> ModulationLimits | None:
    """Those of the change of the angle of attack; None where the mission allows none."""
    limits = mission.limits
    if limits.angle_of_attack_change is None or limits.angle_of_attack_rate is None:
        return None
    return ModulationLimits(
        limits.angle_of_attack_change,
        limits.angle_of_attack_rate,
        limits.angle_of_attack_acceleration,
    )


def _angles(mission: Mission) -> AngleRange:
    """Where a vehicle that steers its angle of attack may; of bounds that vary, the widest."""
    control = mission.angle_of_attack
    if control is None:
        return ANY_ANGLE
    return AngleRange(min(control.lower), max(control.upper), control.rate)


def _correction(mission: Mission, given: Correction | str) -> Correction | None:
    if isinstance(given, Correction):
        return given
    if given not in CORRECTIONS:
        raise ValueError(f"correction: expected one of {', '.join(CORRECTIONS)}, got {given!r}")
    if given == "bank_and_angle" and mission.limits.angle_of_attack_change is None:
        raise ValueError(
            f"correction: expected bank, for {mission.name} does not say by how much its angle of "
            "attack may change (limits.angle_of_attack_change_deg), got bank_and_angle"
        )
    if given == "none":
        return None
    return correction_of(mission, angle_of_attack=given == "bank_and_angle")


def _orders(
    names: Sequence[str], mode: Mode, given: Mapping[str, Order | str] | None
) -> tuple[Order, ...] | None:
    if given is None:
        return None
    for name in given:
        if name not in names:
            raise ValueError(
                f"orders: expected parameters of the database ({', '.join(names)}), got {name!r}"
            )
    return tuple(Order(given.get(name, order_of(mode))) for name in names)


def _certifier(mission: Mission, table: GuidanceTable) -> Certifier | None:
    """None where the grid moves what the model on board holds fixed."""
    try:
        return certifier_of(mission, table.segments)
    except ValueError:
        return None
