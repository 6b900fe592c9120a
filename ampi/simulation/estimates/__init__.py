"""Estimates with their intervals, from plain arrays, one entry a flight; no flight is dropped."""
