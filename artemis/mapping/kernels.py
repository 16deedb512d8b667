"""Chooses the inner loops of mapping: compiled if numba is installed (extra `slam`), else with numpy.

They are imported when they are first used: numba takes more than a second.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from artemis.build import install

_NUMPY = "artemis.mapping.kernels_numpy"

LOOPS: ModuleType
COMPILED: bool


def notice() -> str:
    """For people, where `COMPILED` is false."""
    return f"numba is not installed: mapping takes five times as long; {install('slam')}"


def __getattr__(name: str) -> object:
    """The first use of `LOOPS` or `COMPILED`."""
    if name not in ("LOOPS", "COMPILED"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        found = import_module("artemis.mapping.kernels_numba"), True
    except ImportError:  # the extra `slam` is not installed
        found = import_module(_NUMPY), False
    globals()["LOOPS"], globals()["COMPILED"] = found
    return globals()[name]


def use_numpy() -> None:
    """Take the loops in numpy from now on, though numba is installed: to compare."""
    global LOOPS, COMPILED
    LOOPS, COMPILED = import_module(_NUMPY), False
