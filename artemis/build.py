"""Which artemis this is: its version, the interpreter, and whether its modules are compiled."""

from __future__ import annotations

import platform
from functools import cache
from importlib import metadata
from importlib.util import find_spec


@cache
def version(package: str) -> str:
    """Of an installed package: as long as a process runs it is the same."""
    return metadata.version(package)


def kind_of_build() -> str:
    """Whether the modules that `setup.py` lists are "compiled", as `make fast` does it, or "plain" Python."""
    spec = find_spec("artemis.sim.bus")
    return "plain" if spec is None or str(spec.origin).endswith(".py") else "compiled"


def described() -> str:
    """All of it in a line, for people."""
    return f"artemis {version('artemis-robot')}, Python {platform.python_version()}, {kind_of_build()}"
