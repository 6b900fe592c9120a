"""The tables of the optimiser papers: paper, ours by the same method, ours by our method."""

from __future__ import annotations

from collections.abc import Callable

from ampi.papers.betts2010 import betts2010
from ampi.papers.liu2015 import liu2015
from ampi.papers.liu2024 import liu2024
from ampi.papers.table import Reproduction
from ampi.papers.wang2020 import wang2020
from ampi.papers.zhou2021 import zhou2021

PAPERS: dict[str, Callable[[bool], Reproduction]] = {
    "zhou2021": zhou2021,
    "liu2015": liu2015,
    "wang2020": wang2020,
    "liu2024": liu2024,
    "betts2010": betts2010,
}
