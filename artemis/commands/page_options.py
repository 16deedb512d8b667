"""The page for operators on the command line: its options, as commands have them, and the command `page`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from artemis.errors import ConfigError

PagePort = Annotated[
    int | None, typer.Option("--page-port", metavar="N", min=1, max=65535, help="Set its port (8480).")
]
PageAddress = Annotated[
    str | None, typer.Option("--page-address", metavar="A", help="Serve it at this address (127.0.0.1).")
]
PageTls = Annotated[
    tuple[Path, Path] | None,
    typer.Option("--page-tls", metavar="CERT KEY", help="Use TLS, for other computers: certificate and key."),
]


def page(
    what: Annotated[
        str, typer.Argument(metavar="FOLDER|pair|certificate", help="Folder of missions; pair: pair another browser.")
    ],
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME...]", help="certificate: include these names, too.")
    ] = None,
    page_port: PagePort = None,
    page_address: PageAddress = None,
    page_tls: PageTls = None,
) -> None:
    """Serve a page on which an operator starts a mission of a folder; pair browsers, or make certificates."""
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
