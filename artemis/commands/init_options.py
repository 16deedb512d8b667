"""The command `artemis init`: its arguments; what it does is in `init`, which imports more."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder to write to, created if missing.")] = Path(),
    yes: Annotated[bool, typer.Option("--yes", help="Use the numbers of the robot without asking.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
    like: Annotated[
        str | None,
        typer.Option(
            "--like",
            metavar="ROBOT",
            help="Robot to begin with: artemis, epos4, cia402, rear-driven, tricycle, small-car.",
        ),
    ] = None,
) -> None:
    """Ask for the numbers of a machine, and write its robot file and a first mission for simulated drives."""
    from artemis.commands.init import begin

    begin(folder, ask=not yes, force=force, like=like)
