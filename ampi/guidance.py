"""Guidance: the flight software behind one interface.

    guidance.begin(parameters)                                   at the entry interface
    command = guidance.step(time, navigation, sensed)            at every cycle

`step` is what the simulator, exported code and a loop of one's own call. It flies n flights at once, of
one clock; one flight is a batch of one, to the bit. It returns and never raises in flight: what is
unusual is told by the `health` of the command.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ampi.onboard.certificate import Certificate, Certifier
from ampi.onboard.clock import SHORTEST, CycleClock
from ampi.onboard.flown_references import FlownReferences
from ampi.onboard.health import Health, Steering
from ampi.onboard.plausibility import BANK, SANE, number, rows, vectors
from ampi.onboard.reference import Mode, Reference, ReferenceGenerator
from ampi.onboard.row_layout import N_STATES
from ampi.onboard.subspace import Order
from ampi.onboard.table import GuidanceTable
from ampi.tracking.bank_limiter import NEAR_INVERTED, BankLimits, bank_on_turn, limited_rate
from ampi.tracking.law import Told, TrackingLaw
from ampi.tracking.linear_quadratic import LinearQuadratic

Array = NDArray[np.float64]

N_NAVIGATED = N_STATES + 1  # the states and the bank rate
N_SENSED = 3
ENGINES = ("auto", "native", "numpy")
FASTEST = 2.0  # times the rate limit; a vehicle that is said to roll faster is told in another unit


@dataclass(frozen=True)
class Command:
    """For one cycle; numbers of one flight, or arrays (n,)."""

    bank_rate: Any  # rad/s, to be reached at the end of the cycle
    bank_angle: Any  # rad, there
    angle_of_attack: Any  # rad, to be added to the schedule's
    steering: Any  # Steering, by what; of n flights their numbers
    health: Any  # Health; of n flights their numbers


class Guidance:
    """Onboard guidance from a table, in one mode, of one vehicle.

    `limits` are the nominal vehicle's; `limit_axes` names those of them that are parameters, each with
    its place in p: they are then what was measured. `law` tracks the reference.

    It measures its cycle from the times that it is given (`ampi.onboard.clock`): `reset`, or the first
    command after a new reference whose time does not go on, begins a flight. `cycle` (s) is the nominal
    one, that of the first command. Where it is not stated the first command changes next to nothing, for
    nobody knows yet how long it will stand. `orders` are those of interpolation on each axis, where
    not all are the mode's.
    """

    def __init__(
        self,
        table: GuidanceTable,
        limits: BankLimits,
        mode: Mode | str = Mode.AMPI,
        *,
        law: TrackingLaw | None = None,
        cycle: float | None = None,
        limit_axes: Mapping[str, int] | None = None,
        mission_sha256: str | None = None,
        orders: Sequence[Order] | None = None,
        certifier: Certifier | None = None,
        engine: str = "auto",
    ) -> None:
        self.table, self.limits, self.mode = table, limits, Mode(mode)
        self.law: TrackingLaw = LinearQuadratic() if law is None else law
        self.limit_axes = dict(limit_axes or {})
        _check(table, limits, cycle, self.limit_axes, self.law)
        self.mission_sha256 = mission_sha256  # of the database's mission; None if made by hand
        self.engine = _engine(engine, self.law)
        self.orders = None if orders is None else tuple(orders)
        self.certifier = certifier  # None: nothing is known on board of vehicle and air
        self._generator = ReferenceGenerator(table, self.mode, self.orders)
        self._clock = CycleClock(cycle)
        self._allocate(1)

    def __reduce__(self) -> tuple[object, ...]:
        """Pickled as what it is made from; a worker allocates its own memory."""
        return _restored, (self._settings(),)

    @property
    def cycle(self) -> float:
        """The nominal cycle (s)."""
        return self._clock.nominal

    @property
    def first_cycle(self) -> tuple[float, float]:
        """Shortest and longest (s) that the first cycle may be."""
        return self._clock.first

    @property
    def flown(self) -> FlownReferences:
        """The references that are being flown."""
        return self._flown

    @property
    def tracked_states(self) -> Array:
        """States (7, n) of the references where the last command has looked them up."""
        return self._tracked

    def in_mode(self, mode: Mode | str) -> Guidance:
        """The same table flown in another mode."""
        return Guidance(**self._settings(mode=mode))

    def at_cycle(self, cycle: float) -> Guidance:
        """The same guidance for a loop of another nominal cycle (s)."""
        return Guidance(**self._settings(cycle=cycle))

    def on_engine(self, engine: str) -> Guidance:
        """The same computed by another engine: "native", "numpy", or "auto", native where it is."""
        return Guidance(**self._settings(engine=engine))

    def _settings(self, **changes: Any) -> dict[str, Any]:
        return {
            "table": self.table,
            "limits": self.limits,
            "mode": self.mode,
            "law": self.law,
            "cycle": self._clock.stated,
            "limit_axes": self.limit_axes,
            "mission_sha256": self.mission_sha256,
            "orders": self.orders,
            "certifier": self.certifier,
            "engine": self.engine,
            **changes,
        }

    def limits_at(self, parameters: ArrayLike) -> BankLimits:
        """Bank limits of a vehicle with parameters p (d,), or of n with p (n, d).

        A limit that is no positive number, a navigation fault, is the nominal one; one beyond its axis,
        in degrees perhaps, ends at the axis: no reference needs more.
        """
        if not self.limit_axes:
            return self.limits
        p = np.asarray(parameters, dtype=float)
        own = {}
        for name, i in self.limit_axes.items():
            told, nominal, most = p[..., i], getattr(self.limits, name), self.table.axes[i][-1]
            own[name] = np.where((told > 0.0) & (told < SANE), np.minimum(told, most), nominal)
        return replace(self.limits, **own)

    def reset(self) -> None:
        """Begin a new flight: the next command is the first, whatever its time."""
        self._clock.reset()
        self._forget()

    def _forget(self) -> None:
        """Nothing has been commanded yet."""
        n = len(self._flown)
        self._rate, self._bank, self._angle = np.full(n, np.nan), np.full(n, np.nan), np.zeros(n)
        self._memory = self.law.memory(n)

    def reference(self, parameters: ArrayLike) -> Reference:
        """Reference for the measured parameters p (d,) of the table (SI, rad), in its order.

        Its arrays belong to the guidance and are overwritten by the next call; keep a `copy`. It is not
        flown before `follow`.
        """
        self._clock.expect_begin()
        return self._generator.reference(parameters)

    def certificate(self, reference: Reference) -> Certificate:
        """Defect, predicted miss, margins and verdict of a reference, before it is flown.

        Raises
        ------
        ValueError
            If the guidance has no certifier.
        """
        if self.certifier is None:
            raise ValueError(
                "certificate: expected a guidance with a model of vehicle and air, got one without; "
                "ampi.onboard_model.certifier_of(mission, segments) says what it cannot hold"
            )
        return self.certifier.certificate(reference)

    def begin(self, parameters: ArrayLike) -> None:
        """Begin the flight of p (d,), or n flights of p (n, d), on references of their own.

        Memory is allocated here; `step` then wants the navigation of as many flights.
        """
        told = rows(parameters, len(self.table.axes))
        if len(told) != len(self._flown):
            self._allocate(len(told))
        for i, p in enumerate(told):
            self._flown.set(i, self.reference(p))
        self._flown.rewind()
        self._follow(told)
        self.reset()

    def follow(self, reference: Reference | Sequence[Reference]) -> None:
        """Fly these references from the next step on, one for each flight; the clock goes on."""
        given = [reference] if isinstance(reference, Reference) else list(reference)
        if len(given) != len(self._flown):
            self._allocate(len(given))
        for i, own in enumerate(given):
            self._flown.set(i, own)
        self._follow(np.array([own.parameters for own in given]))

    def _follow(self, parameters: Array) -> None:
        self._flown.look_up_by(self.law.along)
        self._own_limits = self.limits_at(parameters)

    def _allocate(self, n: int) -> None:
        self._flown = FlownReferences(n, self.table)
        self._tracked = np.full((N_STATES, n), np.nan)
        self._unfelt = np.full((N_SENSED, n), np.nan)
        self._as_tracked = np.full(n, int(Steering.TRACKED))
        self._own_limits = self.limits
        self._forget()

    def step(self, time: float, navigation: ArrayLike, sensed: ArrayLike | None = None) -> Command:
        """Commands of one guidance cycle. Never an exception: what is unusual is the `health`.

        Parameters
        ----------
        time
            Since the entry interface (s), of all flights.
        navigation
            (h, θ, φ, V, γ, ψ, σ, σ̇) in SI and rad: (8,) of one flight, (8, n) of n.
        sensed
            Specific force (m/s²) along the velocity, up and to the right of it: (3,) or (3, n); None
            where the law does not use it.
        """
        n = len(self._flown)
        with np.errstate(all="ignore"):  # of nonsense the health tells
            navigated, is_one = vectors(navigation, N_NAVIGATED, n)
            felt = self._unfelt if sensed is None else vectors(sensed, N_SENSED, n)[0]
            in_time = self._clock.advance(number(time))
            if self._clock.is_first:
                self._forget()
            told = Told(navigated[:N_STATES], felt, self._clock.expected)
            return self._steered(told, navigated[N_STATES], in_time=in_time, is_one=is_one)

    def _steered(self, told: Told, rate: Array, *, in_time: bool, is_one: bool) -> Command:
        """The command, once time and shapes are known."""
        at, ended, lost = self._look_up(told)
        layout, limits = self.table.layout, self._own_limits
        own, state = at[layout.bank_rate], told.state
        self._tracked = at[layout.states]
        plausible = self.table.envelope.holds(state)
        rolls = np.abs(rate) <= FASTEST * limits.rate
        health = self._flown.health.copy()
        bank = self._bank_angle(state[BANK].copy(), at[BANK])
        if not (plausible.all() and rolls.all()):
            known = (np.abs(state) < SANE).all(axis=0) & (np.abs(rate) < SANE)
            fault = np.where(known, Health.IMPLAUSIBLE_NAVIGATION, Health.BAD_NAVIGATION)
            health = np.where(plausible & rolls, health, fault)
            rate = np.where(rolls, rate, np.where(np.isnan(self._rate), own, self._rate))
            state[:] = np.where(plausible, state, at[layout.states])  # for the law's memory
        state[BANK] = bank
        asked, angle = self.law.command(at, told, self._memory)
        wanted, steering, held = asked, np.full(len(asked), int(Steering.TRACKED)), ended | lost
        if not plausible.all():
            wanted = np.where(plausible, asked, own)
            steering = np.where(plausible, steering, Steering.REFERENCE)
            angle = np.where(plausible, angle, self._angle)
        if not in_time:
            health = np.full(len(health), int(Health.BAD_TIME))
        if held.any():
            wanted = np.where(held, 0.0, wanted)
            health = np.where(ended, Health.AFTER_FINAL_TIME, health)
            steering = np.where(held, Steering.HELD, steering)
        clock = self._clock
        # The limits are of commands: from the measured rate, behind a lag of half a second at 10 Hz,
        # they would leave a fifth of the acceleration, and the bank angle would overshoot by 19°.
        last = np.where(np.isnan(self._rate), rate, self._rate)
        new = limited_rate(limits, bank, last, wanted, clock.longest, clock.shortest)
        self._rate, self._angle = new, angle
        self._bank = bank + 0.5 * (rate + new) * clock.expected
        return _command(new, self._bank, self._angle, steering, health, is_one=is_one)

    def _look_up(self, told: Told) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
        """Rows of the references (r, n) at this instant; which have ended; of which it is unknown."""
        end = self._flown.end
        value = self.law.now(self._clock.now, told)
        value = value + np.zeros(len(end))
        ended, lost = value >= end, np.isnan(value)
        if lost.any():
            value = np.where(lost, end, value)
        return self._flown.at(value), ended, lost

    def _bank_angle(self, told: Array, reference: Array) -> Array:
        """The bank angles (n,) on their turn; one that is lost is that of the last command."""
        known = np.abs(told) <= self.table.envelope.reach[BANK]
        if not known.all():
            told = np.where(known, told, np.where(np.isnan(self._bank), reference, self._bank))
        # otherwise all are on their turn, where it changes no bit
        if np.abs(told).max() > np.pi or np.max(self._own_limits.angle) > NEAR_INVERTED:
            told = bank_on_turn(self._own_limits, told, reference)
        return told


def _command(
    rate: Array,
    bank: Array,
    angle: Array,
    steering: NDArray[np.int64],
    health: NDArray[np.int64],
    *,
    is_one: bool,
) -> Command:
    if not is_one:
        return Command(rate, bank, angle, steering, health)
    return Command(
        float(rate[0]),
        float(bank[0]),
        float(angle[0]),
        Steering(int(steering[0])),
        Health(int(health[0])),
    )


def _check(
    table: Any, limits: Any, cycle: Any, limit_axes: dict[str, int], law: TrackingLaw
) -> None:
    """On the ground: what flies is what it should be."""
    if not isinstance(table, GuidanceTable):
        raise ValueError(f"table: expected a GuidanceTable, got {type(table).__name__}")
    if not isinstance(limits, BankLimits) or np.ndim(
        limits.angle + limits.rate + limits.acceleration
    ):
        raise ValueError(f"limits: expected the BankLimits of one vehicle, got {limits!r}")
    if cycle is not None and not SHORTEST <= number(cycle) < SANE:
        raise ValueError(f"cycle: expected at least {SHORTEST:g} s, got {cycle!r}")
    for name, i in limit_axes.items():
        if name not in ("angle", "rate", "acceleration") or i not in range(len(table.axes)):
            raise ValueError(
                f"limit_axes: expected angle, rate or acceleration and the number of an axis, 0 to "
                f"{len(table.axes) - 1}, got {name!r}: {i!r}"
            )
        if not table.axes[i][0] > 0.0:
            raise ValueError(f"limit_axes: {name}: expected an axis of positive numbers, axis {i}")
    if table.layout != law.layout:
        raise ValueError(
            f"law: expected a table with the rows of {law.name} "
            f"({', '.join(row.name for row in law.layout.rows)}), got "
            f"{', '.join(row.name for row in table.layout.rows)}; load the database for this law"
        )


def _engine(asked: str, law: TrackingLaw) -> str:
    if asked not in ENGINES:
        raise ValueError(f"engine: expected one of {', '.join(ENGINES)}, got {asked!r}")
    return "numpy"


def _restored(settings: dict[str, Any]) -> Guidance:
    return Guidance(**settings)
