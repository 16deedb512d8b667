"""A campaign: many seeds through an executor, each finished run written down at once, one table at the end."""

from __future__ import annotations

import faulthandler
import json
import os
import tempfile
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from artemis.build import install
from artemis.config import Config
from artemis.errors import ConfigError
from artemis.mission.actions import FileName
from artemis.mission.loading import load_model
from artemis.vehicle import RobotFile
from artemis_lab.campaign.one_run import InterruptedRun, Result, run_scenario
from artemis_lab.campaign.scenario import scenario, sees
from artemis_lab.workers import fresh_workers

REPLAYED = 20
"""Of one run in so many every command is recomputed."""
LOOK = 0.5
"""An interruption is noticed at the latest after this time [s]."""
AHEAD = 3
"""Runs that wait for each worker: few, so that an interrupted campaign ends soon."""
HANGS = 600.0
"""A run takes seconds: one that takes this long never ends, and its worker shows where it is and dies [s]."""


class CampaignWords(Config):
    """The keys of a campaign."""

    campaign: Annotated[str, Field(pattern="^[a-z0-9-]{1,64}$")]
    """Its name, also of its results' folder."""
    robot: FileName
    """Robot file, relative to the campaign's."""
    robot_with_scanners: FileName | None = None
    """Likewise; a tenth of the runs is of this one, among things. None: none are."""
    runs: Annotated[int, Field(ge=1, le=10_000_000)]
    first_seed: Annotated[int, Field(ge=0)] = 1
    workers: Annotated[int, Field(ge=1)] | Literal["auto"] = "auto"
    """Processes on this computer; auto: one for each of its processors."""
    cluster: str | None = None
    """Address of a Dask scheduler, as tcp://host:8786; then its workers do the runs."""
    results: FileName = "runs/"
    """Folder for the results' folders."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """A campaign that may run."""

    words: CampaignWords
    robot: RobotFile
    robot_source: bytes
    """Content of the robot file."""
    seeing: tuple[RobotFile, bytes] | None = None
    """Likewise the robot with scanners."""
    folder: Path
    """Of the results: the same campaign for the same robot has the same."""

    @property
    def seeds(self) -> range:
        """All seeds."""
        return range(self.words.first_seed, self.words.first_seed + self.words.runs)

    def robot_of(self, seed: int) -> tuple[RobotFile, bytes]:
        """The robot of a seed, and the content of its file."""
        return self.seeing if self.seeing is not None and sees(seed) else (self.robot, self.robot_source)

    def scenario_folder(self, seed: int) -> Path:
        """Where the mission of a failing seed is laid."""
        return self.folder / f"seed-{seed}"


def load_campaign(path: Path) -> Campaign:
    """Read a campaign file and the robot files that it names.

    Raises:
        ConfigError: everything that is wrong in one of them.
    """
    words = load_model(path, CampaignWords)
    robot, source = _robot(path.parent / words.robot)
    seeing = None if words.robot_with_scanners is None else _robot(path.parent / words.robot_with_scanners)
    if seeing is not None and not seeing[0].scanners:
        raise ConfigError(f"{path}: robot_with_scanners: {words.robot_with_scanners} describes no `scanners`")
    same = json.dumps([words.first_seed, words.runs]).encode() + source + (seeing[1] if seeing else b"")
    name = f"{words.campaign}-{sha256(same).hexdigest()[:8]}"
    folder = path.parent / words.results / name
    return Campaign(words=words, robot=robot, robot_source=source, seeing=seeing, folder=folder)


def _robot(file: Path) -> tuple[RobotFile, bytes]:
    return load_model(file, RobotFile), file.read_bytes()


# ---------------------------------------------------------------------------------------------- one seed


def run_seed(seed: int, robot: RobotFile, source: bytes) -> Result:
    """Run one seed in a folder that is gone afterwards: what a worker does. `source`: the robot file's content."""
    own_process = threading.current_thread() is threading.main_thread()
    if own_process:
        faulthandler.dump_traceback_later(HANGS, exit=True)
    try:
        with tempfile.TemporaryDirectory(prefix="artemis-campaign-") as folder:
            return run_scenario(scenario(seed, robot), source, Path(folder), replayed=seed % REPLAYED == 0)
    except Exception as error:
        error.add_note(f"in seed {seed} of a campaign")
        raise
    finally:
        if own_process:
            faulthandler.cancel_dump_traceback_later()


# ---------------------------------------------------------------------------------------------- all seeds


class ResultFile:
    """The file of finished runs, one line each: what is in it does not have to be run again."""

    def __init__(self, folder: Path) -> None:
        """Open it, and read what an interrupted campaign left; a torn last line is cut off."""
        folder.mkdir(parents=True, exist_ok=True)
        self.path = folder / "results.jsonl"
        self.finished: dict[int, Result] = {}
        lines = self.path.read_bytes().splitlines(keepends=True) if self.path.exists() else []
        whole = [line for line in lines if line.endswith(b"\n")]
        for line in whole:
            result = Result.from_json(json.loads(line))
            self.finished[result.seed] = result
        self.path.write_bytes(b"".join(whole))

    def forget(self) -> None:
        """Begin anew."""
        self.finished.clear()
        self.path.write_bytes(b"")

    def add(self, result: Result) -> None:
        """Write a finished run down."""
        self.finished[result.seed] = result
        with self.path.open("ab") as file:
            file.write(json.dumps(result.as_json()).encode() + b"\n")


def run_campaign(
    campaign: Campaign, results: ResultFile, finished: Callable[[Result], None], stop: Callable[[], bool]
) -> bool:
    """Do every run that is not in `results` yet; each is added as it ends, and told to `finished`.

    Once `stop` says so, no more runs begin, and those under way are waited for. Returns whether all are done.

    Raises:
        ConfigError: the cluster is not there, or the extra for it is not installed.
        BrokenProcessPool: a worker died, or its run did not end; its notes name the seeds under way.
    """
    left = [seed for seed in reversed(campaign.seeds) if seed not in results.finished]
    with _executor(campaign.words) as (executor, workers):
        waiting: dict[Future[Result], int] = {}
        while waiting or (left and not stop()):
            while left and len(waiting) < AHEAD * workers and not stop():
                seed = left.pop()
                waiting[executor.submit(run_seed, seed, *campaign.robot_of(seed))] = seed
            for future in wait(waiting, LOOK, FIRST_COMPLETED).done:
                try:
                    result = future.result()
                except BrokenProcessPool as error:
                    error.add_note(f"under way were the seeds {', '.join(map(str, sorted(waiting.values())))}")
                    raise
                except InterruptedRun:  # whoever ends the process group ends the campaign, too
                    left.append(waiting.pop(future))
                    continue
                del waiting[future]
                results.add(result)
                finished(result)
            if stop():
                waiting = {future: seed for future, seed in waiting.items() if not future.cancel()}
    return len(results.finished) >= len(campaign.seeds)


@contextmanager
def _executor(words: CampaignWords) -> Iterator[tuple[Executor, int]]:
    """Who does the runs, and how many at once."""
    if words.cluster is None:
        workers = (os.cpu_count() or 1) if words.workers == "auto" else words.workers
        with fresh_workers(workers) as pool:
            yield pool, workers
        return
    try:
        from distributed import Client
    except ImportError:
        raise ConfigError(f"cluster: needs the extra `cluster`: {install('cluster')}") from None
    try:
        client = Client(words.cluster, timeout=10)
    except OSError as error:
        raise ConfigError(f"cluster: no scheduler at {words.cluster}: {error}") from error
    with client:
        workers = sum(client.nthreads().values())
        if not workers:
            raise ConfigError(f"cluster: the scheduler at {words.cluster} has no workers")
        yield client.get_executor(pure=False), workers


# ---------------------------------------------------------------------------------------------- the table


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultTotals:
    """What became of one kind of fault in all runs."""

    id: str
    """Row of the fault table; empty: runs in which nothing went wrong."""
    runs: int
    judged: int
    """Times that it had to be noticed, and was."""
    worst: float | None
    """Longest time until it was noticed [s]."""
    within: float | None
    """What was allowed in that case [s]."""
    failed: int
    """Runs with it in which an invariant broke."""


def drawn(results: Iterable[Result]) -> list[tuple[str, int, int]]:
    """Each kind of step and word, in how many runs it was, and in how many of those an invariant broke."""
    runs: Counter[str] = Counter()
    failed: Counter[str] = Counter()
    for result in results:
        runs.update(result.kinds)
        failed.update(result.kinds if result.violations else ())
    return [
        (kind, number, failed[kind]) for kind, number in sorted(runs.items(), key=lambda entry: (-entry[1], entry[0]))
    ]


def table(results: Iterable[Result]) -> list[FaultTotals]:
    """One line for each kind of fault that happened."""
    runs: Counter[str] = Counter()
    failed: Counter[str] = Counter()
    latencies: dict[str, list[tuple[float, float]]] = {}
    for result in results:
        ids = set(result.injected) or {""}
        runs.update(ids)
        failed.update(ids if result.violations else ())
        for id, latency, within in result.seen:
            latencies.setdefault(id, []).append((latency, within))
    lines = []
    for id in sorted(runs):
        worst, within = max(latencies.get(id, [(-1.0, -1.0)]), key=lambda pair: pair[0] / abs(pair[1]))
        told = worst >= 0.0
        lines.append(
            FaultTotals(
                id=id,
                runs=runs[id],
                judged=len(latencies.get(id, ())),
                worst=worst if told else None,
                within=within if told else None,
                failed=failed[id],
            )
        )
    return lines
