"""What no section of a mission can tell alone: whether they fit together."""

from __future__ import annotations

from collections.abc import Iterator

from ampi.missions import units as u
from ampi.missions.flight_sections import EntrySection, TargetSection
from ampi.missions.sections import MissionSections
from ampi.physics.angles import on_turn_of
from ampi.physics.path_constraints import no_fly_zone, path_constraints
from ampi.physics.planet import great_circle_distance
from ampi.physics.state import ANGLE_OF_ATTACK, LOADS

LATE = 1e4  # s: after any angle-of-attack manoeuvre


def disagreements(mission: MissionSections) -> list[str]:
    """A sentence for each, of the sections that `mission` has."""
    found: list[str] = []
    for sections, check in (
        ("vehicle", _vehicle_stands),
        ("vehicle angle_of_attack entry", _angle_of_attack_is_told_once),
        ("vehicle angle_of_attack", _coefficients_cover_the_angles),
        ("planet atmosphere", _air_stands),
        ("atmosphere entry", _air_reaches_the_entry),
        ("mesh", _mesh_stands),
        ("entry target", _flight_slows_down),
        ("planet atmosphere vehicle limits entry", _entry_keeps_limits),
        ("planet atmosphere vehicle limits target", _target_keeps_limits),
        ("planet limits entry target no_fly_zone", _zones_are_clear),
        ("vehicle limits", _lift_keeps_its_sign),
        ("limits guess", _guess_keeps_its_limit),
        ("limits entry", _entry_turns_within_its_limits),
    ):
        if not all(hasattr(mission, name) for name in sections.split()):
            continue
        try:
            found += check(mission)
        except ValueError as error:
            found.append(str(error))
    return list(dict.fromkeys(found))


def another_structure(mission: MissionSections, there: MissionSections) -> list[str]:
    """A sentence where the numbers of `there` make another model than those of `mission`."""
    schedules = [m.vehicle.angle_of_attack for m in (mission, there)]
    here, moved = (0.0 if schedule is None else schedule.smoothing for schedule in schedules)
    if (here > 0.0) == (moved > 0.0):
        return []
    return [
        f"smoothing: expected a positive number at every point or 0 at every point, got {moved:g} "
        f"beside {here:g}; a schedule with kinks is another model: build each by itself"
    ]


def _vehicle_stands(mission: MissionSections) -> Iterator[str]:
    mission.vehicle.build()
    yield from ()


def _air_stands(mission: MissionSections) -> Iterator[str]:
    mission.atmosphere.build(mission.planet.build().surface_gravity)
    yield from ()


def _air_reaches_the_entry(mission: MissionSections) -> Iterator[str]:
    altitudes, entry = mission.atmosphere.altitude, mission.entry.altitude
    if altitudes and altitudes[-1] < entry:
        yield (
            f"atmosphere.altitude: expected a table that reaches entry.altitude ({entry / 1e3:.6g} km), "
            f"got one that ends at {altitudes[-1] / 1e3:.6g} km"
        )


def _mesh_stands(mission: MissionSections) -> Iterator[str]:
    _ = mission.mesh.build().segments
    yield from ()


def _angle_of_attack_is_told_once(mission: MissionSections) -> Iterator[str]:
    schedule, control, entry = (
        mission.vehicle.angle_of_attack,
        mission.angle_of_attack,
        mission.entry,
    )
    if schedule is not None and control is not None:
        yield (
            "angle_of_attack: expected a schedule ([vehicle.angle_of_attack]) or a control "
            "([angle_of_attack]), got both; remove one of them"
        )
    if schedule is None and control is None:
        yield (
            "vehicle.angle_of_attack: expected a schedule ([vehicle.angle_of_attack]) or a control "
            "([angle_of_attack]), got neither"
        )
    for name in ("angle_of_attack", "angle_of_attack_rate"):
        if control is None and getattr(entry, name) is not None:
            yield (
                f"entry.{name}: expected nothing, for the angle of attack follows a schedule; "
                "[angle_of_attack] makes it a control"
            )
    if control is None:
        return
    low, high, rate = min(control.lower), max(control.upper), entry.angle_of_attack_rate
    if entry.angle_of_attack is not None and not low <= entry.angle_of_attack <= high:
        yield (
            f"entry.angle_of_attack: expected {low / u.DEGREE:.4g}° to {high / u.DEGREE:.4g}°, the "
            f"bounds of [angle_of_attack], got {entry.angle_of_attack / u.DEGREE:.4g}°"
        )
    if rate is not None and abs(rate) > control.rate:
        yield (
            f"entry.angle_of_attack_rate: expected at most angle_of_attack.rate "
            f"({control.rate / u.DEGREE:.4g}°/s) in size, got {rate / u.DEGREE:.4g}°/s"
        )


def _coefficients_cover_the_angles(mission: MissionSections) -> Iterator[str]:
    control, aerodynamics = mission.angle_of_attack, mission.vehicle.aerodynamics
    if control is None or aerodynamics.model != "table":
        return
    first, last = aerodynamics.angle_of_attack[0], aerodynamics.angle_of_attack[-1]
    low, high = min(control.lower), max(control.upper)
    if low < first or high > last:
        yield (
            f"angle_of_attack: expected bounds within vehicle.aerodynamics.angle_of_attack "
            f"({first / u.DEGREE:.4g}° to {last / u.DEGREE:.4g}°), got {low / u.DEGREE:.4g}° to "
            f"{high / u.DEGREE:.4g}°; widen the table or narrow the bounds"
        )


def _flight_slows_down(mission: MissionSections) -> Iterator[str]:
    if mission.target.speed >= mission.entry.speed:
        yield (
            f"target.speed ({mission.target.speed:g} m/s) must be below entry.speed "
            f"({mission.entry.speed:g} m/s)"
        )


def _entry_keeps_limits(mission: MissionSections) -> Iterator[str]:
    state = [*mission.entry_state, 0.0, *_gentlest_angle(mission, mission.entry.angle_of_attack)]
    yield from _limits_exceeded_at(mission, "entry", state, 0.0)


def _gentlest_angle(mission: MissionSections, given: float | None = None) -> list[float]:
    """Where it is a control, the angle of attack `given`, else that of those allowed nearest to zero."""
    control = getattr(mission, "angle_of_attack", None)
    if control is None or mission.vehicle.angle_of_attack is not None:
        return []
    nearest = min(max(0.0, min(control.lower)), max(control.upper))
    return [nearest if given is None else given]


def _target_keeps_limits(mission: MissionSections) -> Iterator[str]:
    limits, target, model = mission.limits, mission.target, mission.flight_model
    at_target = [target.altitude, 0.0, 0.0, target.speed, 0.0, 0.0, 0.0, *_gentlest_angle(mission)]
    yield from _limits_exceeded_at(mission, "target", at_target, LATE)
    floor, below = limits.drag_floor, limits.drag_floor_speed
    if floor is None or below is None or target.speed > below:
        return
    if mission.angle_of_attack is not None:
        at_target[ANGLE_OF_ATTACK] = max(mission.angle_of_attack.upper)
    air = model.air_loads(at_target, LATE)
    drag, unit = (
        float(air.drag) / model.planet.load_factor_gravity,
        model.planet.load_factor_unit,
    )
    margin = limits.drag_floor_margin
    if not drag >= floor * (1.0 + margin):
        less = f" and a margin of {100.0 * margin:g} %" if margin else ""
        yield (
            f"limits.drag_floor: expected at most {drag:.4g} {unit}, the drag at the target; got "
            f"{floor:.4g}{less}; lower the floor or change the target"
        )


def _limits_exceeded_at(
    mission: MissionSections, place: str, state: list[float], time: float
) -> Iterator[str]:
    model = mission.flight_model
    printed = (("kPa", 1e-3), ("MW/m²", 1e-6), (model.planet.load_factor_unit, 1.0))
    values = path_constraints(model, state, time)
    for name, (unit, per_si), value in zip(LOADS, printed, values, strict=True):
        if not value <= mission.limits.designed(name):  # NaN too
            margin, limit = getattr(mission.limits, f"{name}_margin"), getattr(mission.limits, name)
            less = f" less its margin of {100.0 * margin:g} %" if margin else ""
            yield (
                f"limits.{name}: expected at least {float(value) * per_si:.4g} {unit}, its value at "
                f"the {place}; got {limit * per_si:.4g}{less}; raise the limit or change the {place}"
            )


def _zones_are_clear(mission: MissionSections) -> Iterator[str]:
    sphere = mission.planet.build().equatorial_radius
    ends: list[tuple[str, EntrySection | TargetSection]] = [("entry", mission.entry)]
    if mission.target.position == "fixed":
        ends.append(("target", mission.target))
    for number, zone in enumerate(mission.no_fly_zone, start=1):
        for place, end in ends:
            centre = (zone.longitude, zone.latitude)
            away = great_circle_distance(end.longitude, end.latitude, *centre, sphere)
            here = no_fly_zone(end.longitude, end.latitude, (*centre, zone.radius / sphere))
            if away < zone.radius or here > mission.limits.share("no_fly_zone"):
                yield (
                    f"no_fly_zone {number}: expected the {place} outside the zone, got it "
                    f"{away / 1e3:.0f} km from the centre of a zone of "
                    f"{zone.radius / 1e3:.0f} km{' and its margin' if away >= zone.radius else ''}; "
                    f"move the zone or the {place}"
                )


def _entry_turns_within_its_limits(mission: MissionSections) -> Iterator[str]:
    entry, limits = mission.entry, mission.limits
    bank_angle = 0.0 if entry.bank_angle is None else on_turn_of(entry.bank_angle, 0.0)
    for name, value, limit in (
        ("bank_angle", bank_angle, limits.bank_angle),
        ("bank_rate", entry.bank_rate or 0.0, limits.bank_rate),
    ):
        if abs(value) > limit:
            yield (
                f"entry.{name}: expected at most limits.{name} ({limit / u.DEGREE:.4g} in degrees) in "
                f"size, got {value / u.DEGREE:.4g}"
            )


def _lift_keeps_its_sign(mission: MissionSections) -> Iterator[str]:
    schedule, change = mission.vehicle.angle_of_attack, mission.limits.angle_of_attack_change
    if change is None or schedule is None:
        return
    least = min(schedule.start_angle, schedule.end_angle)
    if change >= least:
        yield (
            "limits.angle_of_attack_change: expected less than the least angle of attack scheduled "
            f"({least / u.DEGREE:.4g}°), got {change / u.DEGREE:.4g}°"
        )


def _guess_keeps_its_limit(mission: MissionSections) -> Iterator[str]:
    bank_angle = 0.0 if mission.guess is None else on_turn_of(mission.guess.bank_angle, 0.0)
    if abs(bank_angle) > mission.limits.bank_angle:
        yield (
            f"guess.bank_angle: expected at most limits.bank_angle "
            f"({mission.limits.bank_angle / u.DEGREE:.4g}°) in size, "
            f"got {bank_angle / u.DEGREE:.4g}°"
        )
