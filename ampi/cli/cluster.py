"""A dask.distributed cluster to work on, where its scheduler is."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def cluster(scheduler: str | None) -> Iterator[Any]:
    """A client of a running scheduler; None without an address."""
    if scheduler is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError:
        raise ValueError(
            "--scheduler: needs dask.distributed, which is not installed; "
            "try: pip install 'ampi[cluster]'"
        ) from None
    try:
        client = Client(scheduler, timeout=10)
    except (OSError, ValueError) as error:
        raise ValueError(
            f"--scheduler: expected the address of a running scheduler, got {scheduler!r} "
            f"({type(error).__name__}); start one with: dask scheduler"
        ) from None
    with client:
        yield client
