"""Commands that `artemis` has where this package is installed. Heavy imports stay in the commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def add_commands(app: typer.Typer) -> None:
    """Add them to `artemis`."""
    app.command()(campaign)
    app.add_typer(bench, name="bench")


bench = typer.Typer(rich_markup_mode=None, no_args_is_help=True, help="Measure what is installed, side by side.")


@bench.command("followers")
def bench_followers(
    follower: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Only this one; repeat for more.")] = None,
    course: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Only this one; repeat for more.")] = None,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="For tables and figures.")] = Path(
        "bench-followers"
    ),
    seed: Annotated[int, typer.Option(help="Of noise, slip and random courses.")] = 1,
    robot: Annotated[Path | None, typer.Option(metavar="ROBOT", help="Robot file (YAML) instead of ARTEMIS.")] = None,
    random: Annotated[int, typer.Option(metavar="N", help="Also so many random courses and starts.")] = 0,
    frames: Annotated[bool, typer.Option("--frames/--no-frames", help="Also the whole stack, frame by frame.")] = True,
    python_robotics: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Checkout of PythonRobotics, as outside reference.")
    ] = None,
) -> None:
    """Run every installed follower on every course, with noise, delay and false calibration: tables and figures."""
    from artemis_lab.commands.bench_followers import Selection, measure

    choice = Selection(
        followers=follower or [],
        courses=course or [],
        seed=seed,
        robot=robot,
        random=random,
        frames=frames,
        checkout=python_robotics,
    )
    measure(choice, output)


@bench.command("slam")
def bench_slam(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="CARMEN log (.clf, .log, also .gz).")],
    relations: Annotated[Path, typer.Option(metavar="FILE", help="Verified relations of it (also .gz).")],
    backwards: Annotated[bool, typer.Option("--backwards", help="Drive the log backwards.")] = False,
    without_odometry: Annotated[bool, typer.Option("--without-odometry", help="Scans alone.")] = False,
    odometry_scale: Annotated[
        float, typer.Option(metavar="X", help="Wheels that count so much of the distance,")
    ] = 1.0,
    odometry_turn: Annotated[float, typer.Option(metavar="DEG/M", help="and turn with it.")] = 0.0,
    noise: Annotated[float, typer.Option(metavar="M", min=0, help="Noise on each distance.")] = 0.0,
    seed: Annotated[int, typer.Option(help="Of the noise.")] = 1,
    numba: Annotated[bool, typer.Option("--numba/--no-numba", help="Use the compiled loops, if there are any.")] = True,
    bars: Annotated[
        bool, typer.Option("--bars", help="All figures of mapping and localisation beside their bars.")
    ] = False,
) -> None:
    """Make a map of a log, and compare it with verified relations and with published figures."""
    if bars:
        from artemis_lab.commands.bench_bars import measure as measure_all

        raise typer.Exit(measure_all(log, relations))
    from artemis_lab.commands.bench_slam import LogDrive, measure

    drive = LogDrive(
        backwards=backwards,
        odometry=not without_odometry,
        scale=odometry_scale,
        turn_deg_m=odometry_turn,
        numba=numba,
        noise=noise,
        seed=seed,
    )
    measure(log, relations, drive)


@bench.command("buildings")
def bench_buildings(
    drives: Annotated[int, typer.Option(min=1, help="So many, with other wheels each.")] = 20,
    first: Annotated[int, typer.Option(min=0, metavar="SEED", help="Of the first drive.")] = 1,
) -> None:
    """Map a large building in simulation, where all corridors look alike and the wheels are wrong, beside the truth."""
    from artemis_lab.commands.bench_buildings import measure

    raise typer.Exit(measure(drives, first))


@bench.command("localisation")
def bench_localisation(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="CARMEN log (.clf, .log, also .gz).")],
    relations: Annotated[Path, typer.Option(metavar="FILE", help="Verified relations of it (also .gz).")],
    split: Annotated[float, typer.Option(metavar="S", help="The map is made of what was seen after it.")] = 1085.0,
    cells: Annotated[bool, typer.Option("--cells", help="The map is an image, not the scans themselves.")] = False,
) -> None:
    """Localise a robot on the first part of a log on the map of the rest, and compare with verified relations."""
    from artemis_lab.commands.bench_localisation import measure

    measure(log, relations, split, cells=cells)


@bench.command("obstacles")
def bench_obstacles(
    scenes: Annotated[
        int, typer.Option(min=1, help="Random scenes; a tenth as many with a person who crosses.")
    ] = 1000,
    first: Annotated[int, typer.Option(min=0, metavar="SEED", help="Of the first scene.")] = 0,
    kilometres: Annotated[
        float, typer.Option(min=0.001, metavar="KM", help="Driven in a corridor, and in dust.")
    ] = 1.0,
    workers: Annotated[int | None, typer.Option(min=1, metavar="N", help="Processes; else one per processor.")] = None,
) -> None:
    """Drive among random obstacles as badly as one may: contacts, slow-downs for nothing, and what a look costs."""
    import os

    from artemis_lab.commands.bench_obstacles import measure

    raise typer.Exit(measure(scenes, first, 1000.0 * kilometres, workers or os.cpu_count() or 1))


@bench.command("goto")
def bench_goto(
    goals: Annotated[int, typer.Option(metavar="N", min=1, help="So many, in runs of five.")] = 30,
    seed: Annotated[int, typer.Option(help="Of the first run.")] = 1,
    workers: Annotated[int, typer.Option(metavar="N", min=1, help="Processes.")] = 2,
    blind: Annotated[bool, typer.Option("--blind", help="Without scanner and obstacle stop.")] = False,
) -> None:
    """Drive to random goals on three kinds of map in simulation: are they reached, and is nothing touched?"""
    from artemis_lab.commands.bench_goto import measure

    raise typer.Exit(int(not measure(goals, seed, workers, blind=blind)))


@bench.command("operator")
def bench_operator(
    robot: Annotated[Path, typer.Argument(metavar="ROBOT", help="Robot file (YAML).")],
    reports: Annotated[int, typer.Option(metavar="N", min=10, help="So many reports of the device are timed.")] = 350,
    seconds: Annotated[float, typer.Option(help="Each run with floods drives so long, half of it flooded.")] = 24.0,
    runs: Annotated[int, typer.Option(metavar="N", min=1, help="With floods; link in a process, and in a thread.")] = 5,
    cuts: Annotated[int, typer.Option(metavar="N", min=1, help="The link is cut so often.")] = 20,
    seed: Annotated[int, typer.Option(help="Of the times of the hand's reports.")] = 1,
) -> None:
    """Measure an operator's link on this computer: a cut, latency, and floods; in real time, some eight minutes."""
    from artemis_lab.commands.bench_operator import measure

    raise typer.Exit(int(not measure(robot, reports, seconds, runs, cuts, seed)))


@bench.command("bridges")
def bench_bridges(
    robot: Annotated[Path, typer.Argument(metavar="ROBOT", help="Robot file (YAML).")],
    kills: Annotated[int, typer.Option(metavar="N", min=2, help="Each bridge is killed so often.")] = 10,
    seed: Annotated[int, typer.Option(help="Of the times at which that is done.")] = 1,
) -> None:
    """Kill the processes of bridges while a simulated robot drives: how soon are they back? In real time."""
    from artemis_lab.commands.bench_bridges import measure

    raise typer.Exit(int(not measure(robot, kills, seed)))


@bench.command("page")
def bench_page(
    robot: Annotated[Path, typer.Argument(metavar="ROBOT", help="Robot file (YAML).")],
    presses: Annotated[int, typer.Option(metavar="N", min=1, help="Stop is pressed so often, twice.")] = 40,
    seconds: Annotated[float, typer.Option(help="The page is flooded so long.")] = 10.0,
    losses: Annotated[
        int, typer.Option(metavar="N", min=0, help="A hand that drives is lost in each way so often.")
    ] = 10,
) -> None:
    """Measure the page for operators on this computer: Stop, losses, size, first paint, a flood; in real time."""
    from artemis_lab.commands.bench_page import measure

    raise typer.Exit(int(not measure(robot, presses, seconds, losses)))


@bench.command("transport")
def bench_transport(
    baud: Annotated[int, typer.Option(min=300, help="Of the serial line.")] = 115200,
    latency: Annotated[float, typer.Option("--latency-ms", min=0, help="Timer of its USB adapter; FTDI's: 16.")] = 16.0,
    answer: Annotated[float, typer.Option("--answer-ms", min=0, help="After which a drive answers.")] = 0.1,
    output: Annotated[Path | None, typer.Option("--output", "-o", metavar="FILE", help="For the figure.")] = None,
) -> None:
    """Enable four drives by 32 messages over RS232 and over CAN, as the thesis did: where does its 1:138 come from?"""
    from artemis_lab.commands.bench_transport import measure

    measure(baud, latency / 1000.0, answer / 1000.0, output)


def campaign(
    file: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Campaign file (YAML).")],
    seed: Annotated[int | None, typer.Option(help="Run only this seed, in sight, and keep its folder.")] = None,
) -> None:
    """Do many seeded runs with everything that may go wrong, and have each judged from outside."""
    from artemis_lab.commands.campaign import run_all, run_one

    raise typer.Exit(run_all(file) if seed is None else run_one(file, seed))
