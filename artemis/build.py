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

from artemis.errors import ConfigError


@cache
def version(package: str) -> str:
    """Of an installed package: as long as a process runs it is the same."""
    return metadata.version(package)


def install(extra: str) -> str:
    """The command that adds an extra to this artemis, from where it was installed (PEP 610, `direct_url.json`)."""
    found = (each.read_text("direct_url.json") for each in metadata.distributions(name="artemis-robot"))
    origin = json.loads(next(filter(None, found), "{}"))  # a checkout's own .egg-info has none
    url, what = origin.get("url", ""), f"artemis-robot[{extra}]"
    if (versions := origin.get("vcs_info")) is not None:
        within = f"#subdirectory={origin['subdirectory']}" if "subdirectory" in origin else ""
        what = f"{what} @ {versions['vcs']}+{url}@{versions['commit_id']}{within}"
    elif url.startswith("file:"):
        what = f"{unquote(urlsplit(url).path)}[{extra}]"
    elif url:
        what = f"{what} @ {url}"
    editable = "--editable " * bool(origin.get("dir_info", {}).get("editable"))
    return f"{quote(sys.executable)} -m pip install {editable}{quote(what)}"


def require(what: str, extra: str, *packages: str) -> None:
    """Nothing, where the packages of an extra are installed that `what` needs.

    Raises:
        ConfigError: one is not; how to install it.
    """
    for package in packages:
        if find_spec(package) is None:
            raise ConfigError(f"{what} needs the package {package}: {install(extra)}")


def kind_of_build() -> str:
    """Whether the modules that `setup.py` lists are "compiled", as `make fast` does it, or "plain" Python."""
    spec = find_spec("artemis.sim.bus")
    return "plain" if spec is None or str(spec.origin).endswith(".py") else "compiled"


def described() -> str:
    """All of it in a line, for people."""
    return f"artemis {version('artemis-robot')}, Python {platform.python_version()}, {kind_of_build()}"
