"""Campaigns made of random numbers, and campaigns compared to the last bit."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from ampi.correction.corrector import CorrectionOutcome
from ampi.missions.path_limits import PathLimits
from ampi.onboard.reference import Mode
from ampi.simulation.flights import Flights
from ampi.simulation.profiles import ALTITUDES
from ampi.simulation.uncertainties import CATALOGUE

NOMINAL_NUMBERS = np.array([uncertainty.nominal for uncertainty in CATALOGUE])


def nominal_truth(n: int) -> dict[str, Any]:
    """Of n flights in a world that is the model: what `Flights` holds of it."""
    return {
        "world": "entry",
        "world_sha256": "e" * 64,
        "world_toml": "",
        "drawn": "entry.speed: normal, 3σ 70 m/s",
        "profiles": "",
        "pool": "reported",
        "numbers": np.tile(NOMINAL_NUMBERS, (n, 1)),
        "density": np.ones((n, len(ALTITUDES))),
        "wind": np.zeros((n, 2, len(ALTITUDES))),
        "seeds": np.arange(n, dtype=np.uint64),
    }


def unremarkable(n: int) -> dict[str, Any]:
    """Of n flights whose targets are in reach and that never skip: what tells failures apart."""
    return {
        "rebound": np.full(n, np.nan),
        "distance": np.full(n, 800e3),
        "least_range": np.full(n, np.nan),
        "greatest_range": np.full(n, np.nan),
        "entry_altitude": 100e3,
    }


def synthetic_flights(n: int = 200, seed: int = 0, **changes: Any) -> Flights:
    """A campaign of random numbers; k = 4 recorded points."""
    rng = np.random.default_rng(seed)
    along, across = 20e3 * rng.standard_normal(n), 10e3 * rng.standard_normal(n)
    values: dict[str, Any] = {
        **nominal_truth(n),
        **unremarkable(n),
        "mission": "synthetic",
        "mission_sha256": "0" * 64,
        "guidance_sha256": "1" * 64,
        "law": "linear_quadratic",
        "correction": "none",
        "mode": Mode.AMPI,
        "seed": 7,
        "engine": "numpy",
        "cycle": 0.5,
        "parameters": np.random.default_rng(99).standard_normal((n, 6)),
        "clipped": rng.random(n) < 0.2,
        "hole": np.arange(n) % 7 == 0,
        "status": np.zeros(n, dtype=np.int64),
        "final_states": rng.standard_normal((n, 7)),
        "final_time": rng.uniform(500.0, 600.0, n),
        "corrections": np.zeros((n, len(CorrectionOutcome)), dtype=np.int64),
        "miss": np.hypot(along, across),
        "along": along,
        "across": across,
        "altitude_error": 100.0 * rng.standard_normal(n),
        "speed_error": 1e-6 * rng.standard_normal(n),
        "times": np.arange(4.0),
        "states": rng.standard_normal((n, 7, 4)),
        "reference_states": rng.standard_normal((n, 7, 4)),
        "bank_rate": rng.standard_normal((n, 4)),
        "angle_of_attack": np.zeros((n, 4)),
        "limits": PathLimits().names,
        "path": rng.uniform(0.0, 1.1, (n, 5, 4)),
        "peak": rng.uniform(0.5, 1.1, (n, 5)),
        "saturation": rng.uniform(0.0, 0.3, n),
        "activity": rng.uniform(1.0, 5.0, n),
        "position_tolerance": 25e3,
        "altitude_tolerance": 150.0,
        "speed_tolerance": 25.0,
        "radii": np.array([3e3, 6.5e3, 13e3, 25e3]),
    }
    return Flights(**{**values, **changes})


def assert_identical(one: Flights, two: Flights) -> None:
    """Types, shapes and bits; what lies in a file is read."""
    for field in fields(Flights):
        a, b = getattr(one, field.name), getattr(two, field.name)
        if hasattr(b, "dtype"):
            assert a.dtype == b.dtype, field.name
            nan = np.issubdtype(a.dtype, np.floating)
            assert np.array_equal(a[()], b[()], equal_nan=nan), field.name
        else:
            assert (type(a), a) == (type(b), b), field.name
