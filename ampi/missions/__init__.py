"""Missions: one TOML file each, units written out, validated whole."""

from ampi.missions.loading import load_mission, shipped_missions
from ampi.missions.mission import Mission, MissionError

__all__ = ["Mission", "MissionError", "load_mission", "shipped_missions"]
