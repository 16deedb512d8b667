"""The page for operators, as the command line knows it: its options, and how a browser is paired with it."""

from __future__ import annotations

import socket
import sys
from collections.abc import Sequence
from contextlib import suppress
from ipaddress import ip_address
from pathlib import Path
from typing import Any

from artemis.build import require
from artemis.mission.loading import LoadedMission, plugin_from
from artemis.mission.page import PAGE
from artemis.mission.problems import checked
from artemis.page.access import grouped, key_place, new_code, read_key
from artemis.page.certificates import kept, make, names
from artemis.page.observer import PageObserverConfig, url_of

ANSWERS = 2.0
"""A page accepts a connection within this time [s]."""


def page_options(port: int | None, address: str | None, tls: tuple[Path, Path] | None) -> dict[str, Any]:
    """Keys of the page's observer, from the command line; those that were not given are left out.

    For other computers the certificate is taken that `artemis page certificate` made.
    """
    given: dict[str, Any] = {} if port is None else {"port": port}
    if address is not None:
        given["listen"] = address
        with suppress(ValueError):  # the observer says what is wrong with it
            tls = tls or (None if ip_address(address).is_loopback else kept())
    if tls is not None:
        certificate, key = tls
        given["tls"] = {"certificate": str(certificate.absolute()), "key": str(key.absolute())}
    return given


def page_of(loaded: LoadedMission) -> PageObserverConfig | None:
    """The page that a run of the mission serves; None: it serves none."""
    for use in loaded.mission.observers.values():
        if use.plugin == PAGE:
            _, config = plugin_from("artemis.observers", use)
            return config if isinstance(config, PageObserverConfig) else None
    return None


def certify(given: Sequence[str]) -> None:
    """Make certificates, and say what to do with them. Raises ConfigError."""
    authority = make(given)
    sys.stdout.write(f"for           {', '.join(names(given))}\n")
    sys.stdout.write(f"kept in       {authority.parent}; a page at an address for other computers finds them there\n")
    sys.stdout.write(f"trust         {authority}: install it, once, on every phone and computer that opens the page\n")


def pair(port: int | None, address: str | None) -> None:
    """Say how one more browser is paired, and whether a page is there. Raises ConfigError."""
    config = checked(PageObserverConfig, page_options(port, address, None))
    try:
        socket.create_connection((config.listen, config.port), ANSWERS).close()
    except OSError as error:
        sys.stdout.write(
            f"warning       nothing answers at {url_of(config)} ({error.strerror or error}): is a page served now, at "
            "this address and port? --page-address A, --page-port N\n"
        )
    announce(config)


def announce(config: PageObserverConfig | None) -> None:
    """Say how a browser is paired with a page: an address with a code that is good once, in a terminal also a QR code.

    Raises:
        ConfigError: the extra is not installed, or the page's key is bad.
    """
    if config is None:
        return
    require("the page", "web", "segno")
    import segno

    code, url = new_code(read_key(key_place())), url_of(config)
    address = f"{url}/pair#{code}"
    sys.stdout.write(f"page          {address}\n")
    if sys.stdout.isatty():
        segno.make(address, error="l").terminal(sys.stdout, border=1, compact=True)
    sys.stdout.write(f"              or {url} and the code {grouped(code)}; it is good once, for ten minutes\n")
    sys.stdout.flush()
