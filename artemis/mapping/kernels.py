"""Chooses the inner loops of mapping: compiled if numba is installed (extra `slam`), else with numpy."""

from __future__ import annotations

from artemis.mapping import kernels_numpy

try:
    from artemis.mapping import kernels_numba
except ImportError:  # the extra `slam` is not installed
    COMPILED = False
    KERNELS = kernels_numpy
else:
    COMPILED = True
    KERNELS = kernels_numba  # type: ignore[assignment]  # the same functions

NOTICE = "numba is not installed: mapping takes several times as long; pip install 'artemis-robot[slam]'"
"""For people, where `COMPILED` is false."""
