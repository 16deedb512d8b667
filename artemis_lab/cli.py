"""Commands that `artemis` has where this package is installed. Heavy imports stay in the commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def add_commands(app: typer.Typer) -> None:
    """Add them to `artemis`."""
    app.command()(campaign)
    app.add_typer(bench, name="bench")


bench = typer.Typer(rich_markup_mode=None, no_args_is_help=True, help="Run a benchmark on this computer.")


@bench.command("followers")
def bench_followers(
    follower: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Run only this one; repeat for more.")
    ] = None,
    course: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Run only this one; repeat for more.")
    ] = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Write tables and figures to this folder.")
    ] = Path("bench-followers"),
    seed: Annotated[int, typer.Option(help="Set the seed of noise, slip and random courses.")] = 1,
    robot: Annotated[
        Path | None, typer.Option(metavar="ROBOT", help="Use this robot file (YAML) instead of ARTEMIS.")
    ] = None,
    random: Annotated[int, typer.Option(metavar="N", help="Add this many random courses and starts.")] = 0,
    frames: Annotated[
        bool, typer.Option("--frames/--no-frames", help="Run the whole stack, too, frame by frame.")
    ] = True,
    python_robotics: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Compare with this checkout of PythonRobotics.")
    ] = None,
) -> None:
    """Run every installed follower on every course, with noise, delay and calibration errors; write tables, figures."""
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
    relations: Annotated[
        Path, typer.Option(metavar="FILE", help="Use these verified relations of the log (also .gz).")
    ],
    backwards: Annotated[bool, typer.Option("--backwards", help="Drive the log backwards.")] = False,
    without_odometry: Annotated[bool, typer.Option("--without-odometry", help="Use scans only.")] = False,
    odometry_scale: Annotated[
        float, typer.Option(metavar="X", help="Scale the odometry's distance by this factor.")
    ] = 1.0,
    odometry_turn: Annotated[float, typer.Option(metavar="DEG/M", help="Add this turn to the odometry.")] = 0.0,
    noise: Annotated[float, typer.Option(metavar="M", min=0, help="Add noise to each distance.")] = 0.0,
    seed: Annotated[int, typer.Option(help="Set the seed of the noise.")] = 1,
    numba: Annotated[bool, typer.Option("--numba/--no-numba", help="Use the compiled loops, if available.")] = True,
    bars: Annotated[
        bool, typer.Option("--bars", help="Print all figures of mapping and localisation with their bars.")
    ] = False,
) -> None:
    """Build a map of a log, and compare it with verified relations and with published figures."""
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
    drives: Annotated[int, typer.Option(min=1, help="Number of drives, each with other wheel errors.")] = 20,
    first: Annotated[int, typer.Option(min=0, metavar="SEED", help="Set the seed of the first drive.")] = 1,
    laps: Annotated[int, typer.Option(min=1, help="Drive so many laps of 850 m.")] = 1,
) -> None:
    """Map simulated large buildings with similar corridors and wrong odometry, and compare with ground truth."""
    from artemis_lab.commands.bench_buildings import measure

    raise typer.Exit(measure(drives, first, laps))


@bench.command("live-map")
def bench_live_map(
    seconds: Annotated[float, typer.Option(min=1, help="Drive so long, in real time.")] = 240.0,
) -> None:
    """Map a simulated building in real time, then localise on the map: how long each of 50 scans a second takes."""
    from artemis_lab.commands.bench_live_map import measure

    raise typer.Exit(measure(seconds))


@bench.command("localisation")
def bench_localisation(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="CARMEN log (.clf, .log, also .gz).")],
    relations: Annotated[
        Path, typer.Option(metavar="FILE", help="Use these verified relations of the log (also .gz).")
    ],
    split: Annotated[float, typer.Option(metavar="S", help="Build the map of the scans after this time.")] = 1085.0,
    cells: Annotated[bool, typer.Option("--cells", help="Use a map of cells, not the scans themselves.")] = False,
) -> None:
    """Localise a robot in the first part of a log on a map of the rest, and compare with verified relations."""
    from artemis_lab.commands.bench_localisation import measure

    measure(log, relations, split, cells=cells)


@bench.command("hall")
def bench_hall(
    mission: Annotated[
        Path,
        typer.Argument(metavar="MISSION", help="Simulated mission (YAML): localizer scan_map, a step follow."),
    ],
    minutes: Annotated[float, typer.Option(min=0.1, help="Follow the path for so many minutes of robot time.")] = 60.0,
    starts: Annotated[int, typer.Option(metavar="N", min=0, help="Switch the robot on at so many random places.")] = 5,
    seed: Annotated[int, typer.Option(help="Set the seed of these places.")] = 1,
) -> None:
    """Localise a simulated robot on a map, along a path and at random places; compare with the true poses."""
    from artemis_lab.commands.bench_hall import measure

    raise typer.Exit(int(not measure(mission, minutes, starts, seed)))


@bench.command("obstacles")
def bench_obstacles(
    scenes: Annotated[int, typer.Option(min=1, help="Number of random scenes of what stands.")] = 1000,
    around: Annotated[
        int | None, typer.Option(min=1, help="Number of random scenes with obstacles behind, too; by default a tenth.")
    ] = None,
    persons: Annotated[
        int | None,
        typer.Option(min=1, help="Number of scenes of each kind with a person or a thin leg; by default a tenth."),
    ] = None,
    first: Annotated[int, typer.Option(min=0, metavar="SEED", help="Set the seed of the first scene.")] = 0,
    kilometres: Annotated[
        float, typer.Option(min=0.001, metavar="KM", help="Drive this far in a corridor, and in dust.")
    ] = 1.0,
    workers: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Use this many processes; by default one per processor.")
    ] = None,
) -> None:
    """Drive among random obstacles: count contacts and needless slow-downs, and measure the cost of a look."""
    import os

    from artemis_lab.commands.bench_obstacles import measure

    few = max(1, scenes // 10)
    raise typer.Exit(
        measure(scenes, around or few, persons or few, first, 1000.0 * kilometres, workers or os.cpu_count() or 1)
    )


@bench.command("goto")
def bench_goto(
    goals: Annotated[int, typer.Option(metavar="N", min=1, help="Number of goals, in runs of five.")] = 30,
    seed: Annotated[int, typer.Option(help="Set the seed of the first run.")] = 1,
    workers: Annotated[int, typer.Option(metavar="N", min=1, help="Use this many processes.")] = 2,
    blind: Annotated[bool, typer.Option("--blind", help="Drive without scanner and obstacle stop.")] = False,
) -> None:
    """Drive to random goals on three kinds of map in simulation; count goals reached and contacts."""
    from artemis_lab.commands.bench_goto import measure

    raise typer.Exit(int(not measure(goals, seed, workers, blind=blind)))


@bench.command("operator")
def bench_operator(
    robot: Annotated[Path, typer.Argument(metavar="ROBOT", help="Robot file (YAML).")],
    reports: Annotated[int, typer.Option(metavar="N", min=10, help="Time this many reports of the device.")] = 350,
    seconds: Annotated[float, typer.Option(help="Drive this long in each run, half of it with floods.")] = 24.0,
    runs: Annotated[
        int, typer.Option(metavar="N", min=1, help="Run this many with floods, link in a process and in a thread.")
    ] = 5,
    cuts: Annotated[int, typer.Option(metavar="N", min=1, help="Cut the link this often.")] = 20,
    seed: Annotated[int, typer.Option(help="Set the seed of the times of the device's reports.")] = 1,
) -> None:
    """Measure an operator's link on this computer: cuts, latency and floods; takes about eight minutes."""
    from artemis_lab.commands.bench_operator import measure

    raise typer.Exit(int(not measure(robot, reports, seconds, runs, cuts, seed)))


@bench.command("bridges")
def bench_bridges(
    robot: Annotated[Path, typer.Argument(metavar="ROBOT", help="Robot file (YAML).")],
    kills: Annotated[int, typer.Option(metavar="N", min=2, help="Kill each bridge this often.")] = 10,
    seed: Annotated[int, typer.Option(help="Set the seed of the times of the kills.")] = 1,
) -> None:
    """Kill bridge processes while a simulated robot drives, and measure how fast they restart."""
    from artemis_lab.commands.bench_bridges import measure

    raise typer.Exit(int(not measure(robot, kills, seed)))


@bench.command("page")
def bench_page(
    robot: Annotated[Path, typer.Argument(metavar="ROBOT", help="Robot file (YAML).")],
    presses: Annotated[int, typer.Option(metavar="N", min=1, help="Press Stop this often, twice.")] = 40,
    seconds: Annotated[float, typer.Option(help="Flood the page this long.")] = 10.0,
    losses: Annotated[int, typer.Option(metavar="N", min=0, help="Lose a driving client this often in each way.")] = 10,
) -> None:
    """Measure the page for operators on this computer: Stop, losses, size, first paint, a flood; in real time."""
    from artemis_lab.commands.bench_page import measure

    raise typer.Exit(int(not measure(robot, presses, seconds, losses)))


@bench.command("transport")
def bench_transport(
    baud: Annotated[int, typer.Option(min=300, help="Set the baud rate of the serial line.")] = 115200,
    latency: Annotated[
        float, typer.Option("--latency-ms", min=0, help="Set the timer of its USB adapter; FTDI's: 16.")
    ] = 16.0,
    answer: Annotated[float, typer.Option("--answer-ms", min=0, help="Set the time until a drive answers.")] = 0.1,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write the figure to this folder.")
    ] = None,
) -> None:
    """Measure enabling four drives with 32 messages over RS232 and over CAN, the thesis' ratio 1:138."""
    from artemis_lab.commands.bench_transport import measure

    measure(baud, latency / 1000.0, answer / 1000.0, output)


def campaign(
    file: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Campaign file (YAML).")],
    seed: Annotated[int | None, typer.Option(help="Run only this seed, show its output, keep its folder.")] = None,
) -> None:
    """Execute many seeded runs with random faults, and check each with an independent monitor."""
    from artemis_lab.commands.campaign import run_all, run_one

    raise typer.Exit(run_all(file) if seed is None else run_one(file, seed))
