"""The offline side: fills the trajectory database with many optima."""

from database.build import BuildReport, build

__all__ = ["BuildReport", "build"]
