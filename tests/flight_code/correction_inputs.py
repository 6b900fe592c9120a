"""What the C programs read of estimation and correction: `… correction_inputs FOLDER`.

NAME.model of each mission, and as float64 numbers in NAME.correction what numpy makes of it: rates,
sensed accelerations and used limits in wind; updates of the estimator, useless measurements among them.
Of a SHEFEX-like table also NAME.table.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ampi.correction.onboard_correction import Correction
from ampi.correction.settings import CorrectorSettings
from ampi.estimation.estimator import COUNTED, Estimator
from ampi.export.model_blob import model_blob
from ampi.guidance import Guidance
from ampi.loading import modulation_limits, segments_of
from ampi.missions.loading import load_mission
from ampi.onboard.flight_model import BANK, SPEED, Factors, FlightModelData
from ampi.onboard.table import GuidanceTable
from ampi.onboard_model import correction_of
from ampi.pseudospectral.mesh import Mesh, Phase
from ampi.tracking.bank_limiter import BankLimits
from tests.export.conftest import LAWS

Array = NDArray[np.float64]

# Newtonian over time, from which plans are flown; polar and parabola, both smoothed; spline; and of the
# other curves of the air
MISSIONS = ("shefex3", "x33_liu2015", "cavh_wang2020", "cavh_liu2015", "lifting_orbital")
OWN = MISSIONS[0]
LIMITS = BankLimits(*np.radians([60.0, 5.0, 4.0]))
N_AIR, N_UPDATES = 200, 160
HEADER, COUNTS = 32, 8
TRUNCATED, FOREIGN, BYTE_ORDER, VERSION, CHECKSUM, INCONSISTENT = 1, 2, 3, 4, 5, 7


def flown(model: FlightModelData, begin: Array, end_speed: float) -> tuple[Array, Array]:
    """Times (m,) and states (m, 7, n) of flights along one course of the bank angle, to a speed."""
    step, state, time = 0.25, begin.copy(), 0.0
    times, states = [0.0], [begin.copy()]
    while (state[SPEED] > end_speed).any():
        slopes = []
        for part in (0.0, 0.5, 0.5, 1.0):
            there = state + part * step * (slopes[-1] if slopes else 0.0)
            there[BANK] = course(time + part * step)
            slopes.append(model.rates(there, 0.0, time + part * step))
        state = state + step / 6.0 * (slopes[0] + 2.0 * (slopes[1] + slopes[2]) + slopes[3])
        time += step
        state[BANK] = course(time)
        times.append(time)
        states.append(state)
    return np.array(times), np.array(states)


def course(time: float) -> float:
    """Bank angle (rad)."""
    return float(-0.75 + 0.2 * np.sin(time / 60.0))


def shefex_table(model: FlightModelData, entry: Array, end_speed: float) -> GuidanceTable:
    """Flights of `flown` over the speed and the path angle of the entry; no gains."""
    axes = entry[3] + np.array([-20.0, 20.0]), entry[4] + np.array([-4e-3, 4e-3])
    grid = np.stack(np.meshgrid(*axes, indexing="ij")).reshape(2, 4)
    begin = np.repeat(entry[:, None], 4, axis=1)
    begin[3:5] = grid
    times, states = flown(model, begin, end_speed)
    final = np.array([np.interp(-end_speed, -states[:, SPEED, k], times) for k in range(4)])
    mesh = Mesh((Phase((8,), 58.0), Phase((8, 8, 8))))
    fixed, free = mesh.node_time
    rows = np.zeros((4, len(LAWS["linear_quadratic"].layout), mesh.n_nodes))
    for k in range(4):
        at = fixed + free * final[k]
        for row in range(7):
            rows[k, row] = np.interp(at, times, states[:, row, k])
        rows[k, 7] = np.gradient(rows[k, BANK], at)
    share = np.linspace(0.0, 1.0, 90)
    points = np.concatenate([58.0 * share[:-1:3], 58.0 * (1.0 - share)])
    point_free = np.concatenate([np.zeros(len(share[:-1:3])), share])
    return GuidanceTable(
        axes=axes,
        values=rows.reshape(2, 2, *rows.shape[1:]),
        final_time=final.reshape(2, 2),
        segments=segments_of(mesh),
        conversion=np.ascontiguousarray(mesh.conversion(points + point_free * 130.0, 130.0).T),
        high_density_time=(points, point_free),
        centre=(0, 0),
        layout=LAWS["linear_quadratic"].layout,
    )


def own_correction() -> tuple[GuidanceTable, Correction]:
    """A table, and what corrects towards where its first flight ends."""
    mission = load_mission(OWN)
    entry = np.array([*(getattr(mission.entry, name) for name in ENTRY), 0.0])
    own = correction_of(mission, corrector=CorrectorSettings())
    table = shefex_table(own.model, entry, own.target[3])
    end = table.values[0, 0, :3, -1]
    return table, replace(own, target=(*end, own.target[3]), target_axes=(-1, -1, -1, -1))


ENTRY = ("altitude", "longitude", "latitude", "speed", "flight_path_angle", "azimuth")


def air(model: FlightModelData, rng: np.random.Generator) -> Iterator[Array]:
    """Each: time, state [8], factors [5]; rates [6], sensed [3], used [3]."""
    low = (-500.0, -3.0, -1.4, 300.0, -1.2, -3.1, -2.9)
    high = (130e3, 3.0, 1.4, 8000.0, 0.6, 3.1, 2.9)
    state, time = rng.uniform(low, high, (N_AIR, 7)).T.copy(), rng.uniform(0.0, 900.0, N_AIR)
    density, lift = np.exp(rng.uniform(-0.3, 0.3, (2, N_AIR)))
    east, north = rng.uniform(-150.0, 150.0, (2, N_AIR))
    angle = rng.uniform(-0.05, 0.05, N_AIR)
    factors = Factors(
        density=density, lift=lift, wind_east=east, wind_north=north, angle_of_attack=angle
    )
    told = [
        *(time, *state, np.zeros(N_AIR), density, lift, east, north, angle),
        *model.rates(state, 0.0, time, factors)[:6],
        *model.sensed(state, time, factors),
        *model.limit_use(state, 0.0, time, factors)[:3],
    ]
    yield from np.array(told).T


def updates(own: Correction, rng: np.random.Generator) -> Iterator[Array]:
    """Each: time, state [8], sensed [3], change, unsure; mean [6], covariance [36], NIS, counts [6].

    Mean and covariance in units of the first deviations.
    """
    estimator, prior = Estimator(own.model, own.estimator, 1), np.array(own.estimator.prior)
    state = np.array([70e3, 0.1, 0.5, 5000.0, -0.1, 1.0, 0.5, 0.0])[:, None]
    truth = Factors(
        density=1.1, lift=0.95, wind_east=np.array([30.0]), wind_north=np.array([-10.0]),
        angle_of_attack=0.004,
    )  # fmt: skip
    for i in range(N_UPDATES):
        time = 0.2 * i + 40.0
        state[:7, 0] += [-250.0, 1e-4, 1e-4, -15.0, 0.0, 1e-3, 0.02 * np.sin(0.1 * i)]
        angle = 0.02 * np.sin(0.3 * i)
        factors = truth._replace(angle_of_attack=truth.angle_of_attack + angle)
        sensed = np.array(own.model.sensed(state[:7], time, factors))
        sensed += 1e-3 * rng.standard_normal(sensed.shape)
        told, unsure = state.copy(), 0.002 * (i % 3)
        if i % 9 == 4:
            sensed[i % 3] = rng.choice([np.nan, np.inf, -1e300])
        if i % 11 == 5:
            told[i % 7] = rng.choice([np.nan, -np.inf, 1e13])
        if i % 13 == 6:
            time = rng.choice([np.nan, 1e13])
        if i % 17 in (7, 8):
            sensed = np.array([[-30.0], [5.0], [5.0]])  # twice the same: stuck
        if i % 19 == 8:
            sensed *= 1e-5
        if 100 <= i < 125:
            sensed *= 3.0  # until all is forgotten
        if i % 23 == 10:
            time -= 30.0
        estimator.update(time, told, sensed, np.array([angle]), np.array([unsure]))
        now = estimator.estimate
        covariance = now.covariance[:, :, 0] / prior / prior[:, None]
        counts = [estimator.counts[name][0] for name in COUNTED]
        yield np.array(
            [time, *told[:, 0], *sensed[:, 0], angle, unsure, *now.mean[:, 0] / prior,
             *covariance.ravel(), estimator.nis[0], *counts]
        )  # fmt: skip


def damages(blob: bytes) -> Iterator[tuple[int, bytes, int, int]]:
    """(place, bytes, whether the checksum is then made right, status)."""
    word, real = struct.Struct("<I"), struct.Struct("<d")
    yield 1, b"PNG", 1, FOREIGN
    for place, status in ((8, BYTE_ORDER), (12, VERSION), (16, VERSION)):
        yield place, word.pack(77), 1, status
    yield HEADER + 3, b"\x01", 0, CHECKSUM
    numbers = np.frombuffer(blob, dtype="<f8", offset=HEADER)
    form = 29  # place of it among the numbers; the two counts follow, and their knots
    curve = form + 3 + 32 + 2 * 256
    sound = curve + 4 + 32
    estimator, corrector = sound + 37, sound + 37 + 23
    bad = [(i, value) for i in range(0, len(numbers), 97) for value in (np.nan, np.inf)]
    bad += [(i, 0.0) for i in (0, 1, 4, 5, 11, 12, 13, 24, curve, sound)]
    bad += [(i, value) for i in (25, 28) for value in (-2.0, 0.5, 12.0)]
    bad += [(form, 3.0), (form, 0.5), (form + 1, 17.0), (form + 2, -1.0)]
    bad += [(i + 3, value) for i in (curve, sound) for value in (0.0, 1.5, 17.0)]
    bad += [(estimator + i, 0.0) for i in (12, 13, 15)]
    bad += [(corrector + i, 0.0) for i in (1, 3, 8, 11, 29)]
    bad += [(corrector + i, -1.0) for i in (6, 7, 27, 28)]
    bad += [(corrector + 27, 1e6), (corrector + 28, 0.5)]
    if numbers[form] == 2.0:
        bad += [(form + 1, 3.0), (form + 2, 3.0), (form + 4, -9.0), (form + 20, -9.0)]
    for i, value in bad:
        yield HEADER + 8 * i, real.pack(value), 1, INCONSISTENT
    end = struct.pack("<d", numbers[15])
    yield HEADER + 8 * 16, end, 1, INCONSISTENT  # the schedule ends where it begins


def write(folder: Path) -> None:
    """Of every mission."""
    table, own = own_correction()
    guidance = Guidance(
        table, LIMITS, law=LAWS["linear_quadratic"], cycle=0.5, engine="numpy",
        modulation=modulation_limits(load_mission(OWN)), correction=own,
    )  # fmt: skip
    (folder / f"{OWN}.table").write_bytes(guidance.blob())
    for name in MISSIONS:
        correction = own if name == OWN else correction_of(load_mission(name))
        blob, rng = model_blob(correction), np.random.default_rng(18)
        of_air, of_updates = list(air(correction.model, rng)), list(updates(correction, rng))
        bad = [[at, fixed, st, len(b), *b] for at, b, fixed, st in damages(blob)]
        counts = [len(of_air), len(of_updates), len(bad)]
        numbers = np.concatenate([counts, *of_air, *of_updates, *bad])
        (folder / f"{name}.model").write_bytes(blob)
        (folder / f"{name}.correction").write_bytes(numbers.astype("<f8").tobytes())


if __name__ == "__main__":
    Path(sys.argv[1]).mkdir(parents=True, exist_ok=True)
    write(Path(sys.argv[1]))
