"""Reading what a build has kept: a file at a time, and what a process has read lately from memory."""

from __future__ import annotations

from collections import OrderedDict, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ampi.trajectory import Trajectory
from ampi.workers.job import JobError
from database.records.campaign import Campaign
from database.records.case_record import CaseRecord
from database.records.record_files import (
    again_folder,
    is_recorded,
    load_record,
    load_records,
    record_path,
)

MOST_RECENT = 20000  # records, 6 kB each


@dataclass(frozen=True)
class RecordReader:
    """The records of a build that lie in these files."""

    campaign: Campaign
    files: Mapping[int, int]  # by case: its file, by the first case there (record_files)

    def read(self, cases: Iterable[int]) -> dict[int, CaseRecord]:
        """What is kept of the cases, of each by the last round that tried it.

        Raises
        ------
        JobError
            If a case is not kept: what is solved without it would not be what a build solves.
        """
        cases = list(cases)
        found = self._of_the_first_pass(cases)
        for rounds in range(1, self.campaign.rounds + 1):
            folder = again_folder(self.campaign.folder, rounds)
            for case in cases:
                if is_recorded(folder, case):
                    again = load_record(folder, case, self.campaign.mission, self.campaign.label)
                    if again is None:
                        raise JobError(lost(record_path(folder, case)))
                    found[case] = again
        return found

    def record(self, case: int) -> CaseRecord:
        """What is kept of one case."""
        return self.read((case,))[case]

    def solved(self, case: int) -> Trajectory | None:
        """The solution of a case that is kept; None if it has none."""
        trajectory = self.record(case).trajectory
        return trajectory if trajectory.status.ok else None

    def _of_the_first_pass(self, cases: list[int]) -> dict[int, CaseRecord]:
        """From memory, or each file read once; in one build, a record never changes once kept."""
        build = (self.campaign.folder, self.campaign.label, self.campaign.build)
        found, missing = {}, defaultdict[int, list[int]](list)
        for case in cases:
            known = _recent.get((*build, case))
            if known is None:
                missing[self.files.get(case, case)].append(case)
            else:
                found[case] = known
        for first, there in missing.items():
            mission = self.campaign.mission
            loaded = load_records(build[0], first, there, mission, self.campaign.label)
            if len(loaded) < len(there):
                raise JobError(lost(record_path(build[0], first)))
            found.update(loaded)
            _recent.update({(*build, case): record for case, record in loaded.items()})
        while len(_recent) > MOST_RECENT:
            _recent.popitem(last=False)
        return found


_recent = OrderedDict[tuple[Path, str, str, int], CaseRecord]()


def lost(path: Path) -> str:
    """What there is to say of a file that was there."""
    return f"{path} has disappeared or changed during the build"
