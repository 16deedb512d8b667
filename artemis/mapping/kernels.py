"""Chooses the inner loops of mapping: compiled if numba is installed (extra `slam`), else with numpy."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

try:
    KERNELS: ModuleType = import_module("artemis.mapping.kernels_numba")
    COMPILED = True
except ImportError:  # the extra `slam` is not installed
    KERNELS = import_module("artemis.mapping.kernels_numpy")
    COMPILED = False


def use_numpy() -> None:
    """Take the loops in numpy from now on, though numba is installed: to compare."""
    for module in ("laser", "likelihood", "occupancy"):
        import_module(f"artemis.mapping.{module}").KERNELS = import_module("artemis.mapping.kernels_numpy")


NOTICE = "numba is not installed: mapping takes several times as long; pip install 'artemis-robot[slam]'"
"""For people, where `COMPILED` is false."""
