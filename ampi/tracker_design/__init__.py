"""Gains along an optimum, made on the ground."""
