"""The front door of the offline side: a mission in, a database file out.

    plan        which cases, each from which neighbours         (grid, continuation, plan)
    solve       portions of cases once their neighbours are kept, and alone what those leave
                                                                (attempts, jobs, schedule)
    again       what is not solved, from whatever is solved nearby  (second_pass)
    assemble    each block once its cases are kept              (blocks)
    merge       the blocks into one file, in index order        (writer)

Whatever is finished is on disk (records); only the last step writes the file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, closing
from pathlib import Path
from typing import Any

from ampi.missions.mission import Mission
from ampi.scp.condensed.settings import SolverSettings
from ampi.scp.solve import solve
from ampi.tracker_design.riccati_gains import GainSettings
from ampi.workers.engines import Engine, engine_for
from ampi.workers.keeping import no_parts
from ampi.workers.lock import exclusive
from ampi.workers.supervisor import require_workers
from database.build_report import BuildReport
from database.building import BuildRun, KnownOptimum, already_whole
from database.factory.jobs import MODULE
from database.records.campaign import TIME_LIMIT, BuildError, Solver
from database.refusals import checked
from database.stopped import told


def build(
    mission: Mission,
    path: str | Path,
    *,
    n_jobs: int = 2,
    client: Any = None,
    resume: bool = True,
    time_limit: float = TIME_LIMIT,
    gains: GainSettings | None = None,
    sensitivities: bool = False,
    solver: Solver = solve,
    settings: SolverSettings | None = None,
    known: Mapping[int, KnownOptimum] | None = None,
    advance: Callable[[int], None] | None = None,
) -> BuildReport:
    """Solve the mission's grid and write the trajectory database.

    Interrupted at any moment, the same call continues: what is finished is kept in `PATH.partial`. The
    file does not depend on interruptions, nor on where cases are solved.

    Parameters
    ----------
    mission
        What this object says is built.
    path
        HDF5 file to write; an existing one is replaced only by a whole new one.
    n_jobs, client
        Worker processes here, or those of a `distributed.Client`, which must see the folder of `path`.
    resume
        Go on from what an interrupted build has kept, or find the file whole; False starts afresh.
    time_limit
        Of one solve (s); one that takes longer is ended, and its case tried along another path.
    gains
        Weights of the tracking gains.
    sensitivities
        Store the derivatives of every optimum over the parameters, too (`ampi.scp.sensitivities`).
    solver
        The optimiser, a function of a module: another to measure the runner by itself.
    settings
        Of `ampi.solve`, for every solve of the build; the defaults need no tuning.
    known
        Optima by case that are kept instead of solved: of a coarser grid, or of a database repaired.
    advance
        Called with the number of cases just finished.

    Raises
    ------
    BuildError
        If the build cannot start or go on; what is finished stays.
    MissionError
        If the mission, or a point of its grid, says what no mission file could.
    """
    require_workers(n_jobs)
    path, asked = _in_a_folder(Path(path)), (settings, time_limit, gains, sensitivities)
    campaign = checked(mission, path, solver, *asked)
    if resume and (found := already_whole(path, campaign, known or {})) is not None:
        return found
    folder, notify = campaign.folder, advance or (lambda count: None)
    with told(folder, path), exclusive(folder), no_parts(folder), _engine(n_jobs, client) as engine:
        return BuildRun.begin(campaign, path, known or {}, engine, notify, resume=resume).run()


def _in_a_folder(path: Path) -> Path:
    """`path` from the root: what `advance` or a solver does may change the working folder."""
    if not path.parent.is_dir():
        raise BuildError(f"{path}: the folder {path.parent} does not exist")
    return path.absolute()


def _engine(n_jobs: int, client: Any) -> AbstractContextManager[Engine]:
    """Its workers import what they need while this process plans."""
    return closing(engine_for(MODULE, n_jobs, client))
