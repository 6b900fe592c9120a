"""Flights of SHEFEX-3 minutes before their end, in air that differs, and where their plans lead."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.correction.corrector import Corrector
from ampi.correction.onboard_correction import Correction
from ampi.correction.plan import CHANGES, Plans
from ampi.correction.prediction import Predictor, Situation
from ampi.correction.settings import N_BANKS, N_PLAN
from ampi.estimation.estimate import Estimate
from ampi.missions.loading import load_mission
from ampi.onboard_model import correction_of

Array = NDArray[np.float64]
Flights = Callable[..., tuple[Plans, Situation]]


@pytest.fixture(scope="session")
def correction() -> Correction:
    return correction_of(load_mission("shefex3"))


@pytest.fixture(scope="session")
def by_bank_alone(correction: Correction) -> Correction:
    return replace(correction, corrector=replace(correction.corrector, change=0.0))


def with_settings(correction: Correction, **changes: Any) -> Corrector:
    return Corrector(correction.model, replace(correction.corrector, **changes))


@pytest.fixture(scope="session")
def corrector(correction: Correction) -> Corrector:
    return with_settings(correction, step=8.0)  # for the sake of the tests' time


@pytest.fixture(scope="session")
def predictor(correction: Correction) -> Predictor:
    return Predictor(correction.model, correction.corrector)


@pytest.fixture(scope="session")
def flights(correction: Correction, predictor: Predictor) -> Flights:
    """n flights with smooth plans, and targets where these plans end but for the altitude."""

    def made(n: int, *, seed: int = 0) -> tuple[Plans, Situation]:
        rng = np.random.default_rng(seed)
        middle = np.array([29e3, -0.9, 1.1, 1700.0, -0.03, 0.8, 0.5, 0.0])
        spread = np.array([500.0, 0.05, 0.05, 50.0, 0.005, 0.3, 0.1, 0.01])
        state = middle[:, None] + spread[:, None] * rng.uniform(-1.0, 1.0, (8, n))
        mean = np.array([0.05, 0.03, 0.03, 20.0, 20.0, 0.005])[:, None] * rng.uniform(-1, 1, (6, n))
        covariance = np.zeros((6, 6, n))
        estimate = Estimate(mean, covariance, state[0].copy(), correction.estimator)
        limits = correction.model.limits
        target = np.repeat(np.array(correction.target)[:, None], n, axis=1)
        target[1:3] = state[1:3]
        where = Situation(
            400.0,
            state,
            target,
            estimate,
            np.full(n, limits.bank_angle),
            np.array([[limits.bank_rate], [correction.corrector.change_rate]]) + np.zeros(n),
        )
        values = np.zeros((N_PLAN, n))
        values[:N_BANKS] = state[6] + np.linspace(0.0, 1.0, N_BANKS)[:, None] * rng.uniform(
            -0.3, 0.3, n
        )
        values[CHANGES] = rng.uniform(-0.02, 0.02, n)
        plans = Plans(predictor.speed(target, state), target[3], values)
        ends = predictor.predict(plans.with_values(values[:, None]), where)
        assert ends.arrives.all()
        east, north, _ = ends.missed[:3, 0]
        radius = correction.model.equatorial_radius
        latitude = target[2] + north / radius
        # a place is told by the longitude's scale at the target, which has moved north
        longitude = target[1] + east / (radius * np.cos(target[2]))
        return plans, replace(where, target=np.stack([target[0], longitude, latitude, target[3]]))

    return made


@pytest.fixture(scope="session")
def ends() -> Callable[[Predictor, Plans, Situation], Array]:
    """Misses (6, n) of one plan a flight; no number without arrival."""

    def of(predictor: Predictor, plans: Plans, where: Situation) -> Array:
        found = predictor.predict(plans.with_values(plans.values[:, None]), where)
        return np.where(found.arrives[0], found.missed[:, 0], np.nan)

    return of
