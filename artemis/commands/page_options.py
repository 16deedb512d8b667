"""Options of the page for operators, as commands have them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

PagePort = Annotated[int | None, typer.Option("--page-port", metavar="N", min=1, max=65535, help="Its port (8480).")]
PageAddress = Annotated[
    str | None, typer.Option("--page-address", metavar="A", help="Address of this computer to serve it at (127.0.0.1).")
]
PageTls = Annotated[
    tuple[Path, Path] | None, typer.Option("--page-tls", metavar="CERT KEY", help="Files of TLS, for other computers.")
]
