"""`artemis path`: the arguments of its commands. Heavy imports stay in the commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

SPACING = 0.05
"""Default, that of `artemis.motion.track` (which imports numpy)."""

paths = typer.Typer(
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Record, import and show path files.",
)

Output = Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="Write this path file.")]
Smoothing = Annotated[
    float | None,
    typer.Option(
        metavar="M", help="Smoothing: waves of this length are halved; 0: none. Default: 0.3, more if it is noisy."
    ),
]
WithSpeed = Annotated[bool, typer.Option("--with-speed", help="Write the speeds, too.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite existing files.")]


@paths.command("record")
def record_path(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.mcap.")],
    output: Output,
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="Use the path that a step recorded by this name.")
    ] = None,
    begin: Annotated[float | None, typer.Option("--from", metavar="T", help="Run time [s].")] = None,
    end: Annotated[float | None, typer.Option("--to", metavar="T", help="Run time [s].")] = None,
    on_map: Annotated[
        Path | None,
        typer.Option("--on-map", metavar="MAP", help="Transform it to the map (.yaml) built from this run."),
    ] = None,
    close_within: Annotated[float, typer.Option(metavar="M", help="Close it if its ends are this near.")] = 0.0,
    smoothing: Smoothing = None,
    spacing: Annotated[float, typer.Option(metavar="M", help="Set the distance between points.")] = SPACING,
    speed: Annotated[float | None, typer.Option(metavar="M/S", help="Check that this speed is possible on it.")] = None,
    with_speed: WithSpeed = False,
    force: Force = False,
) -> None:
    """Write a path file from manual driving in a run, or from the interval between two run times."""
    from artemis.commands import path_record
    from artemis.errors import ConfigError

    if name is not None and (begin is not None or end is not None):
        raise ConfigError("--name and --from or --to: choose by name or by time, not by both")
    choice = path_record.RecordedPart(name=name, begin=begin, end=end, on_map=on_map)
    drawing = path_record.Drawing(
        smoothing=smoothing, spacing=spacing, close_within=close_within, with_speed=with_speed
    )
    raise typer.Exit(path_record.record_path(run, output, choice, drawing, speed=speed, force=force))


@paths.command("show")
def show_paths(
    files: Annotated[list[Path], typer.Argument(metavar="FILE", help="Path files.")],
    robot: Annotated[
        Path | None, typer.Option(metavar="ROBOT", help="Check that this robot (YAML) can drive them.")
    ] = None,
    speed: Annotated[
        float | None, typer.Option(metavar="M/S", help="Check at this speed; by default the robot's highest.")
    ] = None,
    figure: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FIGURE", help="Draw them to this file (.png).")
    ] = None,
) -> None:
    """Print length, curvature and other facts of path files, and draw them."""
    from artemis.commands import path_show

    raise typer.Exit(path_show.show_paths(files, robot, speed, figure))


@paths.command("import")
def import_path(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Table, GPX, KML, GeoJSON, or poses of ROS (YAML).")],
    output: Output,
    kind: Annotated[
        str | None,
        typer.Option(
            "--format", metavar="csv|gpx|kml|geojson|nav2", help="Read it as this format; by default by its suffix."
        ),
    ] = None,
    closed: Annotated[bool, typer.Option("--closed", help="Close the path.")] = False,
    reverse: Annotated[bool, typer.Option("--reverse", help="Reverse it: from its last point to its first.")] = False,
    origin: Annotated[bool, typer.Option("--origin", help="Move it, so that it begins at 0, 0 along x.")] = False,
    smoothing: Smoothing = None,
    with_speed: WithSpeed = False,
    force: Force = False,
) -> None:
    """Convert a file of another program to a path file."""
    from artemis.commands import path_import

    path_import.import_path(
        file,
        output,
        kind,
        smoothing=smoothing,
        closed=closed,
        reverse=reverse,
        origin=origin,
        with_speed=with_speed,
        force=force,
    )
