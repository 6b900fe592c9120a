"""The offline side: fills the trajectory database with many optima."""

from database.build import build
from database.build_report import BuildReport

__all__ = ["BuildReport", "build"]
