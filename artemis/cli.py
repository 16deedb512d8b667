"""The command line: parses arguments, turns errors into words and exit statuses. Heavy imports stay in the commands."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from artemis.errors import ArtemisError, ConfigError, RecordingError

REFUSED, OWN_BUG = 2, 70

app = typer.Typer(
    name="artemis",
    help="Drive robots with maxon EPOS motor controllers: missions, simulated drives, recordings.",
    rich_markup_mode=None,
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)

MissionFile = Annotated[Path, typer.Argument(metavar="MISSION", help="Mission file (YAML).")]
RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its recording.mcap.")]


@app.command()
def run(
    mission: MissionFile,
    simulate: Annotated[bool, typer.Option("--simulate", help="Against simulated drives, whatever the bus.")] = False,
) -> None:
    """Run a mission: bring the drives up, align, do its steps, stop, leave a recording and a report."""
    from artemis.commands.run import run_and_report

    raise typer.Exit(run_and_report(mission, simulate))


@app.command()
def check(missions: Annotated[list[Path], typer.Argument(metavar="MISSION...")]) -> None:
    """Say everything that `run` would refuse, without moving."""
    from artemis.mission.loading import load_mission

    problems = []
    for mission in missions:
        try:
            load_mission(mission)
            typer.echo(f"{mission}: ok")
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(problems)


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
def graph() -> None:
    """Print the robot's modes as a Mermaid diagram, from the table that runs."""
    from artemis.states.machine import mermaid

    typer.echo(mermaid())


@app.command()
def plugins() -> None:
    """List installed plugins with their origin; for a broken one, why."""
    from artemis.plugins.registry import listing

    for group in ("artemis.inputs", "artemis.followers"):
        for found in listing(group, check=True):
            state = f"BROKEN: {found.error}" if found.error else "ok"
            typer.echo(f"{group:20} {found.name:14} {found.origin} {found.version}  {state}")


@app.command()
def schema(kind: Annotated[str, typer.Argument(metavar="mission|robot")] = "mission") -> None:
    """Print the JSON schema of a mission or robot file, for editors."""
    import json

    from artemis.mission.schema import mission_schema, robot_schema

    if kind not in ("mission", "robot"):
        raise ConfigError(f"no schema of {kind!r}: write mission or robot")
    typer.echo(json.dumps(mission_schema() if kind == "mission" else robot_schema(), indent=2))


def main() -> None:
    """Entry point. What artemis raises on purpose becomes its message; anything else is our own bug: status 70."""
    try:
        app()
    except ConfigError as error:
        for problem in error.problems:
            print(problem, file=sys.stderr)
        sys.exit(REFUSED)
    except RecordingError as error:
        print(f"artemis: {error}", file=sys.stderr)
        sys.exit(REFUSED)
    except ArtemisError as error:
        print(f"artemis: {error}", file=sys.stderr)
        sys.exit(1)
    except Exception:
        import traceback

        traceback.print_exc()
        print("artemis: this is a bug of artemis; the drives were told to stop", file=sys.stderr)
        sys.exit(OWN_BUG)
