"""Whether the compiled engine is there, and the front of what it can do.

The extension `_core` is optional: a package that was installed without a compiler flies in numpy.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType


def _loaded() -> tuple[ModuleType | None, str]:
    """The extension, or None and why it is not there."""
    try:
        return import_module("ampi._native._core"), ""
    except ImportError as error:
        return None, (
            f"ampi was installed without its compiled engine ({error}); reinstall it with a C compiler "
            "to fly in C"
        )


_core, WHY_NOT = _loaded()


def is_available() -> bool:
    """Whether the compiled engine is there; if not, `WHY_NOT` says why."""
    return _core is not None


def core() -> ModuleType:
    """The extension module.

    Raises
    ------
    ImportError
        If it is not there.
    """
    if _core is None:
        raise ImportError(WHY_NOT)
    return _core
