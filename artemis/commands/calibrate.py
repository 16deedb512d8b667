"""`artemis calibrate`: the arguments of its commands. Heavy imports stay in the commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from artemis.commands.page_options import PageAddress, PagePort, PageTls
from artemis.errors import ConfigError

calibrate = typer.Typer(
    rich_markup_mode=None, no_args_is_help=True, help="Measure a machine, or teach artemis an input device."
)
MissionFile = Annotated[Path, typer.Argument(metavar="MISSION", help="Mission file (YAML).")]


@calibrate.command("input")
def calibrate_input(
    device: Annotated[
        list[str] | None,
        typer.Option(metavar="V:P|SERIAL", help="Which device, if there are several; twice: held together."),
    ] = None,
    name: Annotated[str | None, typer.Option(help="Of the profile; the device's own, if left out.")] = None,
    output: Annotated[Path | None, typer.Option(metavar="FILE", help="Output file, instead of your profiles.")] = None,
) -> None:
    """Teach a joystick, gamepad or wheel: asks for each control, and writes the profile once that is confirmed."""
    from artemis.commands import calibrate_input

    raise typer.Exit(calibrate_input.calibrate_input(device or [], name, output))


@calibrate.command("odometry")
def calibrate_odometry(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of runs; with --machine, tables.")],
    truth: Annotated[
        list[str] | None,
        typer.Option(metavar="FILE", help="True poses of each run in turn: CSV or TUM; or `simulation`, once."),
    ] = None,
    check: Annotated[
        list[Path] | None,
        typer.Option(metavar="RUN", help="Compared, not fitted; its truth comes after the others'."),
    ] = None,
    same_clock: Annotated[bool, typer.Option("--same-clock", help="The truths' times are run times.")] = False,
    returns_to_start: Annotated[
        bool, typer.Option("--returns-to-start", help="No truth: every run ended on the marks where it started.")
    ] = False,
    closing: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Or ended there: CSV with run, x_m, y_m, heading_deg.")
    ] = None,
    machine: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Of another machine: what the columns of its tables mean.")
    ] = None,
    output: Annotated[Path | None, typer.Option(metavar="FOLDER", help="Of the page, if not the run.")] = None,
    write: Annotated[Path | None, typer.Option(metavar="ROBOT", help="Write the values into this robot file.")] = None,
) -> None:
    """Fit metres per count, steering zero and scale, and the geometry to runs; writes only when told."""
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
    scanner: Annotated[str | None, typer.Option(metavar="NAME", help="Of several, this one.")] = None,
    write: Annotated[
        Path | None, typer.Option(metavar="ROBOT", help="Write the mounting into this robot file.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Write without asking.")] = False,
) -> None:
    """Fit how a laser scanner is mounted to a drive; writes only when told."""
    from artemis.commands.calibrate_scanner import calibrate_scanner as calibrate

    calibrate(run, scanner, write, yes=yes)


@calibrate.command("battery")
def calibrate_battery(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of runs, or recordings.")],
    hold: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY", help="What the robot file has right; newtons_per_ampere, if left out."),
    ] = None,
    write: Annotated[Path | None, typer.Option(metavar="ROBOT", help="Write the values into this robot file.")] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Write without asking.")] = False,
) -> None:
    """Fit capacity, idle power, consumption and resistance of the battery to runs; writes only when told."""
    from artemis.commands.calibrate_battery import calibrate_battery as calibrate

    calibrate(runs, hold or [], write, yes=yes)


@calibrate.command("steering")
def calibrate_steering(
    mission: MissionFile,
    side: Annotated[str | None, typer.Option(metavar="left|right", help="One wheel; all, if left out.")] = None,
    reference_left: Annotated[
        float | None,
        typer.Option(metavar="DEG", min=-45, max=45, help="True angle of the left wheel while it shows 0."),
    ] = None,
    reference_right: Annotated[
        float | None, typer.Option(metavar="DEG", min=-45, max=45, help="Of the right wheel.")
    ] = None,
    reference_middle: Annotated[
        float | None, typer.Option(metavar="DEG", min=-45, max=45, help="Of what a single steering motor turns.")
    ] = None,
    new: Annotated[bool, typer.Option("--new", help="New potentiometers: ignore their calibration.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Keep the result without asking.")] = False,
    store: Annotated[bool, typer.Option("--store", help="Only write the robot file's values into the drives.")] = False,
    simulate: Annotated[bool, typer.Option("--simulate", help="Against simulated drives, whatever the bus.")] = False,
    write_simulated: Annotated[
        bool, typer.Option("--write-simulated", help="Change the robot file also by what simulated drives showed.")
    ] = False,
    page: Annotated[bool, typer.Option("--page", help="Serve a page for operators: turn the wheels there.")] = False,
    page_port: PagePort = None,
    page_address: PageAddress = None,
    page_tls: PageTls = None,
) -> None:
    """Measure zero and slope of the steering potentiometers, or the zero of what finds the angle instead."""
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
    drive: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Which; several of one kind.")] = None,
    current: Annotated[str | None, typer.Option(metavar="P,I", help="Gains of the current to try.")] = None,
    velocity: Annotated[str | None, typer.Option(metavar="P,I", help="Gains of the velocity to try.")] = None,
    position: Annotated[str | None, typer.Option(metavar="P,I,D", help="Gains of the position to try.")] = None,
    try_: Annotated[bool, typer.Option("--try", help="Try those of the robot file alone.")] = False,
    auto: Annotated[bool, typer.Option("--auto", help="Find gains to try: identify, propose, try, compare.")] = False,
    step: Annotated[float | None, typer.Option(metavar="DEG|M_S", help="Of the trial: degrees, or m/s.")] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Move, and keep gains that settle, without asking.")] = False,
    simulate: Annotated[bool, typer.Option("--simulate", help="Against simulated drives, whatever the bus.")] = False,
) -> None:
    """Show the regulator gains of a mission's drives; try others, see the response, keep them or not."""
    from artemis.commands.calibrate_gains import Wanted
    from artemis.commands.calibrate_gains import calibrate_gains as calibrate

    given = {"current": current, "velocity": velocity, "position": position}
    gains = {kind: words for kind, words in given.items() if words is not None}
    wanted = Wanted(drives=drive or (), gains=gains, tried=try_, step=step, yes=yes, simulate=simulate)
    if auto:
        from artemis.commands.gains_auto import calibrate_auto

        raise typer.Exit(calibrate_auto(mission, wanted))
    raise typer.Exit(calibrate(mission, wanted))
