"""Every uncertainty of the catalogue changes flights with the sign and about the size of physics.

Each is given alone, by a world file, and flown beside the nominal flight on the nominal reference: in
open loop what differs in the plant, tracked what differs in navigation, and by a law that senses what
differs in the accelerometer. All flights of a kind are one batch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.onboard.health import Steering
from ampi.onboard.reference import Mode
from ampi.onboard.row_layout import LINEAR_TRACKING
from ampi.simulation.uncertainties import BY_NAME, CHANNELS
from ampi.tracking.law import Told
from ampi.tracking.linear_quadratic import LinearQuadratic
from tests.support.world_flights import MANY, Flown, flown

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]
DEGREE = np.pi / 180.0
WEIGHTS = np.array([1e-5, 2e-5, 4e-5])  # rad/s per m/s², of the law that senses
AXES = ("along", "up", "right")
BIAS = {
    "north": 1e3,
    "east": 1e3,
    "altitude": 100.0,
    "speed": 5.0,
    "flight_path_angle": 0.1 * DEGREE,
    "azimuth": 0.1 * DEGREE,
    "bank_angle": DEGREE,
}
NOISE = {
    "north": 100.0,
    "east": 100.0,
    "altitude": 10.0,
    "speed": 0.5,
    "flight_path_angle": 0.05 * DEGREE,
    "azimuth": 0.05 * DEGREE,
    "bank_angle": 0.2 * DEGREE,
}
IN_OPEN_LOOP: dict[str, dict[str, float]] = {
    "density_factor": {"density_factor": 1.1},
    "thinner": {"density_factor": 1.0 / 1.1},
    "lift_factor": {"lift_factor": 1.1},
    "drag_factor": {"drag_factor": 1.1},
    "lift and drag": {"lift_factor": 1.1, "drag_factor": 1.1},
    "mass_factor": {"mass_factor": 1.1},
    "angle_of_attack_error": {"angle_of_attack_error": DEGREE},
    "wind_east": {"wind_east": 50.0},
    "wind_north": {"wind_north": 50.0},
    "density_noise": {"density_noise": 0.1},
    "density_noise, short": {"density_noise": 0.1, "density_noise_length": 1e3},
    "density_noise, long": {"density_noise": 0.1, "density_noise_length": 1e5},
    "wind_noise": {"wind_noise": 20.0},
    "wind_noise, short": {"wind_noise": 20.0, "wind_noise_length": 1e3},
    "wind_noise, long": {"wind_noise": 20.0, "wind_noise_length": 1e5},
    "actuator_lag": {"actuator_lag": 1.0},
    "actuator_delay": {"actuator_delay": 0.7},
}
TRACKED: dict[str, dict[str, float]] = {
    **{f"{name}_bias": {f"navigation_{name}_bias": size} for name, size in BIAS.items()},
    **{f"{name}_noise": {f"navigation_{name}_noise": size} for name, size in NOISE.items()},
    "dropout": {"navigation_dropout": 0.2},
    "late": {"navigation_latency": 1.0},
    "later": {"navigation_latency": 3.0},
}
SENSED: dict[str, dict[str, float]] = {
    **{f"{axis}_bias": {f"accelerometer_{axis}_bias": 0.5} for axis in AXES},
    "scale": {"accelerometer_scale": 0.02},
    "noise": {"accelerometer_noise": 0.05},
}


@dataclass(frozen=True)
class Sensing(LinearQuadratic):
    """The reference's bank rate and a share of what is felt: a witness, no guidance."""

    senses: ClassVar[bool] = True

    def command(self, at: Array, told: Told, memory: Array) -> tuple[Array, Array]:
        """Bank rate and no change of the angle of attack."""
        rate = at[self.layout.bank_rate] + WEIGHTS @ told.sensed
        return rate, np.zeros_like(rate)


@pytest.fixture(scope="module")
def nominal_mode(guidance: Guidance) -> Guidance:
    return guidance.in_mode(Mode.NOMINAL)


@pytest.fixture(scope="module")
def opened(mission: Mission, nominal_mode: Guidance) -> Flown:
    """On the reference without gains."""
    return flown(mission, untracked(nominal_mode), IN_OPEN_LOOP)


@pytest.fixture(scope="module")
def tracked(mission: Mission, nominal_mode: Guidance) -> Flown:
    return flown(mission, nominal_mode, TRACKED)


@pytest.fixture(scope="module")
def sensing(mission: Mission, nominal_mode: Guidance) -> Flown:
    guidance = Guidance(nominal_mode.table, nominal_mode.limits, Mode.NOMINAL, law=Sensing())
    return flown(mission, guidance, SENSED)


def untracked(guidance: Guidance) -> Guidance:
    values = guidance.table.values.copy()
    values[..., LINEAR_TRACKING.gains, :] = 0.0
    return Guidance(replace(guidance.table, values=values), guidance.limits, Mode.NOMINAL)


def test_every_uncertainty_is_flown() -> None:
    cases = [*IN_OPEN_LOOP.values(), *TRACKED.values(), *SENSED.values()]
    assert {name for case in cases for name in case} == set(BY_NAME)
    assert set(BIAS) == set(NOISE) == set(CHANNELS)


# --- air and vehicle ------------------------------------------------------------------------------


def early_loss(opened: Flown, case: str, time: float = 35.0) -> float:
    """Energy lost to drag until then, against the nominal loss: before the paths part."""
    own, nominal = opened.energy(case)[0], opened.energy("nominal")[0]
    k = int(np.searchsorted(opened.batch.times, time))
    return float((own[0] - own[k]) / (nominal[0] - nominal[k]))


def longer(opened: Flown, case: str) -> float:
    """Of the nominal range."""
    return float(opened.range(case)[0] / opened.range("nominal")[0]) - 1.0


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        ("density_factor", 1.1),
        ("drag_factor", 1.1),
        ("lift_factor", 1.0),
        ("mass_factor", 1.0 / 1.1),
        ("wind_east", (1.0 + 50.0 / 4712.0) ** 2),  # westwards: a head wind
    ],
)
def test_drag_before_the_paths_part(opened: Flown, case: str, expected: float) -> None:
    assert early_loss(opened, case) == pytest.approx(expected, abs=0.008)


def test_mass_lift_and_drag_make_up_a_density(opened: Flown) -> None:
    """ρ C/m is all that the accelerations know."""
    for one, other in (("mass_factor", "thinner"), ("lift and drag", "density_factor")):
        a, b = opened.of(one), opened.of(other)
        assert a.final_states == pytest.approx(b.final_states, rel=1e-9)
        assert a.final_time == pytest.approx(b.final_time, rel=1e-9)


def test_in_denser_air_the_same_flight_is_higher_by_a_scale_height_times_its_logarithm(
    opened: Flown,
) -> None:
    height = 6.4e3  # m, of the stratosphere
    nominal = opened.of("nominal").final_states[0, 0]
    higher = opened.of("density_factor").final_states[0, 0] - nominal
    assert higher == pytest.approx(height * np.log(1.1), rel=0.3)
    assert abs(longer(opened, "density_factor")) < 0.02


@pytest.mark.parametrize(("case", "ratio"), [("lift_factor", 1.1), ("drag_factor", 1.0 / 1.1)])
def test_range_goes_with_lift_over_drag(opened: Flown, case: str, ratio: float) -> None:
    assert longer(opened, case) / (ratio - 1.0) == pytest.approx(1.2, abs=0.2)


def test_an_angle_of_attack_changes_drag_and_lift_over_drag_as_the_aerodynamics_say(
    opened: Flown,
) -> None:
    k = int(np.searchsorted(opened.batch.times, 35.0))
    state, model = opened.of("nominal").states[0, :, k], opened.model
    other = replace(model, angle_of_attack_offset=DEGREE)
    nominal, changed = model.air_loads(state, 35.0), other.air_loads(state, 35.0)
    drag = float(changed.drag / nominal.drag)
    glide = float(changed.lift / nominal.lift) / drag
    assert early_loss(opened, "angle_of_attack_error") == pytest.approx(drag, abs=0.008)
    assert longer(opened, "angle_of_attack_error") / (glide - 1.0) == pytest.approx(1.0, abs=0.6)


@pytest.mark.parametrize(("case", "component"), [("wind_east", 0), ("wind_north", 1)])
def test_a_steady_wind_carries_the_end_along(opened: Flown, case: str, component: int) -> None:
    carried = 50.0 * float(opened.of("nominal").final_time[0])
    assert 0.2 < opened.moved(case)[component][0] / carried < 0.8


@pytest.mark.parametrize(
    ("case", "steady"),
    [("density_noise", 11e3), ("wind_noise", 20.0 / 50.0 * np.hypot(12e3, 17e3))],
)
def test_noise_over_altitude_scatters_the_ends_the_more_the_longer_its_correlation(
    opened: Flown, case: str, steady: float
) -> None:
    """Without end it were a factor or a steady wind, whose shift is known; short, it averages out."""
    scatter = [
        float(np.hypot(*(moved.std() for moved in opened.moved(name))))
        for name in (f"{case}, short", case, f"{case}, long")
    ]
    assert scatter[0] < 0.75 * scatter[1]
    assert scatter[0] < 0.6 * scatter[2]
    assert 0.6 * steady < scatter[2] < 1.6 * steady


@pytest.mark.parametrize(("case", "late"), [("actuator_delay", 0.7), ("actuator_lag", 1.0)])
def test_in_open_loop_the_bank_angle_is_late(opened: Flown, case: str, late: float) -> None:
    own, nominal, times = opened.of(case), opened.of("nominal"), opened.batch.times
    k = np.isfinite(own.states[0, 6] + nominal.states[0, 6])
    expected = np.interp(times - late, times[k], nominal.states[0, 6, k])[k]
    difference = own.states[0, 6, k] - expected
    size = np.abs(nominal.states[0, 6, k] - expected).max()
    assert np.abs(difference).max() < (0.05 if case == "actuator_delay" else 0.3) * size
    assert size > 0.5 * DEGREE


# --- navigation -----------------------------------------------------------------------------------


def ahead_and_right(tracked: Flown, case: str) -> tuple[float, float]:
    """Where the end lies against the nominal one, m along and right of the track, on average."""
    east, north = (float(moved.mean()) for moved in tracked.moved(case))
    azimuth = tracked.of("nominal").final_states[0, 5]
    sin, cos = float(np.sin(azimuth)), float(np.cos(azimuth))
    return east * sin + north * cos, east * cos - north * sin


@pytest.mark.parametrize("component", [0, 1])
def test_told_a_kilometre_off_a_flight_ends_a_kilometre_off_the_other_way(
    tracked: Flown, component: int
) -> None:
    moved = tracked.moved(("east_bias", "north_bias")[component])
    assert moved[component][0] == pytest.approx(-1e3, rel=0.05)
    assert abs(moved[1 - component][0]) < 100.0


@pytest.mark.parametrize(
    ("case", "energy", "least", "most"),
    [
        ("speed_bias", 595.0 * BIAS["speed"], 0.8, 1.3),
        ("altitude_bias", 9.8 * BIAS["altitude"], 0.5, 4.0),
    ],
)
def test_told_too_much_energy_a_flight_ends_short_by_the_way_on_which_drag_takes_it(
    tracked: Flown, case: str, energy: float, least: float, most: float
) -> None:
    nominal = tracked.of("nominal")
    loads = tracked.model.air_loads(nominal.final_states[0], float(nominal.final_time[0]))
    assert least < -ahead_and_right(tracked, case)[0] / (energy / float(loads.drag)) < most


def test_told_to_climb_it_ends_short_and_told_to_fly_too_far_right_it_ends_left(
    tracked: Flown,
) -> None:
    """By far less than without position: that is told truly."""
    untold = 1.5e6 * 0.1 * DEGREE
    assert 0.01 * untold < -ahead_and_right(tracked, "flight_path_angle_bias")[0] < 0.2 * untold
    assert 0.01 * untold < -ahead_and_right(tracked, "azimuth_bias")[1] < 0.2 * untold


def test_told_to_bank_further_right_it_banks_further_left(tracked: Flown) -> None:
    own, nominal = tracked.of("bank_angle_bias"), tracked.of("nominal")
    early = (own.states[0, 6] - nominal.states[0, 6])[: int(30.0 / 0.5)]
    assert -1.1 < early.min() / BIAS["bank_angle"] < -0.4
    assert early.max() < 1e-12


@pytest.mark.parametrize("channel", list(CHANNELS))
def test_noise_is_flown_as_bank_rate_by_its_gain(
    tracked: Flown, mission: Mission, nominal_mode: Guidance, channel: str
) -> None:
    """White noise n of the command shows as √6 n in the second difference of the rate flown."""
    own, nominal = tracked.of(f"{channel}_noise"), tracked.of("nominal")
    rate = own.bank_rate - nominal.bank_rate
    k = np.isfinite(rate).all(axis=0)
    reference = nominal_mode.reference(mission.nominal_parameters)
    rows = {"north": 2, "east": 1, "altitude": 0, "speed": 3, "flight_path_angle": 4, "azimuth": 5}
    gain = np.interp(own.times[k], reference.times, reference.gains[rows.get(channel, 6)])
    radius = tracked.model.planet.equatorial_radius
    metres = {"north": radius, "east": radius * np.cos(nominal.states[0, 2, k])}
    expected = np.sqrt(6.0 * np.mean((gain * NOISE[channel] / metres.get(channel, 1.0)) ** 2))
    second = np.diff(rate[:, k], 2, axis=1)
    assert np.sqrt(np.mean(second**2)) == pytest.approx(float(expected), rel=0.1)
    assert own.activity.mean() > nominal.activity[0]


def test_a_missing_sample_is_flown_by_the_reference(tracked: Flown) -> None:
    steering = tracked.steering[:1000]
    share = (steering == Steering.REFERENCE).mean(axis=0)
    missing = tracked.place["dropout"]
    assert share[missing].mean() == pytest.approx(0.2, abs=4.0 * 0.4 / np.sqrt(1000 * MANY))
    assert np.all(np.delete(share, np.arange(missing.start, missing.stop)) == 0.0)
    east, north = tracked.moved("dropout")
    off = np.hypot(east, north)
    assert np.all((off > 1e-3) & (off < 100.0))


def test_the_later_navigation_comes_the_more_a_flight_errs_and_steers(tracked: Flown) -> None:
    """A state told late lies behind on the reference, along which the gains see next to nothing."""
    nominal = tracked.of("nominal")
    off, activity = [0.0], [float(nominal.activity[0])]
    for case in ("late", "later"):
        off.append(float(np.hypot(*ahead_and_right(tracked, case))))
        activity.append(float(tracked.of(case).activity[0]))
    assert off[0] < off[1] < off[2] < 595.0 * 3.0
    assert activity[0] < activity[1] < activity[2]


# --- accelerometer --------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_bias_of_the_accelerometer_is_felt_along_its_axis(sensing: Flown, axis: int) -> None:
    own, nominal = sensing.of(f"{AXES[axis]}_bias"), sensing.of("nominal")
    rate = (own.bank_rate - nominal.bank_rate)[0, 2:40]
    assert rate == pytest.approx(np.full(38, 0.5 * WEIGHTS[axis]), rel=1e-3)
    assert np.hypot(*sensing.moved(f"{AXES[axis]}_bias"))[0] > 0.1


def test_a_scale_is_of_what_is_felt(sensing: Flown, opened: Flown) -> None:
    k = slice(80, 120)  # 40 to 60 s, before the paths part
    nominal = sensing.of("nominal").bank_rate[0, k]
    felt = nominal - opened.of("nominal").bank_rate[0, k]
    more = sensing.of("scale").bank_rate[0, k] - nominal
    assert more == pytest.approx(0.02 * felt, rel=0.03)
    assert np.abs(felt).max() > 5.0 * WEIGHTS[0]


def test_noise_of_the_accelerometer_is_of_each_component(sensing: Flown) -> None:
    rate = sensing.of("noise").bank_rate[:, :400] - sensing.of("nominal").bank_rate[:, :400]
    expected = np.sqrt(6.0) * 0.05 * float(np.linalg.norm(WEIGHTS))
    assert np.sqrt(np.mean(np.diff(rate, 2, axis=1) ** 2)) == pytest.approx(expected, rel=0.1)
    assert np.all(np.hypot(*sensing.moved("noise")) > 0.01)
