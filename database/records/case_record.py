"""What is kept of one case, as bytes that say themselves whether they are whole, and whose they are."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass

import numpy as np

from ampi.missions.mission import Mission
from ampi.trajectory import Statistics, Status, Trajectory
from ampi.workers.seal import mark, sealed, unsealed


@dataclass(frozen=True, eq=False)
class CaseRecord:
    """What is kept of one case."""

    case: int
    trajectory: Trajectory
    message: str
    solves: int  # optimal control problems solved to get there
    seconds: float

    def packed(self, label: str) -> bytes:
        """One line of JSON, the arrays it names one after the other as f8, a CRC-32 of all that.

        The CRC is also of the build's `label` and of the case's number.

        An .npz takes ten times as long to read, a quarter of a millisecond, and portions read hundreds.
        """
        t = self.trajectory
        arrays = {"states": t.states, "bank_rate": t.bank_rate}
        if t.angle_of_attack_rate is not None:
            arrays["angle_of_attack_rate"] = t.angle_of_attack_rate
        if t.target_multipliers is not None:
            arrays["target_multipliers"] = t.target_multipliers
        scalars = np.array([t.final_time, t.cost, self.seconds, *t.statistics.limit_excess])
        arrays["scalars"] = scalars  # not in JSON: it has no word for what is not a number
        head = {
            "status": int(t.status),
            "iterations": t.statistics.iterations,
            "solves": self.solves,
            "message": self.message,
            "shapes": {name: values.shape for name, values in arrays.items()},
        }
        parts = [json.dumps(head).encode(), b"\n"]
        parts += [np.ascontiguousarray(values, dtype="<f8").tobytes() for values in arrays.values()]
        return sealed(b"".join(parts), mark(label, self.case))

    @classmethod
    def unpacked(cls, case: int, raw: bytes, mission: Mission, label: str) -> CaseRecord:
        """The record in `raw`; ValueError if it is damaged, or of another case or build."""
        body = bytes(unsealed(raw, mark(label, case)))
        line, _, _ = body.partition(b"\n")
        head, place = json.loads(line), len(line) + 1
        arrays = {}
        for name, shape in head["shapes"].items():
            count = math.prod(shape)
            arrays[name] = np.frombuffer(body, "<f8", count, place).reshape(shape)
            place += 8 * count
        final_time, cost, seconds, *excess = arrays["scalars"].tolist()
        trajectory = Trajectory(
            mesh=mission.pseudospectral_mesh,
            states=arrays["states"],
            bank_rate=arrays["bank_rate"],
            final_time=final_time,
            cost=cost,
            status=Status(head["status"]),
            statistics=Statistics(iterations=head["iterations"], limit_excess=tuple(excess)),
            target_multipliers=arrays.get("target_multipliers"),
            angle_of_attack_rate=arrays.get("angle_of_attack_rate"),
        )
        return cls(case, trajectory, head["message"], head["solves"], seconds)
