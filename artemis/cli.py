"""The command line: parses arguments, turns errors into words and exit statuses. Heavy imports stay in the commands."""

from __future__ import annotations

import errno
import io
import logging
import os
import sys
import threading
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated

import typer

from artemis.commands.path import paths
from artemis.commands.plugin import plugins
from artemis.errors import ArtemisError, ConfigError, RecordingError
from artemis.plugins.process import exit_refused, leave_threads

FAILED, REFUSED, OWN_BUG = 1, 2, 70
COMMANDS = "artemis.commands"
"""Entry points of packages that add commands: functions that take the `typer.Typer` below, and import nothing heavy."""

app = typer.Typer(
    name="artemis",
    rich_markup_mode=None,
    add_completion=True,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)

app.add_typer(plugins, name="plugins")
app.add_typer(paths, name="path")

calibrate = typer.Typer(
    rich_markup_mode=None, no_args_is_help=True, help="Measure a machine, or teach artemis an input device."
)
app.add_typer(calibrate, name="calibrate")

MissionFile = Annotated[Path, typer.Argument(metavar="MISSION", help="Mission file (YAML).")]
RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.mcap.")]


def _tell_version(asked: bool) -> None:
    if asked:
        from artemis.build import described

        typer.echo(described())
        raise typer.Exit


@app.callback()
def common(
    _version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_tell_version, is_eager=True)
    ] = False,
) -> None:
    """Drive robots with maxon EPOS motor controllers: missions, simulated drives, recordings."""


@app.command()
def run(
    mission: MissionFile,
    simulate: Annotated[bool, typer.Option("--simulate", help="Against simulated drives, whatever the bus.")] = False,
    resume: Annotated[Path | None, typer.Option(metavar="RUN", help="Resume that run where it stopped.")] = None,
) -> None:
    """Run a mission: bring the drives up, align, do its steps, stop, leave a recording and a report."""
    from artemis.commands.run import run_and_report

    raise typer.Exit(run_and_report(mission, simulate, resume))


@app.command()
def check(missions: Annotated[list[Path], typer.Argument(metavar="MISSION...", help="Mission files (YAML).")]) -> None:
    """Say everything that `run` would refuse, without moving."""
    from artemis.mission.loading import load_mission

    problems: list[str] = []
    for mission in missions:
        try:
            loaded = load_mission(mission)
            typer.echo("\n  ".join([f"{mission}: ok", *loaded.remarks]))
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(list(dict.fromkeys(problems)))  # two missions may name one broken robot


@app.command()
def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Where to; made if it is not there.")] = Path(),
    yes: Annotated[bool, typer.Option("--yes", help="Ask nothing: the machine is ARTEMIS.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace files that are there.")] = False,
) -> None:
    """Ask for the machine, and write its robot file and a first mission, which run simulated at once."""
    from artemis.commands.init import begin

    begin(folder, ask=not yes, force=force)


@app.command()
def doctor(
    mission: Annotated[
        Path | None, typer.Option("--mission", metavar="M", help="Also what this mission needs; asks its drives.")
    ] = None,
    report: Annotated[bool, typer.Option("--report", help="Everything, to paste where you ask for help.")] = False,
) -> None:
    """Check this computer: packages, CAN, input devices, plugins, disk, clock, timing; for each problem, what to do."""
    from artemis.commands.doctor import examine

    raise typer.Exit(examine(mission, report=report))


@app.command()
def sim(
    robot: Annotated[Path, typer.Argument(metavar="ROBOT", help="Robot file (YAML).")],
    interface: Annotated[str, typer.Option(help="python-can's name of the back end.")],
    channel: Annotated[str, typer.Option(help="Channel, as python-can calls it.")],
    option: Annotated[list[str] | None, typer.Option(metavar="K=V", help="Extra python-can option.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the random numbers.")] = 1,
    true: Annotated[
        Path | None, typer.Option("--true", metavar="FILE", help="True parameters of the simulated machine.")
    ] = None,
) -> None:
    """Simulate the robot's drives on a real bus, in real time, for any CANopen tool. Ctrl-C ends it."""
    from artemis.commands.simulate import simulate

    simulate(robot, interface, channel, option or [], seed, true)


@app.command()
def report(
    run: RunFolder,
    truth: Annotated[
        str | None, typer.Option(metavar="FILE", help="True poses: CSV or TUM, or `simulation` for its own.")
    ] = None,
    align: Annotated[
        str | None, typer.Option(metavar="none|start|best", help="How its frame is made one with the run's.")
    ] = None,
    sensor: Annotated[
        str | None, typer.Option(metavar="X,Y[,DEG]", help="Its tracker on the robot: m ahead, left of the rear axle.")
    ] = None,
    same_clock: Annotated[bool, typer.Option("--same-clock", help="Its times are run times.")] = False,
    export: Annotated[str | None, typer.Option(metavar="tum", help="Also write the trajectories.")] = None,
) -> None:
    """Write the page of a run: figures, numbers, events; with a truth, also how far from it the odometry was."""
    from artemis.commands.report import report

    report(run, truth, align, sensor, same_clock, export)


@app.command()
def replay(run: RunFolder) -> None:
    """Recompute every command of a run from its recording, and compare bit for bit."""
    from artemis.commands.replay import replay_run

    raise typer.Exit(replay_run(run))


@app.command()
def devices(
    mission: Annotated[
        Path | None, typer.Option("--mission", metavar="M", help="Also ask the drives on its bus.")
    ] = None,
) -> None:
    """List CAN adapters, joysticks, gamepads and wheels; with a mission also the drives that answer."""
    from artemis.commands.devices import show_devices

    show_devices(mission)


@calibrate.command("input")
def calibrate_input(
    device: Annotated[
        str | None, typer.Option(metavar="V:P|SERIAL", help="Which device, if there are several.")
    ] = None,
    name: Annotated[str | None, typer.Option(help="Of the profile; the device's own, if left out.")] = None,
    output: Annotated[Path | None, typer.Option(metavar="FILE", help="Output file, instead of your profiles.")] = None,
) -> None:
    """Teach a joystick, gamepad or wheel: asks for each control, and writes the profile once that is confirmed."""
    from artemis.commands import calibrate_input

    raise typer.Exit(calibrate_input.calibrate_input(device, name, output))


@calibrate.command("odometry")
def calibrate_odometry(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of runs; with --machine, tables.")],
    truth: Annotated[
        list[str] | None,
        typer.Option(metavar="FILE", help="True poses of each run in turn: CSV or TUM; or `simulation`, once."),
    ] = None,
    check: Annotated[
        list[Path] | None,
        typer.Option(metavar="RUN", help="Not fitted, only compared; its truth comes after the others'."),
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


@calibrate.command("steering")
def calibrate_steering(
    mission: MissionFile,
    side: Annotated[str | None, typer.Option(metavar="left|right", help="One wheel; both, if left out.")] = None,
    reference_left: Annotated[
        float | None,
        typer.Option(metavar="DEG", min=-45, max=45, help="True angle of the left wheel while it shows 0."),
    ] = None,
    reference_right: Annotated[
        float | None, typer.Option(metavar="DEG", min=-45, max=45, help="Of the right wheel.")
    ] = None,
    new: Annotated[bool, typer.Option("--new", help="New potentiometers: ignore their calibration.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Keep the result without asking.")] = False,
    store: Annotated[bool, typer.Option("--store", help="Only write the robot file's values into the drives.")] = False,
    simulate: Annotated[bool, typer.Option("--simulate", help="Against simulated drives, whatever the bus.")] = False,
    write_simulated: Annotated[
        bool, typer.Option("--write-simulated", help="Change the robot file also by what simulated drives showed.")
    ] = False,
) -> None:
    """Measure zero and slope of the steering potentiometers; keep them in the drives and the robot file."""
    from artemis.commands import calibrate_steering

    given = {"left": reference_left, "right": reference_right}
    reference = {name: angle for name, angle in given.items() if angle is not None}
    if not store:
        raise typer.Exit(
            calibrate_steering.calibrate_steering(
                mission, side, reference, new=new, yes=yes, simulate=simulate, write_simulated=write_simulated
            )
        )
    if side or reference or new or yes or write_simulated:
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
    raise typer.Exit(calibrate(mission, wanted))


@app.command()
def graph() -> None:
    """Print the robot's modes as a Mermaid diagram, from the table that runs."""
    from artemis.states.machine import mermaid

    typer.echo(mermaid())


@app.command()
def faults(
    ids: Annotated[
        list[str] | None, typer.Argument(metavar="[ID...]", help="Rows such as DRV-25; all if left out.")
    ] = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="As the page of the documentation.")] = False,
) -> None:
    """Show the fault table: what is noticed, how fast, what follows, how it goes on."""
    from artemis.commands.faults import show_faults

    show_faults(ids or [], markdown)


@app.command()
def schema(kind: Annotated[str, typer.Argument(metavar="mission|robot", help="Of which file.")] = "mission") -> None:
    """Print the JSON schema of a mission or robot file, for editors."""
    import json

    from artemis.mission.json_schema import mission_schema, robot_schema

    if kind not in ("mission", "robot"):
        raise ConfigError(f"no schema of {kind!r}: write mission or robot")
    typer.echo(json.dumps(mission_schema() if kind == "mission" else robot_schema(), indent=2))


def _add_commands() -> None:
    """Those of other packages; one that is broken harms nobody else."""
    for point in sorted(entry_points(group=COMMANDS)):
        try:
            point.load()(app)
        except (Exception, SystemExit) as error:  # noqa: BLE001  a stranger's module may raise anything
            print(f"artemis: no commands of {point.value}: {type(error).__name__}: {error}", file=sys.stderr)


_add_commands()


def main() -> None:
    """Entry point. What artemis raises on purpose becomes its message; anything else is our own bug: status 70."""
    _prepare_output()
    before, status = set(threading.enumerate()), 0
    try:
        with exit_refused():
            app()
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
        if isinstance(ended.code, str):  # as Python does it
            print(ended.code, file=sys.stderr)
    except Exception as error:  # noqa: BLE001  nothing but the shell is above it
        status = _explain(error)
    try:
        sys.stdout.flush()
    except OSError as error:
        status = _explain(error)
    leave_threads(before, status)
    sys.exit(status)


def _prepare_output() -> None:
    """Words that a terminal cannot show, and a missing standard output, must not stop a robot.

    What python-can logs it also raises, and then it is said once, in our words.
    """
    for name in ("can", "seeedbus"):
        logging.getLogger(name).addHandler(logging.NullHandler())
    if sys.stdout is None:
        sys.stdout = open(os.devnull, "w")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


def _explain(error: Exception) -> int:
    """Print what went wrong; the exit status."""
    match error:
        case ConfigError(problems=problems):
            print(*problems, sep="\n", file=sys.stderr)
            return REFUSED
        case RecordingError():
            print(f"artemis: {error}", file=sys.stderr)
            return REFUSED
        case OSError(filename=None, errno=errno.ENOSPC | errno.EDQUOT | errno.EFBIG | errno.EIO):
            from artemis.commands.terminal import lose_output

            lose_output()
            print(f"artemis: standard output cannot be written: {error.strerror}", file=sys.stderr)
            return FAILED
        case ArtemisError():
            print(f"artemis: {error}", file=sys.stderr)
            return FAILED
        case ExceptionGroup() if error.split(ArtemisError)[1] is None:  # out of the tasks of a run that was under way
            for part in error.exceptions:
                _explain(part)
            return FAILED
    import traceback

    traceback.print_exception(error)
    print("artemis: this is a bug in artemis; a running robot was commanded to stop", file=sys.stderr)
    return OWN_BUG
