"""A run of hours on virtual time, its report, and its replay on a page: their memory, what they leave, and the time."""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import tempfile
from pathlib import Path

from artemis.app import run_mission
from artemis.clock import stopwatch
from artemis.devices.can_bus import Traffic
from artemis.devices.host import usage
from artemis.mission.loading import load_mission
from artemis.page.runs_work import command
from artemis.values import Tick

from .composition import FIGURE_EIGHT, MISSIONS
from .measure import Row, table
from .starting import ARTEMIS

LAP = 85.8
"""Of the figure eight at 0.2 m/s [s]."""
SETTLED = 60.0
"""Run time [s] after which a run has all that it needs; its memory is looked at as often."""
MEBI = 2**20


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=4.0, help="run time")
    parser.add_argument("--keep", type=Path, help="folder that the run is left in; must not be there")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="artemis-bench-") as scratch:
        folder = options.keep or Path(scratch) / "missions"
        shutil.copytree(MISSIONS, folder, ignore=shutil.ignore_patterns("runs"))
        mission = folder / FIGURE_EIGHT.name
        laps = max(1, round(options.hours * 3600 / LAP))
        mission.write_text(mission.read_text().replace("laps: 1", f"laps: {laps}"))
        print(table(rows(mission)))


def rows(mission: Path) -> list[Row]:
    """Run a mission, make its report in a process of its own, and say what both took."""
    seen: list[tuple[float, int]] = []

    def watch(tick: Tick, traffic: Traffic) -> None:
        time = tick.snapshot.time
        if time >= SETTLED * (len(seen) + 1):
            seen.append((time, usage()[0]))

    outcome = run_mission(load_mission(mission), mission, watch=watch)
    hours = (seen[-1][0] - seen[0][0]) / 3600
    begin, end = seen[0][1] / MEBI, seen[-1][1] / MEBI
    report, took, _ = spent([str(ARTEMIS), "report", str(outcome.run.path)])
    peak, by_processor = report.ru_maxrss / 1024, report.ru_utime + report.ru_stime
    replay, made, shown = spent(command("replay", str(outcome.run.path)))
    return [
        Row(
            name=f"a run of {outcome.duration / 3600:.2f} h: resident memory after a minute, at the end",
            measured=f"{begin:.1f} MiB, {end:.1f} MiB: {(end - begin) / hours:+.2f} MiB an hour",
            budget="< 1 MiB an hour",
            held=(end - begin) / hours < 1.0,
        ),
        Row(
            name="its time on the wall; its recording",
            measured=f"{outcome.elapsed:.0f} s: {outcome.duration / outcome.elapsed:.0f} x real time; "
            f"{os.path.getsize(outcome.run.recording) / 1e6:.0f} MB",
        ),
        Row(
            name="its report: most resident memory",
            measured=f"{peak:.0f} MiB",
            budget="<= 300 MB",
            held=peak * MEBI <= 300e6,
        ),
        Row(
            name="its report: time",
            measured=f"{took:.1f} s, {by_processor:.1f} s by processor time",
            budget="<= 30 s",
            held=took <= 30.0,
        ),
        Row(name="its page", measured=f"{os.path.getsize(outcome.run.report) / 1e6:.2f} MB"),
        Row(name="its replay on a page: until it can be shown; all of it", measured=f"{shown:.1f} s; {made:.1f} s"),
        Row(
            name="its replay: most resident memory",
            measured=f"{replay.ru_maxrss / 1024:.0f} MiB",
            budget="<= 300 MB",
            held=replay.ru_maxrss * 1024 <= 300e6,
        ),
    ]


def spent(words: list[str]) -> tuple[resource.struct_rusage, float, float]:
    """What a command took, how long it lasted, and how long until its first line [s]."""
    begun = stopwatch()
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        said = stopwatch() - begun
        process.stdout.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, words)
    return used, stopwatch() - begun, said


if __name__ == "__main__":
    main()
