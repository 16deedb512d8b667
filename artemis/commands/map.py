"""`artemis map`: the arguments of its commands. Heavy imports stay in the commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

maps = typer.Typer(
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Maps from laser scans: made of runs, shown, corrected.",
)

Output = Annotated[Path, typer.Option("--output", "-o", metavar="MAP", help="The map to write (.yaml).")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite.")]


@maps.command("build")
def build_map(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="Folders of runs, or CARMEN logs (.clf, .log, also .gz).")
    ],
    output: Output,
    resolution: Annotated[float, typer.Option(metavar="M", help="Side of a cell.")] = 0.05,
    scanner: Annotated[str | None, typer.Option(metavar="NAME", help="Of several in a run, this one.")] = None,
    mounting: Annotated[
        str, typer.Option(metavar="X,Y,DEG", help="Of a run's scanner, seen from the rear axle; x ahead, y left.")
    ] = "0,0,0",
    upside_down: Annotated[bool, typer.Option("--upside-down", help="It is mounted so.")] = False,
    without_odometry: Annotated[
        bool, typer.Option("--without-odometry", help="Do not use what the wheels say.")
    ] = False,
    force: Force = False,
) -> None:
    """Make a map of what a laser scanner saw; a run begins about where the one before ended."""
    from artemis.commands.map_build import Sources, build_map

    sources = Sources(
        runs=runs,
        scanner=scanner,
        mounting=mounting,
        upside_down=upside_down,
        odometry=not without_odometry,
    )
    build_map(sources, output, resolution, force=force)


@maps.command("show")
def show_map(
    file: Annotated[Path, typer.Argument(metavar="MAP", help="Map (.yaml); its graph is beside it.")],
    figure: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FIGURE", help="Draw it (.png, .svg, .pdf).")
    ] = None,
) -> None:
    """Say what is true of a map and its loops, and draw it."""
    from artemis.commands.map_show import show_map

    show_map(file, figure)


@maps.command("edit")
def edit_map(
    file: Annotated[Path, typer.Argument(metavar="MAP", help="Map (.yaml); its graph is beside it.")],
    output: Output,
    undo_loop: Annotated[
        list[int] | None, typer.Option(metavar="N", help="Take this loop back (see `show`); repeat for more.")
    ] = None,
    rotate: Annotated[float, typer.Option(metavar="DEG", help="Counter-clockwise, around x 0, y 0.")] = 0.0,
    crop: Annotated[str | None, typer.Option(metavar="X,Y,X,Y", help="Keep what is between two corners.")] = None,
    no_go: Annotated[
        list[str] | None, typer.Option(metavar="X,Y,X,Y,...", help="A zone to keep out of; repeat for more.")
    ] = None,
    force: Force = False,
) -> None:
    """Correct a map: loops first, then rotated, cropped, and zones closed."""
    from artemis.commands.map_edit import Edits, edit_map

    edits = Edits(loops=undo_loop or [], rotate=rotate, crop=crop, no_go=no_go or [])
    edit_map(file, output, edits, force=force)
