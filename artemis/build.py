"""Which artemis this is: its version, the interpreter, and whether its modules are compiled."""

from __future__ import annotations

import json
import platform
import sys
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from shlex import quote
from urllib.parse import unquote, urlsplit


@cache
def version(package: str) -> str:
    """Of an installed package: as long as a process runs it is the same."""
    return metadata.version(package)


def install(extra: str) -> str:
    """The command that adds an extra to this artemis, from where it was installed (PEP 610, `direct_url.json`)."""
    origin = json.loads(metadata.distribution("artemis-robot").read_text("direct_url.json") or "{}")
    url = urlsplit(origin.get("url", ""))
    place = unquote(url.path) if url.scheme == "file" else "artemis-robot"
    editable = "--editable " * bool(origin.get("dir_info", {}).get("editable"))
    return f"{quote(sys.executable)} -m pip install {editable}{quote(f'{place}[{extra}]')}"


def kind_of_build() -> str:
    """Whether the modules that `setup.py` lists are "compiled", as `make fast` does it, or "plain" Python."""
    spec = find_spec("artemis.sim.bus")
    return "plain" if spec is None or str(spec.origin).endswith(".py") else "compiled"


def described() -> str:
    """All of it in a line, for people."""
    return f"artemis {version('artemis-robot')}, Python {platform.python_version()}, {kind_of_build()}"
