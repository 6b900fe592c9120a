"""What the vehicle management should know of a reference and of a command."""

from __future__ import annotations

from ampi.outcome import Outcome


class Health(Outcome):
    """Of several that apply the greatest is told: precedence is the order of the numbers."""

    GOOD = 0, "Nothing is unusual."
    BOUNDARY_REFERENCE = (
        1,
        "The parameters lie outside the hypercube: the reference is of its boundary.",
    )
    HOLE_REFERENCE = (
        2,
        "The reference needs a case without solution: its nearest neighbour stands for it.",
    )
    FAR_OUTSIDE = (
        3,
        "The parameters lie outside the hypercube by more than 20 % of an axis' range, in "
        "another unit perhaps: the reference is of its boundary.",
    )
    BAD_PARAMETERS = (
        4,
        "The parameters are no vector of finite numbers, one per axis: what is none is nominal.",
    )
    IMPLAUSIBLE_NAVIGATION = (
        5,
        "State or bank rate lie far outside of all that the table flies, another unit perhaps: "
        "without a state the reference's own bank rate is commanded, for a bank rate the last "
        "command stands.",
    )
    BAD_NAVIGATION = (
        6,
        "State or bank rate are no number or of a wrong shape: commanded as when they are "
        "implausible.",
    )
    BAD_TIME = (
        7,
        "The time is no number, or does not go on from the last one: it is counted on by the "
        "last cycle.",
    )
    AFTER_FINAL_TIME = 8, "The reference has ended: the bank angle is held."
    NOT_BEGUN = (
        9,
        "No flight has been begun with this table, or it is not open: the bank angle is held.",
    )


class Steering(Outcome):
    """By what a command steers: the mode of the flight software."""

    TRACKED = 0, "The law tracks the reference."
    REFERENCE = 1, "The reference's own bank rate is flown: there is no navigation to track it by."
    HELD = 2, "The bank angle is held: the reference has ended, or nobody knows the time."
    PLANNED = 3, "The plan is flown, corrected in flight."
