"""`artemis plugins`: its arguments."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from artemis.commands.completion import kinds

plugins = typer.Typer(rich_markup_mode=None, invoke_without_command=True)


@plugins.callback()
def list_plugins(context: typer.Context) -> None:
    """List installed plugins with their origin, and errors of broken ones; `new` writes one of your own."""
    if context.invoked_subcommand is None:
        from artemis.commands.plugins import show_plugins

        raise typer.Exit(show_plugins())


@plugins.command("new")
def new_plugin(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="input|follower|localizer|scanner|observer|behaviour",
            help="Kind of plugin.",
            autocompletion=kinds,
        ),
    ],
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the plugin in missions.")],
    folder: Annotated[Path, typer.Option(help="Create the package in this folder.")] = Path(),
) -> None:
    """Write a package artemis-NAME: a working plugin, its tests, and a mission that uses it."""
    from artemis.commands.plugins import begin_plugin

    begin_plugin(kind, name, folder)
