"""What the vehicle management should know of a reference and of a command."""

from __future__ import annotations

from enum import IntEnum


class Health(IntEnum):
    """Of several that apply the greatest is told: precedence is the order of the numbers."""

    GOOD = 0
    BOUNDARY_REFERENCE = 1
    HOLE_REFERENCE = 2
    FAR_OUTSIDE = 3
    BAD_PARAMETERS = 4
    IMPLAUSIBLE_NAVIGATION = 5
    BAD_NAVIGATION = 6
    BAD_TIME = 7
    AFTER_FINAL_TIME = 8

    def __str__(self) -> str:
        return self.name

    @property
    def sentence(self) -> str:
        """One sentence for logs and prints."""
        return _SENTENCES[self]


_SENTENCES = {
    Health.GOOD: "Nothing is unusual.",
    Health.BOUNDARY_REFERENCE: (
        "The parameters lie outside the hypercube: the reference is of its boundary."
    ),
    Health.HOLE_REFERENCE: (
        "The reference needs a case without solution: its nearest neighbour stands for it."
    ),
    Health.FAR_OUTSIDE: (
        "The parameters lie outside the hypercube by more than 20 % of an axis' range, in another unit "
        "perhaps: the reference is of its boundary."
    ),
    Health.BAD_PARAMETERS: (
        "The parameters are no vector of finite numbers, one per axis: what is none is nominal."
    ),
    Health.IMPLAUSIBLE_NAVIGATION: (
        "State or bank rate lie far outside of all that the table flies, another unit perhaps: without "
        "a state the reference's own bank rate is commanded, for a bank rate the last command stands."
    ),
    Health.BAD_NAVIGATION: (
        "State or bank rate are no number or of a wrong shape: commanded as when they are implausible."
    ),
    Health.BAD_TIME: (
        "The time is no number, or does not go on from the last one: it is counted on by the last cycle."
    ),
    Health.AFTER_FINAL_TIME: "The reference has ended: the bank angle is held.",
}
