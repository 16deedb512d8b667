"""Compiles the inner loops of route planning if numba is installed (extra `slam`); else they are plain Python."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, TypeVar, cast

from artemis.build import install

_Function = TypeVar("_Function", bound=Callable[..., Any])

try:
    compiled: Callable[[_Function], _Function] = cast(Any, import_module("numba")).njit(cache=True, nogil=True)
    COMPILED = True
except ImportError:  # the extra `slam` is not installed

    def compiled(function: _Function, /) -> _Function:
        """As it is."""
        return function

    COMPILED = False


def notice() -> str:
    """For people, where `COMPILED` is false."""
    longer = "takes two to seven times as long, and up to two minutes where there is none"
    return f"numba is not installed: planning a route {longer}; {install('slam')}"
