"""From a database with axes of density and lift to the guidance that re-selects its references."""

from __future__ import annotations

from pathlib import Path

from ampi.dataset import TrajectoryDataset, read_dataset
from ampi.loading import guidance_of
from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.onboard_model import flight_model_of
from ampi.reselection.known_air import EstimatedAir, KnownAir
from ampi.reselection.reselecting import ParameterPlan, Reselecting
from ampi.reselection.settings import ReselectionSettings

DENSITY, LIFT = "density_factor", "lift_factor"


def load_reselecting(
    path: str | Path,
    mission: Mission,
    *,
    mode: Mode | str = Mode.AMPI,
    cycle: float | None = None,
    settings: ReselectionSettings | None = None,
    air: KnownAir | None = None,
) -> Reselecting:
    """Guidance of `mission` by a database that has axes of density and lift beside some of its own.

    Parameters
    ----------
    path
        File made by `database.build`; its holes are flown.
    mission
        Whose parameters are told at the begin; of those that the database lacks it is ignorant.
    air
        Who tells what vehicle and air are; None: the estimator.

    Raises
    ------
    ValueError
        If the database has no axis of density or lift, or one that the mission does not tell.
    """
    dataset, own = read_dataset(path), ReselectionSettings() if settings is None else settings
    model = flight_model_of(dataset.mission)
    return Reselecting(
        guidance_of(dataset, mode=mode, holes="fly", cycle=cycle),
        EstimatedAir(model, own) if air is None else air,
        _plan(dataset, mission),
        radius=model.equatorial_radius,
        settings=own,
    )


def _plan(dataset: TrajectoryDataset, mission: Mission) -> ParameterPlan:
    names, told = list(dataset.names), [parameter.name for parameter in mission.parameters]
    missing = {DENSITY, LIFT} - set(names)
    if missing:
        raise ValueError(
            f"database: expected axes {DENSITY} and {LIFT}, got none of {', '.join(sorted(missing))}"
        )
    unknown = [name for name in names if name not in (DENSITY, LIFT, *told)]
    if unknown:
        raise ValueError(
            f"database: expected axes that {mission.name} tells ({', '.join(told)}), got "
            f"{', '.join(unknown)}"
        )
    places = tuple(told.index(name) if name in told else None for name in names)
    return ParameterPlan(places, len(told), names.index(DENSITY), names.index(LIFT))
