"""Missions: one TOML file each, units written out, validated whole."""

from ampi.missions.loading import load_mission, shipped_missions
from ampi.missions.mission import Mission
from ampi.missions.sections import MissionError

__all__ = ["Mission", "MissionError", "load_mission", "shipped_missions"]
