"""Chooses the inner loops of mapping: compiled if numba is installed (extra `slam`), else with numpy."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

_NUMPY = "artemis.mapping.kernels_numpy"

try:
    LOOPS: ModuleType = import_module("artemis.mapping.kernels_numba")
    COMPILED = True
except ImportError:  # the extra `slam` is not installed
    LOOPS = import_module(_NUMPY)
    COMPILED = False

NOTICE = "numba is not installed: mapping takes several times as long; pip install 'artemis-robot[slam]'"
"""For people, where `COMPILED` is false."""


def use_numpy() -> None:
    """Take the loops in numpy from now on, though numba is installed: to compare."""
    global LOOPS, COMPILED
    LOOPS, COMPILED = import_module(_NUMPY), False
