"""`artemis campaign`: many seeded runs with everything that may go wrong, judged by the monitor."""

from __future__ import annotations

import shutil
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from artemis.clock import stopwatch
from artemis.commands.live import LiveView
from artemis.devices.can_bus import Traffic
from artemis.values import Tick
from artemis_lab.campaign.one_run import InterruptedRun, Result, run_scenario
from artemis_lab.campaign.runs import Campaign, ResultFile, drawn, load_campaign, run_campaign, table
from artemis_lab.campaign.scenario import MISSION, scenario

SHOWN = 20
"""So many failing seeds are listed."""


def run_all(file: Path) -> int:
    """Do what is left of a campaign, print its table. Returns the exit status: 1 if an invariant broke.

    Raises:
        ConfigError: the campaign is refused.
    """
    campaign = load_campaign(file)
    results = ResultFile(campaign.folder)
    if all(seed in results.finished for seed in campaign.seeds):
        results.forget()  # it was finished: begin anew
    elif results.finished:
        _say(f"continues after {len(results.finished)} finished runs")
    with _signals() as received, _Bar(campaign, len(results.finished)) as bar:
        done = run_campaign(campaign, results, bar.advance, lambda: bool(received))
    _conclude(file, campaign, results)
    if received:
        _say(f"interrupted after {len(results.finished)} of {campaign.words.runs} runs; the same command continues")
        return 128 + received[0]
    assert done
    return int(any(result.violations for result in results.finished.values()))


def run_one(file: Path, seed: int) -> int:
    """Run one seed of a campaign in sight, and keep its folder.

    Returns 1 if an invariant broke, 128 + the signal that interrupted it.

    Raises:
        ConfigError: the campaign is refused.
    """
    campaign = load_campaign(file)
    folder = campaign.scenario_folder(seed)
    shutil.rmtree(folder, ignore_errors=True)
    robot, source = campaign.robot_of(seed)
    title = f"seed {seed} of campaign {campaign.words.campaign}"
    view = LiveView(title, "", lambda: None, robot.bitrate, robot.errors)

    def watch(tick: Tick, traffic: Traffic) -> None:
        view.see(tick, traffic, tick.snapshot.time)

    try:
        result = run_scenario(scenario(seed, robot), source, folder, replayed=True, watch=watch)
    except InterruptedRun as interrupted:
        return 128 + interrupted.signal
    finally:
        view.close()
    _say("")
    for line in _violations(result):
        _say(line)
    _say(f"{len(result.violations)} violations; mission and run: {folder}")
    return int(bool(result.violations))


class _Bar:
    """How far the campaign is, and how fast: a bar at a terminal, else a line for every tenth."""

    def __init__(self, campaign: Campaign, done: int) -> None:
        self._total, self._done, self._failed = campaign.words.runs, done, 0
        self._before, self._begin = done, stopwatch()
        self._progress: Progress | None = None
        if sys.stdout.isatty():
            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
            self._progress = Progress(*columns)
            self._task = self._progress.add_task(campaign.words.campaign, total=self._total, completed=done)

    def __enter__(self) -> _Bar:
        if self._progress is not None:
            self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._progress is not None:
            self._progress.stop()

    def advance(self, result: Result) -> None:
        """One more run is finished."""
        self._failed += bool(result.violations)
        before, self._done = self._done, self._done + 1
        a_minute = 60.0 * (self._done - self._before) / max(1e-3, stopwatch() - self._begin)
        if self._progress is not None:
            failed = f", {self._failed} failed" if self._failed else ""
            self._progress.update(self._task, advance=1, description=f"runs{failed}, {a_minute:.0f} a minute")
        elif 10 * before // self._total != 10 * self._done // self._total:
            speed = f"{a_minute:.0f} a minute, {(self._total - self._done) / a_minute:.0f} minutes left"
            _say(f"{self._done} of {self._total} runs, {self._failed} failed; {speed}")


@contextmanager
def _signals() -> Iterator[list[int]]:
    """The signals that asked for an end meanwhile: a run that is under way is finished first."""
    received: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, lambda number, _: received.append(number)) for number in numbers]
    try:
        yield received
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def _conclude(file: Path, campaign: Campaign, results: ResultFile) -> None:
    """The table, and every seed that failed, each with its mission laid out to be run alone."""
    shown = Table(title=f"campaign {campaign.words.campaign}: {len(results.finished)} runs")
    for heading in ("fault", "runs", "had to be noticed", "slowest", "allowed", "failed runs"):
        shown.add_column(heading, justify="left" if heading == "fault" else "right")
    for line in table(results.finished.values()):
        times = [_milliseconds(line.worst), _milliseconds(line.within)]
        shown.add_row(line.id or "none", str(line.runs), str(line.judged), *times, str(line.failed))
    Console().print(shown)
    kinds = Table(title="what was in their missions")
    for heading in ("kind", "runs", "failed runs"):
        kinds.add_column(heading, justify="left" if heading == "kind" else "right")
    for kind, number, broken in drawn(results.finished.values()):
        kinds.add_row(kind, str(number), str(broken))
    Console().print(kinds)
    failed = [result for _, result in sorted(results.finished.items()) if result.violations]
    for result in failed:
        folder = campaign.scenario_folder(result.seed)
        robot, source = campaign.robot_of(result.seed)
        scenario(result.seed, robot).write(folder, source)
    for result in failed[:SHOWN]:
        for text in _violations(result):
            _say(text)
        _say(f"    alone: artemis campaign {file} --seed {result.seed}")
        _say(f"    its mission: {campaign.scenario_folder(result.seed) / MISSION}")
    if len(failed) > SHOWN:
        _say(f"and {len(failed) - SHOWN} more failing seeds")
    broken = sum(len(result.violations) for result in failed)
    _say(f"{len(results.finished)} runs, {broken} violations in {len(failed)} of them; results: {results.path}")


def _violations(result: Result) -> list[str]:
    return [f"seed {result.seed}: {invariant} at {time:.3f} s: {text}" for invariant, time, text in result.violations]


def _milliseconds(seconds: float | None) -> str:
    return "" if seconds is None else f"{seconds * 1000:.0f} ms"


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()
