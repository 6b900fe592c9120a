"""What correction_tests.c has planned, beside numpy: `python -m tests.flight_code.plans FILE`.

Each plan, and the one before it, is flown by the numpy predictor in the same steps and in eighths of them.
The plan must lead where the C says, be no worse than the one before it, and keep its bounds.
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ampi.correction.corrector import CorrectionOutcome, Corrector
from ampi.correction.plan import Plans
from ampi.correction.prediction import Predicted, Predictor, Situation
from ampi.correction.settings import N_PLAN
from ampi.estimation.estimate import Estimate
from tests.flight_code.correction_inputs import own_correction

Array = NDArray[np.float64]

RECORD = 5 + 7 + 6 + 4 + 2 * (2 + N_PLAN) + 6 + 3
EACH = 15  # of the plans, one is flown, and of these one in shorter steps
MOST = 1e-3  # m, s: C and numpy
FINE = 8  # shorter steps, and how far they may lead elsewhere
MOST_FINE = 50.0  # m
THERE = (CorrectionOutcome.PLAN_KEPT, CorrectionOutcome.PLAN_REPLACED)


def main(path: str) -> int:
    """A line for people, a line of JSON; 1 if a plan is not as it must be."""
    _, own = own_correction()
    rows = np.fromfile(path).reshape(-1, RECORD)
    predictor, corrector = Predictor(own.model, own.corrector), Corrector(own.model, own.corrector)
    fine = replace(predictor, settings=replace(own.corrector, step=own.corrector.step / FINE))
    apart, apart_fine, worse, off_bounds, astray = 0.0, 0.0, 0, 0, 0
    for i, row in enumerate(rows[::EACH]):
        time, change, bank, rate, altitude = row[:5]
        state, mean, target = row[5:12], row[12:18], row[18:22]
        where = Situation(
            time,
            np.append(state, change)[:, None],
            target[:, None],
            Estimate(mean[:, None], np.zeros((6, 6, 1)), np.array([altitude]), own.estimator),
            np.array([bank]),
            np.array([[rate], [own.corrector.change_rate]]),
        )
        before, after = (Plans(p[:1], p[1:2], p[2:, None]) for p in row[22:62].reshape(2, -1))
        laid = before.laid(after.fast, after.slow)
        after, laid = (p.with_values(p.values[:, None]) for p in (after, laid))
        missed, (to_go, outcome, most_change) = row[62:68], row[68:]
        if outcome == CorrectionOutcome.NO_ARRIVAL:
            continue
        told = predictor.predict(after, where)
        apart = max(apart, float(np.abs(told.missed[:3, 0, 0] - missed[:3]).max()))
        apart = max(apart, abs(float(told.to_go[0, 0]) - to_go))
        if i % EACH == 0:
            there = fine.predict(after, where)
            apart_fine = max(apart_fine, float(np.abs(there.missed[:3] - told.missed[:3]).max()))
        was = predictor.predict(laid, where)
        if was.arrives[0, 0]:
            costs = [_cost(corrector, seen, of) for seen, of in ((was, laid), (told, after))]
            worse += bool(costs[1] > costs[0] * (1.0 + 1e-9))
        bound = np.repeat([bank, most_change], [13, 5])
        off_bounds += bool((np.abs(after.values[:, 0, 0]) > bound).any())
        astray += bool(outcome in THERE and np.hypot(*missed[:2]) > own.corrector.tolerance)
    print(
        f"{-(-len(rows) // EACH)} plans of the C end within {apart:.1e} m of what numpy predicts, with steps of an "
        f"eighth within {apart_fine:.0f} m; {worse} worse than the one before, {off_bounds} off bounds"
    )
    figures = {"plans": len(rows), "apart": apart, "apart_fine": apart_fine, "worse": worse}
    print(json.dumps({"checked": True, **figures, "off_bounds": off_bounds, "astray": astray}))
    wrong = worse + off_bounds + astray > 0 or not (apart <= MOST and apart_fine <= MOST_FINE)
    return int(wrong or len(rows) == 0)


def _cost(corrector: Corrector, seen: Predicted, plans: Plans) -> float:
    return float(corrector.cost(seen.missed[:, 0], plans.values[:, 0])[0])


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
