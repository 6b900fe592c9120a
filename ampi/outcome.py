"""Outcomes as data: a name for code, a number for files, a sentence for people."""

from __future__ import annotations

from enum import IntEnum
from typing import Self


class Outcome(IntEnum):
    """How something ended. Numbers are stored and never change their meaning."""

    sentence: str  # for logs, files and pages

    def __new__(cls, number: int, sentence: str = "") -> Self:
        """A member is written as its number and its sentence."""
        member = int.__new__(cls, number)
        member._value_ = number
        member.sentence = sentence
        return member

    def __str__(self) -> str:
        return self.name

    def __format__(self, spec: str) -> str:
        return format(int(self), spec) if spec.endswith("d") else format(self.name, spec)
