"""The page for operators on the command line: its options, as commands have them, and the command `page`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from artemis.errors import ConfigError

PagePort = Annotated[int | None, typer.Option("--page-port", metavar="N", min=1, max=65535, help="Its port (8480).")]
PageAddress = Annotated[
    str | None, typer.Option("--page-address", metavar="A", help="Address of this computer to serve it at (127.0.0.1).")
]
PageTls = Annotated[
    tuple[Path, Path] | None, typer.Option("--page-tls", metavar="CERT KEY", help="Files of TLS, for other computers.")
]


def page(
    what: Annotated[str, typer.Argument(metavar="FOLDER|pair|certificate", help="Missions; pair: one more browser.")],
    names: Annotated[list[str] | None, typer.Argument(metavar="[NAME...]", help="certificate: also for these.")] = None,
    page_port: PagePort = None,
    page_address: PageAddress = None,
    page_tls: PageTls = None,
) -> None:
    """Wait for an operator who chooses a mission of a folder at the page; pair browsers, or make certificates."""
    from artemis.commands.page import certify, page_options, pair

    if what == "certificate":
        certify(names or [])
    elif names:
        raise ConfigError(f"page: expected a folder, pair, or certificate with names; found {' '.join([what, *names])}")
    elif what == "pair":
        pair(page_port, page_address)
    else:
        from artemis.commands.waiting import wait_for_operators

        raise typer.Exit(wait_for_operators(Path(what), page_options(page_port, page_address, page_tls)))
