"""What INTERFACE.md says of estimation and correction: use, outcomes, memory and work.

A prediction takes as many steps as the flight that is left; a correction so many predictions, at the
most, as its model says, and those of one Jacobian beyond. In instructions,

    update = u + 5 s,  step = v + 4 s,  s = 12 k l + 40 (k + l) + 300 of a spline of k × l knots, else 0
    correction = (max(propagations, 2) + 18) ((⌈longest / step length⌉ + 2) step + algebra).       (1)

The numbers are those that callgrind counts of gcc 12, -O2, on x86-64, rounded up; `make flight-code`
fails where a count lies above them.
"""

from __future__ import annotations

import ctypes
import math

import numpy as np

from ampi.correction.corrector import CorrectionOutcome
from ampi.correction.settings import N_BANKS, N_MISSED, N_PLAN
from ampi.estimation.estimate import ESTIMATED

HEADER = 32
STEP, PROPAGATIONS, LONGEST = -19, -2, -1  # places among the numbers of the blob, from their end
FORM, SPLINE = 29, 2.0  # place of it; its two counts of knots follow
MOST_STEPS = 320  # AMPI_MAX_STEPS
AN_UPDATE, A_STEP = 7300, 7600  # instructions, those of the mathematical library included
ALGEBRA = 200_000  # of a step of the plan: ten systems of eighteen equations
_E = len(ESTIMATED)


def model_size(on_board: bytes) -> int:
    """Bytes of an ampi_model."""
    return len(on_board) - HEADER + 8


def corrector_size() -> int:
    """Bytes of an ampi_corrector."""
    estimate = _structure(ctypes.c_double * (_E + _E * _E + 3 + 3 + 1), ctypes.c_uint32 * 6)
    plan = ctypes.c_double * (2 + N_PLAN)
    numbers = ctypes.c_double * (4 + 8 + 1 + 1 + 2 + N_MISSED + 1)
    words = ctypes.c_uint32 * (4 + len(CorrectionOutcome) + 1)
    jacobian, path = ctypes.c_double * (N_MISSED * N_PLAN), ctypes.c_double * (19 * MOST_STEPS)
    whole = _structure(estimate, plan, plan, numbers, words, jacobian, path, ctypes.c_uint32)
    return ctypes.sizeof(whole)


def correction_bounds(on_board: bytes) -> tuple[int, int, int]:
    """Instructions of an update, of a step of a prediction, of a correction: Eq. (1)."""
    numbers = np.frombuffer(on_board, dtype="<f8", offset=HEADER)
    form, rows, columns = numbers[FORM : FORM + 3]
    spline = int(12 * rows * columns + 40 * (rows + columns) + 300) if form == SPLINE else 0
    update, step = AN_UPDATE + 5 * spline, A_STEP + 4 * spline
    steps = min(math.ceil(numbers[LONGEST] / numbers[STEP]) + 2, MOST_STEPS)
    predictions = int(max(numbers[PROPAGATIONS], 2)) + N_PLAN
    return update, step, predictions * (steps * step + ALGEBRA)


def correction_interface(on_board: bytes) -> str:
    """The part of the document."""
    update, step, correction = correction_bounds(on_board)
    outcomes = "".join(f"| {o:d} | {o.sentence} |\n" for o in CorrectionOutcome)
    return f"""\
## Correction in flight

`ampi_model.bin` is the model of vehicle and air, the target and the settings. With it the flight is
estimated, predicted and corrected:

1. `ampi_model_open(&model, blob, size)` once, with the same statuses as a table.
2. `ampi_corrector_begin(&corrector, &model, &table, parameters)` after `ampi_guidance_begin`.
3. `command = ampi_corrected_step(&corrector, &model, &guidance, &table, time, navigation, sensed)` in
   place of `ampi_guidance_step`. Without an open model it is the same.

`ampi_corrector_aim(&corrector, target)` takes another target: altitude (m), longitude, latitude (rad),
speed (m/s). A command by a plan has `steering` 3; the change of the angle of attack is in it. A plan is
{N_BANKS} bank angles and {N_PLAN - N_BANKS} changes of the angle of attack, and replaced by a better
one only.

`corrector.outcome`, counted in `corrector.count`:

| number | meaning |
| --- | --- |
{outcomes}
| memory | bytes |
| --- | --- |
| the model's blob, constant | {len(on_board):,} |
| ampi_model, constant once opened | {model_size(on_board):,} |
| ampi_corrector, of each flight | {corrector_size():,} |

| work | instructions, at the most |
| --- | --- |
| an update of the estimator, of every cycle | {update:,} |
| a step of a prediction | {step:,} |
| a correction, of one cycle in many | {correction:,} |

Those of the mathematical library are among them. An update without a number to learn from returns early;
what a correction takes depends on the flight that is left and on how many predictions it needs.
"""


def _structure(*fields: type) -> type[ctypes.Structure]:
    members = [(f"member_{i}", kind) for i, kind in enumerate(fields)]
    return type("_Structure", (ctypes.Structure,), {"_fields_": members})
