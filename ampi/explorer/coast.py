"""Coast lines."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray


def land(window: Mapping[str, float]) -> list[NDArray[np.float64]]:
    """None yet."""
    return []
