"""Missions: one TOML file each, units written out, validated whole."""

from ampi.missions.mission import Mission, MissionError, load_mission, shipped_missions

__all__ = ["Mission", "MissionError", "load_mission", "shipped_missions"]
