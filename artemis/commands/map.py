"""`artemis map`: the arguments of its commands. Heavy imports stay in the commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from artemis.errors import ConfigError

maps = typer.Typer(
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Build, show and edit maps from laser scans.",
)

Output = Annotated[Path, typer.Option("--output", "-o", metavar="MAP", help="Write the map to this file (.yaml).")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite existing files.")]


@maps.command("build")
def build_map(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN", help="Folders of runs, or CARMEN logs (.clf, .log, also .gz).")
    ],
    output: Output,
    resolution: Annotated[float, typer.Option(metavar="M", help="Set the side of a cell.")] = 0.05,
    scanner: Annotated[str | None, typer.Option(metavar="NAME", help="Use this one of several scanners.")] = None,
    without_odometry: Annotated[bool, typer.Option("--without-odometry", help="Do not use the odometry.")] = False,
    begun: Annotated[
        Path | None, typer.Option("--continue", metavar="MAP", help="Extend this map (.yaml), from its graph.")
    ] = None,
    force: Force = False,
) -> None:
    """Build a map from laser scans; each further run has to begin where those before have been."""
    from artemis.commands.map_build import Sources, build_map

    sources = Sources(
        runs=runs,
        scanner=scanner,
        odometry=not without_odometry,
        begun=begun,
    )
    build_map(sources, output, resolution, force=force)


@maps.command("show")
def show_map(
    file: Annotated[Path, typer.Argument(metavar="MAP", help="Map (.yaml); its graph is beside it.")],
    figure: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FIGURE", help="Draw it to this file (.png, .svg, .pdf).")
    ] = None,
    begin: Annotated[
        str | None, typer.Option("--from", metavar="PLACE|X,Y,DEG", help="Plan a route from this place or pose.")
    ] = None,
    end: Annotated[
        str | None, typer.Option("--to", metavar="PLACE|X,Y,DEG", help="Plan a route to this place or pose.")
    ] = None,
    robot: Annotated[
        Path | None, typer.Option(metavar="ROBOT", help="Plan the route for this robot file (YAML).")
    ] = None,
) -> None:
    """Print the facts of a map, its loops, zones and places, and draw it, with a planned route."""
    from artemis.commands.map_show import show_map

    if None in (begin, end, robot) and (begin, end, robot) != (None, None, None):
        raise ConfigError("a route needs all of --from, --to and --robot")
    wanted = None if begin is None or end is None or robot is None else (begin, end, robot)
    show_map(file, figure, wanted)


@maps.command("edit")
def edit_map(
    file: Annotated[Path, typer.Argument(metavar="MAP", help="Map (.yaml); graph, zones and places are beside it.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="MAP", help="Write this map (.yaml); zones and places: in place."),
    ] = None,
    undo_loop: Annotated[
        list[int] | None, typer.Option(metavar="N", help="Undo this loop (see `show`); repeat for more.")
    ] = None,
    rotate: Annotated[float, typer.Option(metavar="DEG", help="Rotate it counter-clockwise, around x 0, y 0.")] = 0.0,
    crop: Annotated[str | None, typer.Option(metavar="X,Y,X,Y", help="Keep the rectangle between two corners.")] = None,
    no_go: Annotated[
        list[str] | None, typer.Option(metavar="X,Y,X,Y,...", help="Close a part of the image; repeat for more.")
    ] = None,
    zone: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=KIND:X,Y,...", help="Add a zone: keep-out, prefer or slow@M_S; repeat for more."),
    ] = None,
    place: Annotated[
        list[str] | None, typer.Option(metavar="NAME=X,Y,DEG", help="Add a place for the rear axle; repeat for more.")
    ] = None,
    remove_zone: Annotated[
        list[str] | None, typer.Option(metavar="NAME|N", help="Remove a zone by its name or number (see `show`).")
    ] = None,
    remove_place: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Remove a place by its name.")] = None,
    force: Force = False,
) -> None:
    """Edit a map: undo loops, then rotate, crop and close parts of it; change its zones and places."""
    from artemis.commands.map_edit import Edits, edit_map
    from artemis.commands.map_zones import ZoneEdits

    zones = ZoneEdits(
        remove_zones=remove_zone or [], remove_places=remove_place or [], zones=zone or [], places=place or []
    )
    edits = Edits(loops=undo_loop or [], rotate=rotate, crop=crop, no_go=no_go or [], zones=zones)
    edit_map(file, output, edits, force=force)
