"""What is asked: scaled problem, objective, target, limits, verdict."""
