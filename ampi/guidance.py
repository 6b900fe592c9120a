"""Guidance: the flight software behind one interface.

    guidance.begin(parameters)                                   at the entry interface
    command = guidance.step(time, navigation, sensed)            at every cycle

`step` is what the simulator, exported code and a loop of one's own call. It flies n flights at once, of
one clock; one flight is a batch of one, to the bit. It returns and never raises in flight: what is
unusual is told by the `health` of the command.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ampi._native.engine import core
from ampi.compiled_cycle import CompiledCycle, why_not_compiled
from ampi.correction.corrected_cycle import CorrectedCycle
from ampi.correction.onboard_correction import Correction
from ampi.correction.state import CorrectionState
from ampi.export.blob import Kind, table_blob
from ampi.export.model_blob import model_blob
from ampi.guidance_cycle import GuidanceCycle
from ampi.onboard.certificate import Certificate, Certifier
from ampi.onboard.clock import NOMINAL_CYCLE, SHORTEST
from ampi.onboard.command import Command
from ampi.onboard.flown_references import FlownReferences
from ampi.onboard.plausibility import SANE, number, rows, vectors
from ampi.onboard.reference import Mode, Reference, ReferenceGenerator
from ampi.onboard.row_layout import N_STATES
from ampi.onboard.subspace import Order
from ampi.onboard.table import GuidanceTable
from ampi.tracking.angle_limiter import ANY_ANGLE, AngleRange, ModulationLimits
from ampi.tracking.bank_limiter import BankLimits
from ampi.tracking.law import TrackingLaw
from ampi.tracking.linear_quadratic import LinearQuadratic

Array = NDArray[np.float64]

N_NAVIGATED = N_STATES + 1  # the states and the bank rate
N_SENSED = 3
N_TARGETS = 4
NATIVE, NUMPY = "native", "numpy"
ENGINES = ("auto", NATIVE, NUMPY)


class Guidance:
    """Onboard guidance from a table, in one mode, of one vehicle.

    `limits` are the nominal vehicle's; `limit_axes` names those of them that are parameters, each with
    its place in p: they are then what was measured. `law` tracks the reference; `modulation` limits the
    change of the angle of attack that it, or a plan, may ask for. `angles` is where the
    angle of attack of a vehicle without a schedule may be.

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
        modulation: ModulationLimits | None = None,
        angles: AngleRange = ANY_ANGLE,
        cycle: float | None = None,
        limit_axes: Mapping[str, int] | None = None,
        mission_sha256: str | None = None,
        orders: Sequence[Order] | None = None,
        certifier: Certifier | None = None,
        correction: Correction | None = None,
        engine: str = "auto",
    ) -> None:
        self.table, self.limits, self.mode = table, limits, Mode(mode)
        self.law: TrackingLaw = LinearQuadratic() if law is None else law
        self.modulation = modulation  # None: it flies by bank alone
        self.angles = angles
        self.limit_axes = dict(limit_axes or {})
        _check(table, limits, cycle, self.limit_axes, self.law)
        self.mission_sha256 = mission_sha256  # of the database's mission; None if made by hand
        self.orders = None if orders is None else tuple(orders)
        self.correction = correction  # None: the reference is tracked, and no plan corrected
        if self.modulates and modulation is None:
            raise ValueError(
                "modulation: expected limits of the change of the angle of attack, which the law or "
                "the corrector asks for, got None"
            )
        self.certifier = certifier  # None: nothing is known on board of vehicle and air
        self._generator = ReferenceGenerator(table, self.mode, self.orders)
        self._asked_engine, self.engine = engine, self._engine(engine)
        self._stated_cycle = cycle
        self._allocate(1)

    def __reduce__(self) -> tuple[object, ...]:
        """Pickled as what it is made from; a worker allocates its own memory, on the same engine."""
        return _restored, (self._settings(engine=self.engine),)

    @property
    def cycle(self) -> float:
        """The nominal cycle (s)."""
        return NOMINAL_CYCLE if self._stated_cycle is None else float(self._stated_cycle)

    @property
    def flown(self) -> FlownReferences:
        """The references that are being flown."""
        return self._flown

    @property
    def tracked_states(self) -> Array:
        """States (7, n) of the references where the last command has looked them up."""
        tracked: Array = self._cycle.tracked[self.table.layout.states]
        return tracked

    def in_mode(self, mode: Mode | str) -> Guidance:
        """The same table flown in another mode."""
        return Guidance(**self._settings(mode=mode))

    def at_cycle(self, cycle: float) -> Guidance:
        """The same guidance for a loop of another nominal cycle (s)."""
        return Guidance(**self._settings(cycle=cycle))

    def on_engine(self, engine: str) -> Guidance:
        """The same computed by another engine: "native", "numpy", or "auto", native where it is."""
        return Guidance(**self._settings(engine=engine))

    def blob(self, kind: Kind = "float64", about: str = "") -> bytes:
        """All that flies, as the flight code in C opens it (`ampi.export.blob.table_blob`)."""
        return table_blob(
            self.table,
            self.law,
            self.limits,
            modulation=self.modulation if self.modulates else None,
            angles=self.angles,
            mode=self.mode,
            orders=self.orders,
            limit_axes=self.limit_axes,
            cycle=self._stated_cycle,
            kind=kind,
            about=about,
        )

    def _settings(self, **changes: Any) -> dict[str, Any]:
        return {
            "table": self.table,
            "limits": self.limits,
            "mode": self.mode,
            "law": self.law,
            "modulation": self.modulation,
            "angles": self.angles,
            "cycle": self._stated_cycle,
            "limit_axes": self.limit_axes,
            "mission_sha256": self.mission_sha256,
            "orders": self.orders,
            "certifier": self.certifier,
            "correction": self.correction,
            "engine": self._asked_engine,
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
        self._cycle.reset()

    def reference(self, parameters: ArrayLike) -> Reference:
        """Reference for the measured parameters p (d,) of the table (SI, rad), in its order.

        Its arrays belong to the guidance and are overwritten by the next call; keep a `copy`. It is not
        flown before `follow`.
        """
        self._cycle.expect_begin()
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
        if isinstance(self._cycle, CompiledCycle):
            self._cycle.begin(told)
            return
        for i, p in enumerate(told):
            self._flown.set(i, self._generator.nodal(p))
        self._flown.rewind()
        self._follow(told)
        self._cycle.begin(told)

    def follow(self, reference: Reference | Sequence[Reference]) -> None:
        """Fly these references from the next step on, one for each flight; the clock goes on."""
        given = [reference] if isinstance(reference, Reference) else list(reference)
        if len(given) != len(self._flown):
            self._allocate(len(given))
        for i, own in enumerate(given):
            self._flown.set(i, own)
        self._follow(np.array([own.parameters for own in given]))

    def _follow(self, parameters: Array) -> None:
        self._cycle.follow(parameters, self.limits_at(parameters))

    def _allocate(self, n: int) -> None:
        self._flown = FlownReferences(n, self.table)
        self._unfelt = np.full((N_SENSED, n), np.nan)
        self._cycle = self._cycle_of(self._flown)

    def _cycle_of(self, flown: FlownReferences) -> GuidanceCycle | CompiledCycle:
        if self.engine == NATIVE:
            return CompiledCycle(flown, self.opened, self._opened_model)
        return GuidanceCycle(
            flown,
            self.law,
            self._stated_cycle,
            self.correction,
            modulation=self.modulation if self.modulates else None,
            angles=self.angles,
        )

    @cached_property
    def opened(self) -> Any:
        """The table as the native engine has opened it."""
        return core().Table(self.blob())

    @cached_property
    def _opened_model(self) -> Any:
        return None if self.correction is None else core().Model(model_blob(self.correction))

    @property
    def senses(self) -> bool:
        """Whether it wants sensed accelerations."""
        return self.law.senses or self.correction is not None

    @property
    def modulates(self) -> bool:
        """Whether it changes the angle of attack."""
        own = self.correction
        return self.law.modulates or (own is not None and own.corrector.change > 0.0)

    @property
    def correction_state(self) -> CorrectionState:
        """What estimators and correctors of the flights know now.

        Raises
        ------
        ValueError
            If it does not correct.
        """
        own = self._corrects("correction_state")
        if isinstance(self._cycle, CompiledCycle):
            return self._cycle.correction_state(own.estimator)
        return cast(CorrectedCycle, self._cycle.corrected).state

    def aim(self, targets: ArrayLike) -> None:
        """Correct towards other targets from now on: h (m), θ, φ (rad), V (m/s); (4,) or (4, n).

        One that is no number changes nothing.

        Raises
        ------
        ValueError
            If it does not correct.
        """
        self._corrects("aim")
        self._cycle.aim(vectors(targets, N_TARGETS, len(self._flown))[0])

    def _corrects(self, what: str) -> Correction:
        if self.correction is None:
            raise ValueError(
                f"{what}: expected a guidance that corrects its plan, got one that tracks its "
                "reference; ampi.load_guidance(path, correction='bank') loads one that does"
            )
        return self.correction

    def corrected(self, correction: Correction | None) -> Guidance:
        """The same with its plans corrected in flight; None: without."""
        return Guidance(**self._settings(correction=correction))

    @property
    def compiled(self) -> Any:
        """The flights in C, a `core().Guidance`, if the native engine computes.

        Raises
        ------
        ValueError
            If another one does.
        """
        if not isinstance(self._cycle, CompiledCycle):
            raise ValueError(f"guidance: expected one on the native engine, got {self.engine}")
        return self._cycle.code

    def _engine(self, asked: str) -> str:
        """The engine that computes, by its name."""
        if asked not in ENGINES:
            raise ValueError(f"engine: expected one of {', '.join(ENGINES)}, got {asked!r}")
        if asked == NUMPY:
            return asked
        reason = why_not_compiled(self._generator.table, self.law, self._generator.orders)
        if reason is not None and asked == NATIVE:
            raise ValueError(f"engine: expected numpy or auto, got native: {reason}")
        return NATIVE if reason is None else NUMPY

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
        navigated, is_one = vectors(navigation, N_NAVIGATED, n)
        felt = self._unfelt if sensed is None else vectors(sensed, N_SENSED, n)[0]
        command = self._cycle.step(number(time), navigated, felt)
        return command.of_one() if is_one else command


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
    if table.layout not in (law.layout, law.layout.with_angle_of_attack):
        raise ValueError(
            f"law: expected a table with the rows of {law.name} "
            f"({', '.join(row.name for row in law.layout.rows)}), got "
            f"{', '.join(row.name for row in table.layout.rows)}; load the database for this law"
        )


def _restored(settings: dict[str, Any]) -> Guidance:
    return Guidance(**settings)
