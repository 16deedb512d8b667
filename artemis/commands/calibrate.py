"""`artemis calibrate`: the arguments of its commands. Heavy imports stay in the commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from artemis.commands.page_options import PageAddress, PagePort, PageTls
from artemis.errors import ConfigError

calibrate = typer.Typer(rich_markup_mode=None, no_args_is_help=True, help="Calibrate a machine or an input device.")
MissionFile = Annotated[Path, typer.Argument(metavar="MISSION", help="Mission file (YAML).")]


@calibrate.command("input")
def calibrate_input(
    device: Annotated[
        list[str] | None,
        typer.Option(metavar="V:P|SERIAL", help="Choose the device; twice: two devices as one profile."),
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name the profile; by default as the device.")] = None,
    output: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write this file instead of your profiles.")
    ] = None,
) -> None:
    """Teach a joystick, gamepad or wheel: ask for each control, and write the profile when it is confirmed."""
    from artemis.commands import calibrate_input

    raise typer.Exit(calibrate_input.calibrate_input(device or [], name, output))


@calibrate.command("odometry")
def calibrate_odometry(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN", help="Folders of runs; with --machine, tables.")],
    truth: Annotated[
        list[str] | None,
        typer.Option(metavar="FILE", help="Use true poses, one file per run: CSV or TUM; or `simulation`, once."),
    ] = None,
    check: Annotated[
        list[Path] | None,
        typer.Option(metavar="RUN", help="Compare this run, do not fit it; its truth comes last."),
    ] = None,
    same_clock: Annotated[bool, typer.Option("--same-clock", help="Take the truths' times as run times.")] = False,
    returns_to_start: Annotated[
        bool, typer.Option("--returns-to-start", help="Use no truth: every run ended on its start marks.")
    ] = False,
    closing: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Use these ends: CSV with run, x_m, y_m, heading_deg.")
    ] = None,
    machine: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Read tables of another machine: their columns.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Write the page to this folder, not to the run's.")
    ] = None,
    write: Annotated[Path | None, typer.Option(metavar="ROBOT", help="Write the values into this robot file.")] = None,
) -> None:
    """Fit metres per count, steering zero and scale, and the geometry to runs; write only with --write."""
    from artemis.commands import calibrate_odometry

    if (returns_to_start or closing) and (truth or check or same_clock):
        raise ConfigError("--truth, --check and --same-clock do not go with --returns-to-start or --closing")
    if returns_to_start or closing:
        calibrate_odometry.calibrate_closing(runs, closing, machine, output, write)
    else:
        calibrate_odometry.calibrate_with_truth(runs, truth or [], machine, check or [], output, write, same_clock)


@calibrate.command("scanner")
def calibrate_scanner(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.")],
    scanner: Annotated[str | None, typer.Option(metavar="NAME", help="Use this one of several scanners.")] = None,
    write: Annotated[
        Path | None, typer.Option(metavar="ROBOT", help="Write the mounting into this robot file.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Write without asking.")] = False,
) -> None:
    """Fit the mounting of a laser scanner from a recorded drive; write only with --write."""
    from artemis.commands.calibrate_scanner import calibrate_scanner as calibrate

    calibrate(run, scanner, write, yes=yes)


@calibrate.command("battery")
def calibrate_battery(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN", help="Folders of runs, or recordings.")],
    hold: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY", help="Keep this value of the robot file (newtons_per_ampere)."),
    ] = None,
    write: Annotated[Path | None, typer.Option(metavar="ROBOT", help="Write the values into this robot file.")] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Write without asking.")] = False,
) -> None:
    """Fit capacity, idle power, consumption and resistance of the battery to runs; write only with --write."""
    from artemis.commands.calibrate_battery import calibrate_battery as calibrate

    calibrate(runs, hold or [], write, yes=yes)


@calibrate.command("steering")
def calibrate_steering(
    mission: MissionFile,
    side: Annotated[str | None, typer.Option(metavar="left|right", help="Calibrate this wheel only.")] = None,
    reference_left: Annotated[
        float | None,
        typer.Option(metavar="DEG", min=-45, max=45, help="Set the left wheel's true angle while it shows 0."),
    ] = None,
    reference_right: Annotated[
        float | None,
        typer.Option(metavar="DEG", min=-45, max=45, help="Set the right wheel's true angle while it shows 0."),
    ] = None,
    reference_middle: Annotated[
        float | None,
        typer.Option(metavar="DEG", min=-45, max=45, help="Set the true angle for a single steering motor."),
    ] = None,
    new: Annotated[bool, typer.Option("--new", help="Ignore the calibration: the potentiometers are new.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Keep the result without asking.")] = False,
    store: Annotated[bool, typer.Option("--store", help="Only store the robot file's values in the drives.")] = False,
    simulate: Annotated[bool, typer.Option("--simulate", help="Use simulated drives instead of the bus.")] = False,
    write_simulated: Annotated[
        bool, typer.Option("--write-simulated", help="Write results of simulated drives to the robot file, too.")
    ] = False,
    page: Annotated[bool, typer.Option("--page", help="Serve a page for operators: turn the wheels there.")] = False,
    page_port: PagePort = None,
    page_address: PageAddress = None,
    page_tls: PageTls = None,
) -> None:
    """Measure zero and slope of the steering potentiometers, or the zero of another angle sensor."""
    from artemis.commands import calibrate_steering
    from artemis.commands.page import page_options

    options = page_options(page_port, page_address, page_tls)
    served = options if page or options else None
    given = {"left": reference_left, "right": reference_right, "middle": reference_middle}
    reference = {name: angle for name, angle in given.items() if angle is not None}
    if not store:
        raise typer.Exit(
            calibrate_steering.calibrate_steering(
                mission,
                side,
                reference,
                new=new,
                yes=yes,
                simulate=simulate,
                write_simulated=write_simulated,
                page=served,
            )
        )
    if side or reference or new or yes or write_simulated or served is not None:
        raise ConfigError("--store writes what the robot file says: it measures nothing, and takes no other option")
    raise typer.Exit(calibrate_steering.store_steering(mission, simulate))


@calibrate.command("gains")
def calibrate_gains(
    mission: MissionFile,
    drive: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Choose the drive; repeat for more of one kind.")
    ] = None,
    current: Annotated[
        str | None, typer.Option(metavar="P,I", help="Try these gains of the current regulator.")
    ] = None,
    velocity: Annotated[
        str | None, typer.Option(metavar="P,I", help="Try these gains of the velocity regulator.")
    ] = None,
    position: Annotated[
        str | None, typer.Option(metavar="P,I,D", help="Try these gains of the position regulator.")
    ] = None,
    try_: Annotated[bool, typer.Option("--try", help="Try only the gains of the robot file.")] = False,
    auto: Annotated[bool, typer.Option("--auto", help="Find gains to try: identify, propose, try, compare.")] = False,
    step: Annotated[
        float | None, typer.Option(metavar="DEG|M_S", help="Set the step of the trial: degrees, or m/s.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Move, and keep gains that settle, without asking.")] = False,
    simulate: Annotated[bool, typer.Option("--simulate", help="Use simulated drives instead of the bus.")] = False,
) -> None:
    """Show the regulator gains of a mission's drives; try others, show the response, keep them or not."""
    from artemis.commands.calibrate_gains import Wanted
    from artemis.commands.calibrate_gains import calibrate_gains as calibrate

    given = {"current": current, "velocity": velocity, "position": position}
    gains = {kind: words for kind, words in given.items() if words is not None}
    wanted = Wanted(drives=drive or (), gains=gains, tried=try_, step=step, yes=yes, simulate=simulate)
    if auto:
        from artemis.commands.gains_auto import calibrate_auto

        raise typer.Exit(calibrate_auto(mission, wanted))
    raise typer.Exit(calibrate(mission, wanted))
