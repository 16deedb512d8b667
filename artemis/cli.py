"""The command line: parses arguments, turns errors into words and exit statuses. Heavy imports stay in the commands."""

from __future__ import annotations

import io
import logging
import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from artemis.commands.bench import bench
from artemis.commands.path import paths
from artemis.errors import ArtemisError, ConfigError, RecordingError

FAILED, REFUSED, OWN_BUG = 1, 2, 70

app = typer.Typer(
    name="artemis",
    help="Drive robots with maxon EPOS motor controllers: missions, simulated drives, recordings.",
    rich_markup_mode=None,
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)

plugins = typer.Typer(rich_markup_mode=None, invoke_without_command=True)
app.add_typer(plugins, name="plugins")
app.add_typer(paths, name="path")
app.add_typer(bench, name="bench")

calibrate = typer.Typer(
    rich_markup_mode=None, no_args_is_help=True, help="Teach artemis what it has to know of a device."
)
app.add_typer(calibrate, name="calibrate")

MissionFile = Annotated[Path, typer.Argument(metavar="MISSION", help="Mission file (YAML).")]
RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.mcap.")]


@app.command()
def run(
    mission: MissionFile,
    simulate: Annotated[bool, typer.Option("--simulate", help="Against simulated drives, whatever the bus.")] = False,
    resume: Annotated[Path | None, typer.Option(metavar="RUN", help="Go on where that run of it stopped.")] = None,
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
def sim(
    robot: Annotated[Path, typer.Argument(metavar="ROBOT", help="Robot file (YAML).")],
    interface: Annotated[str, typer.Option(help="python-can's name of the back end.")],
    channel: Annotated[str, typer.Option(help="Channel, as python-can calls it.")],
    option: Annotated[list[str] | None, typer.Option(metavar="K=V", help="Another word of the back end.")] = None,
    seed: Annotated[int, typer.Option(help="Of all that is random.")] = 1,
    true: Annotated[Path | None, typer.Option("--true", metavar="FILE", help="What is true of the machine.")] = None,
) -> None:
    """Simulate the robot's drives on a real bus, in real time, for any CANopen tool. Ctrl-C ends it."""
    from artemis.commands.simulate import simulate

    simulate(robot, interface, channel, option or [], seed, true)


@app.command()
def report(run: RunFolder) -> None:
    """Write the page of a run: figures, numbers, events."""
    from artemis.commands.run import write_page

    typer.echo(write_page(run))


@app.command()
def replay(run: RunFolder) -> None:
    """Recompute every command of a run from its recording, and compare bit for bit."""
    from artemis.commands.replay import replay_run

    raise typer.Exit(replay_run(run))


@app.command()
def campaign(
    file: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Campaign file (YAML).")],
    seed: Annotated[int | None, typer.Option(help="Run only this seed, in sight, and keep its folder.")] = None,
) -> None:
    """Do many seeded runs with everything that may go wrong, and have each judged from outside."""
    from artemis.commands.campaign import run_all, run_one

    raise typer.Exit(run_all(file) if seed is None else run_one(file, seed))


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
    device: Annotated[str | None, typer.Option(metavar="V:P|SERIAL", help="Which, if there are several.")] = None,
    name: Annotated[str | None, typer.Option(help="Of the profile; the device's own, if left out.")] = None,
    output: Annotated[Path | None, typer.Option(metavar="FILE", help="Where to, instead of your profiles.")] = None,
) -> None:
    """Teach a joystick, gamepad or wheel: asks for each control, and writes the profile once that is confirmed."""
    from artemis.commands import calibrate_input

    raise typer.Exit(calibrate_input.calibrate_input(device, name, output))


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


@plugins.callback()
def list_plugins(context: typer.Context) -> None:
    """List installed plugins with their origin; for a broken one, why. `new` begins one of your own."""
    if context.invoked_subcommand is None:
        from artemis.commands.plugins import show_plugins

        raise typer.Exit(show_plugins())


@plugins.command("new")
def new_plugin(
    kind: Annotated[str, typer.Argument(metavar="input|follower", help="What it is.")],
    name: Annotated[str, typer.Argument(metavar="NAME", help="What missions will call it.")],
    folder: Annotated[Path, typer.Option(help="Where the package's folder is made.")] = Path(),
) -> None:
    """Write a package artemis-NAME: a plugin that works, its tests, and a mission that drives with it."""
    from artemis.commands.plugins import begin_plugin

    begin_plugin(kind, name, folder)


@app.command()
def schema(kind: Annotated[str, typer.Argument(metavar="mission|robot", help="Of which file.")] = "mission") -> None:
    """Print the JSON schema of a mission or robot file, for editors."""
    import json

    from artemis.mission.schema import mission_schema, robot_schema

    if kind not in ("mission", "robot"):
        raise ConfigError(f"no schema of {kind!r}: write mission or robot")
    typer.echo(json.dumps(mission_schema() if kind == "mission" else robot_schema(), indent=2))


def main() -> None:
    """Entry point. What artemis raises on purpose becomes its message; anything else is our own bug: status 70."""
    _prepare_output()
    try:
        app()
    except Exception as error:  # noqa: BLE001  the last border: beyond it is only the shell
        sys.exit(_explain(error))


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
        case ArtemisError():
            print(f"artemis: {error}", file=sys.stderr)
            return FAILED
        case ExceptionGroup() if error.split(ArtemisError)[1] is None:  # out of the tasks of a run that was under way
            for part in error.exceptions:
                _explain(part)
            return FAILED
    import traceback

    traceback.print_exception(error)
    print("artemis: this is a bug of artemis itself; a robot that was running has been told to stop", file=sys.stderr)
    return OWN_BUG
