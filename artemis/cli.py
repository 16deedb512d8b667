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

from artemis.commands.calibrate import MissionFile, calibrate
from artemis.commands.completion import rows
from artemis.commands.init_options import init
from artemis.commands.map import maps
from artemis.commands.page_options import PageAddress, PagePort, PageTls, page
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

app.command()(page)
app.add_typer(plugins, name="plugins")
app.add_typer(maps, name="map")
app.add_typer(paths, name="path")
app.add_typer(calibrate, name="calibrate")

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
    simulate: Annotated[bool, typer.Option("--simulate", help="Use simulated drives instead of the bus.")] = False,
    resume: Annotated[Path | None, typer.Option(metavar="RUN", help="Resume that run where it stopped.")] = None,
    page: Annotated[bool, typer.Option("--page", help="Serve a page for operators: see, stop, drive.")] = False,
    page_port: PagePort = None,
    page_address: PageAddress = None,
    page_tls: PageTls = None,
    started_by_page: Annotated[str | None, typer.Option(metavar="HASH", hidden=True)] = None,
) -> None:
    """Run a mission: bring the drives up, align the wheels, do its steps, stop, write a recording and a report."""
    from artemis.commands.page import page_options
    from artemis.commands.run import run_and_report

    options = page_options(page_port, page_address, page_tls)
    if started_by_page is not None:  # with the hash of what was checked there
        options["started_by_page"] = True
    served = options if page or options else None
    raise typer.Exit(run_and_report(mission, simulate, resume, served, started_by_page))


@app.command()
def check(
    missions: Annotated[list[Path], typer.Argument(metavar="MISSION", help="Mission files (YAML).")],
    walk: Annotated[
        int, typer.Option(metavar="N", min=0, max=100_000, help="Report the steps that N random walks never reach.")
    ] = 0,
    seed: Annotated[int, typer.Option(help="Set the seed of the random walks.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print a line of JSON for each mission.")] = False,
    with_page: Annotated[bool, typer.Option("--page", help="Check as for `run --page`; with --json.")] = False,
) -> None:
    """Report everything that `run` would refuse, without moving."""
    if as_json:
        from artemis.commands.check import tell_as_json

        raise typer.Exit(0 if tell_as_json(missions, page=with_page) else REFUSED)
    from artemis.mission.extras import slower_without_numba
    from artemis.mission.loading import load_mission
    from artemis.mission.random_walks import walked
    from artemis.planning import check_drivable, is_simulated

    problems: list[str] = []
    for mission in missions:
        try:
            loaded = load_mission(mission)
            check_drivable(loaded, mission, is_simulated(loaded))
            remarks = [*loaded.remarks, *slower_without_numba(loaded), *walked(loaded, walk, seed)]
            typer.echo("\n  ".join([f"{mission}: ok", *remarks]))
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(list(dict.fromkeys(problems)))  # two missions may name one broken robot


app.command()(init)


@app.command()
def doctor(
    mission: Annotated[
        Path | None,
        typer.Option("--mission", metavar="M", help="Check for this mission, too; query its drives."),
    ] = None,
    report: Annotated[bool, typer.Option("--report", help="Print a full report for a request for help.")] = False,
) -> None:
    """Check packages, CAN, input devices, plugins, disk, clock and timing of this computer; print remedies."""
    from artemis.commands.doctor import examine

    raise typer.Exit(examine(mission, report=report))


@app.command()
def sim(
    robot: Annotated[Path, typer.Argument(metavar="ROBOT", help="Robot file (YAML).")],
    interface: Annotated[str | None, typer.Option(help="Use this back end of python-can.")] = None,
    channel: Annotated[str | None, typer.Option(help="Use this channel of python-can.")] = None,
    option: Annotated[list[str] | None, typer.Option(metavar="K=V", help="Pass an extra option to python-can.")] = None,
    seed: Annotated[int, typer.Option(help="Set the seed of the random numbers.")] = 1,
    true: Annotated[
        Path | None, typer.Option("--true", metavar="FILE", help="Set the true parameters of the simulated machine.")
    ] = None,
    scanner: Annotated[
        list[str] | None,
        typer.Option(metavar="[NAME=]HOST:PORT", help="Serve a scanner of the robot here; port 0: any."),
    ] = None,
    world: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Set what the scanners see: a simulation.world.")
    ] = None,
    serial: Annotated[
        str | None, typer.Option(metavar="epos1|epos4", help="Use a pseudo-terminal instead, with this protocol.")
    ] = None,
    baud: Annotated[int, typer.Option(help="Set the baud rate of that serial line.")] = 115200,
    latency: Annotated[float, typer.Option("--latency-ms", min=0, help="Set the latency of its USB adapter.")] = 0.0,
) -> None:
    """Simulate the robot's drives on a real bus in real time, and its scanners over TCP.

    Or its first drive on a serial line, for any program that opens a port. Ctrl-C ends it.
    """
    if serial is not None:
        from artemis.commands.simulate_serial import simulate_serial

        if interface or channel or option or scanner or world:
            raise ConfigError("--serial goes with --baud, --latency-ms, --seed and --true only")
        simulate_serial(robot, serial, baud, latency / 1000.0, seed, true)
        return
    from artemis.commands.simulate import simulate

    if interface is None or channel is None:
        raise ConfigError("sim: write --interface and --channel of a CAN bus, or --serial epos1")
    simulate(robot, interface, channel, option or [], seed, true, scanner or [], world)


@app.command()
def operator(
    address: Annotated[
        str, typer.Argument(metavar="ADDRESS|pair", help="Address of the robot, HOST[:PORT]; pair: share a secret.")
    ],
    device: Annotated[
        str, typer.Option("--input", metavar="NAME", help="Use an input plugin, stick, or an input of --mission.")
    ] = "stick",
    mission: Annotated[Path | None, typer.Option(metavar="M", help="Use the inputs of this mission.")] = None,
    option: Annotated[list[str] | None, typer.Option(metavar="K=V", help="Set a key of the input plugin.")] = None,
    stop: Annotated[bool, typer.Option("--stop", help="Stop the robot, whichever operator drives it.")] = False,
    name: Annotated[str | None, typer.Option(metavar="WHO", help="Set your name in the robot's journal.")] = None,
    secret: Annotated[Path | None, typer.Option(metavar="FILE", help="Use this file of the secret.")] = None,
    tls: Annotated[Path | None, typer.Option(metavar="FILE", help="Encrypt the link: robot certificate.")] = None,
    force: Annotated[bool, typer.Option("--force", help="pair: replace the existing secret.")] = False,
) -> None:
    """Drive a robot from this computer with an input device; first run `artemis operator pair` on both sides."""
    from artemis.commands.operator import PAIR, DeviceChoice, operate, pair, user_name

    if address == PAIR:
        pair(secret, force=force)
        return
    choice = DeviceChoice(name=device, mission=mission, options=option or [])
    raise typer.Exit(operate(address, choice, secret, tls, name or user_name(), stop=stop))


@app.command()
def report(
    run: RunFolder,
    truth: Annotated[
        str | None, typer.Option(metavar="FILE", help="Compare with true poses: CSV, TUM or `simulation`.")
    ] = None,
    align: Annotated[
        str | None, typer.Option(metavar="none|start|best", help="Align the truth's frame with the run's this way.")
    ] = None,
    sensor: Annotated[
        str | None, typer.Option(metavar="X,Y[,DEG]", help="Set the tracker's place: m ahead, left of the rear axle.")
    ] = None,
    same_clock: Annotated[bool, typer.Option("--same-clock", help="Take its times as run times.")] = False,
    export: Annotated[str | None, typer.Option(metavar="tum", help="Write the trajectories, too.")] = None,
    other: Annotated[
        Path | None, typer.Option("--with", metavar="RUN2", help="Compare with a second run, in each chart.")
    ] = None,
    at: Annotated[
        str | None, typer.Option(metavar="start|STEP", help="Align two runs: at this time reference, or a step's name.")
    ] = None,
) -> None:
    """Write the report of a run: charts, numbers, events; with ground truth, also the odometry's error."""
    from artemis.commands.report import report, report_with

    if other is not None:
        if truth or align or sensor or same_clock or export:
            raise ConfigError("--with compares two runs: truth and trajectories are of one, write them without it")
        report_with(run, other, at or "start")
        return
    if at is not None:
        raise ConfigError("--at is about two runs: name the second one with --with")
    report(run, truth, align, sensor, same_clock, export)


@app.command()
def replay(run: RunFolder) -> None:
    """Recompute every command of a run from its recording, and compare bit for bit."""
    from artemis.commands.replay import replay_run

    raise typer.Exit(replay_run(run))


@app.command()
def devices(
    mission: Annotated[
        Path | None, typer.Option("--mission", metavar="M", help="Query the drives on its bus, too.")
    ] = None,
) -> None:
    """List CAN adapters, joysticks, gamepads and wheels; with a mission, also the drives that answer."""
    from artemis.commands.devices import show_devices

    raise typer.Exit(0 if show_devices(mission) else FAILED)


@app.command()
def configure(
    mission: MissionFile,
    store: Annotated[bool, typer.Option("--store", help="Store it in the drives' permanent memory.")] = False,
    simulate: Annotated[bool, typer.Option("--simulate", help="Use simulated drives instead of the bus.")] = False,
) -> None:
    """Write the robot file's configuration into a mission's drives, over CAN or a serial line; nothing moves."""
    from artemis.commands.configure import configure_drives

    raise typer.Exit(configure_drives(mission, store=store, simulate=simulate))


@app.command()
def graph(
    mission: Annotated[
        Path | None, typer.Argument(metavar="[MISSION]", help="Mission file (YAML); the robot's modes if left out.")
    ] = None,
    svg: Annotated[Path | None, typer.Option(metavar="FILE", help="Draw the mission into this SVG file.")] = None,
) -> None:
    """Print a mission as a Mermaid state diagram, or draw it; without a mission, the robot's modes."""
    from artemis.commands.graph import graph

    graph(mission, svg)


@app.command()
def faults(
    ids: Annotated[
        list[str] | None,
        typer.Argument(metavar="[ID...]", help="Rows such as DRV-25; all if left out.", autocompletion=rows),
    ] = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="Print the page of the documentation.")] = False,
    robot: Annotated[
        Path | None, typer.Option("--robot", help="List the rows that cannot occur on this robot.")
    ] = None,
) -> None:
    """Show the fault table: what is detected, how fast, the reaction, and the recovery."""
    from artemis.commands.faults import show_faults

    show_faults(ids or [], markdown, robot)


@app.command()
def schema(
    kind: Annotated[str, typer.Argument(metavar="mission|robot", help="Kind of file.")] = "mission",
    markdown: Annotated[bool, typer.Option("--markdown", help="Print the steps as in the documentation.")] = False,
) -> None:
    """Print the JSON schema of a mission or robot file, for editors."""
    import json

    from artemis.mission.json_schema import mission_schema, robot_schema

    if kind not in ("mission", "robot"):
        raise ConfigError(f"no schema of {kind!r}: write mission or robot")
    if markdown and kind == "mission":
        from artemis.mission.markdown import steps_markdown

        typer.echo(steps_markdown(mission_schema()), nl=False)
        return
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
