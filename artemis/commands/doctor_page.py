"""`artemis doctor`: what the page for operators, and a service or a container that serves it, need of this computer."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
from collections.abc import Iterator
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path

from artemis.bridges.addresses import bound
from artemis.clock import wall_date
from artemis.commands.findings import FAILURE, NOTE, OK, WARNING, Finding
from artemis.errors import ConfigError
from artemis.page import certificates
from artemis.page.access import key_place, read_key
from artemis.page.observer import PORT

PAGE_PORT = PORT
"""At which a page is served where nobody says another one."""
SOON = 30
"""Days before its end that a certificate is said to end soon."""
WANTED_NICE = -15
"""As the units and the container have it."""
_DATE = "notAfter=%b %d %H:%M:%S %Y %Z"
"""As `openssl x509 -enddate` writes it (openssl-x509(1))."""


def page_findings() -> Iterator[Finding]:
    """All of them; nothing where no page can be served."""
    if find_spec("uvicorn") is None:
        yield Finding(NOTE, "no page can be served: the extra web is not installed")
        return
    yield from _key(key_place())
    yield from _port(PAGE_PORT)
    yield from _certificate()


def _key(path: Path) -> Iterator[Finding]:
    folder = next(place for place in (path.parent, *path.parent.parents) if place.exists())
    try:
        if path.exists():
            read_key(path)
    except ConfigError as error:
        yield Finding(FAILURE, str(error))
        return
    if path.exists() or os.access(folder, os.R_OK | os.W_OK):
        yield Finding(OK, f"the page's key is kept in {path}")
    else:
        remedy = "a home of its own, or XDG_CONFIG_HOME: a folder that it may write"
        yield Finding(FAILURE, f"{path}: this user cannot keep the page's key there", remedy)


def _port(port: int) -> Iterator[Finding]:
    try:
        bound("127.0.0.1", port, listening=True).close()
    except OSError as error:
        yield Finding(NOTE, f"port {port}: {error.strerror}; a page may be there already", "another one: --page-port N")
    else:
        yield Finding(OK, f"port {port} is free")


def _certificate() -> Iterator[Finding]:
    if (found := certificates.kept()) is None:
        return
    certificate, _ = found
    again = f"artemis page certificate {' '.join(certificates.names([]))}"
    if (openssl := shutil.which("openssl")) is None:
        yield Finding(NOTE, f"{certificate}: when it ends is not known: the program openssl is missing")
        return
    command = [openssl, "x509", "-noout", "-enddate", "-in", str(certificate)]
    said = subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    try:
        ends = datetime.strptime(" ".join(said.split()), _DATE).replace(tzinfo=UTC)
    except ValueError:
        yield Finding(WARNING, f"{certificate}: is no certificate", again)
        return
    days = (ends - wall_date()).days
    if days < 0:
        yield Finding(FAILURE, f"{certificate}: ended on {ends:%Y-%m-%d}: no phone opens the page", again)
    elif days < SOON:
        yield Finding(WARNING, f"{certificate}: ends in {days} days", again)
    else:
        yield Finding(OK, f"{certificate}: holds until {ends:%Y-%m-%d}")


def priority() -> Iterator[Finding]:
    """Whether ticks may come before other programs' work: as a service gets it, and a container by SYS_NICE."""
    now = os.getpriority(os.PRIO_PROCESS, 0)
    limit = 20 - resource.getrlimit(resource.RLIMIT_NICE)[0]  # getrlimit(2)
    if now <= WANTED_NICE:
        yield Finding(OK, f"its priority is raised (nice {now})")
    elif limit <= WANTED_NICE or os.geteuid() == 0:
        yield Finding(NOTE, f"its priority is not raised (nice {now})", f"nice -n {WANTED_NICE} artemis run MISSION")
    else:
        yield Finding(
            NOTE,
            f"this user may not raise its priority (nice {now}): other programs can delay ticks",
            "run as a service (Nice= of packaging/artemis.service), or in a container with --cap-add SYS_NICE",
        )
