"""Figures of trajectories, databases and campaigns."""
