"""The one place that integrates: fixed steps, adaptive steps, and flights flown again."""
