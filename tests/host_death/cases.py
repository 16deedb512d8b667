"""Hosts that drive a path in processes of their own, and die: how and when, and what the drives then did."""

from __future__ import annotations

import asyncio
import json
import os
import random
import re
import shutil
import signal
import socket
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

from artemis import clock
from artemis.drive_states import DriveState
from artemis.mission.loading import load_model
from artemis.sim.server import serve
from artemis.sim.world import World
from artemis.vehicle import RobotFile
from artemis_lab.bench.ports import free_port

from .drives import Trip, WatchedBus, WatchedDrive, WatchedWorld

MISSIONS = Path(__file__).parents[2] / "missions"
PLUGIN = Path(__file__).parent / "plugin"
GROUP = "239.74.163.2"
SPEED = 0.5
SIGNALS = {"kill": signal.SIGKILL, "stop": signal.SIGSTOP}
WAYS = (*SIGNALS, "loop", "lock", "interpreter")
"""SIGKILL; SIGSTOP, and SIGCONT after a while; the three seizures of the follower in `plugin`."""
WATCH = 0.2
DRIVE_CYCLE = 0.001
ROUNDING = 1e-6
SETTLING = 0.05
"""A motor is at most this far behind its ramp [s]."""
STOPPING = 1.0
"""Longer than it takes until a robot without a host stands [s]."""
STANDING = 0.3
"""Once all is over the robot is watched for this much longer [s]."""
PATIENCE = 60.0
TRIES = 3
"""A host that stops by itself before its death, because this machine is busy, gets another try, so often."""
STOPPED = re.compile(r" s  (quickstop|fault) |FAILED")
DEATH = "seized"


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """How and when a host dies."""

    number: int
    way: str
    after: float
    """From the start of the path [s]."""
    seconds: float
    """How long it is dead, if it wakes up again [s]."""

    def __str__(self) -> str:
        return f"case {self.number}: {self.way} after {self.after:.3f} s for {self.seconds:.3f} s"


def draw(count: int, seed: int) -> list[Case]:
    """The same cases for the same seed. The robot speeds up, drives straight or in a curve."""
    dice = random.Random(seed)
    return [
        Case(number=number, way=WAYS[number % len(WAYS)], after=dice.uniform(0.2, 2.5), seconds=dice.uniform(0.3, 1.2))
        for number in range(count)
    ]


@dataclass(kw_only=True)
class Outcome:
    """What one case has shown."""

    case: Case
    problems: list[str] = field(default_factory=list)
    """What was not as it must be."""
    replaced: list[str] = field(default_factory=list)
    """Why hosts did not live until their death, and another took their turn."""
    trips: list[Trip] = field(default_factory=list)
    """The quick stops that the death began."""
    behind: float = 0.0
    """By how much motors came to rest later than their ramp, at most [s]."""
    reported: float = 0.0
    """Longest from the last heartbeat on the bus until the last drive's report of it was there [s]: this process, too,
    may be late."""

    @property
    def undecided(self) -> bool:
        """No host lived until its death."""
        return len(self.replaced) == TRIES


class Process:
    """A running `artemis` command, and what it prints."""

    @classmethod
    async def start(cls, *arguments: str | Path) -> Process:
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "artemis", *map(str, arguments)),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            env={**os.environ, "PYTHONPATH": str(PLUGIN)},
        )
        return cls(process)

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.lines: list[str] = []
        self._process = process
        self._news = asyncio.Condition()
        self._ended = False
        self._reading = asyncio.create_task(self._read())

    async def says(self, words: str) -> bool:
        """Wait until it has said these words; False: it ended without, or took too long."""
        with suppress(TimeoutError):
            async with asyncio.timeout(PATIENCE), self._news:
                await self._news.wait_for(lambda: self._ended or any(words in line for line in self.lines))
        return any(words in line for line in self.lines)

    def send(self, number: int) -> None:
        """Send a signal; all but SIGCONT are its death."""
        if number != signal.SIGCONT:
            self.lines.append(DEATH)
        with suppress(ProcessLookupError):  # it has ended already: `stopped_before` tells why
            self._process.send_signal(number)

    def stopped_before(self) -> str:
        """What it said when it stopped the robot before its death; empty if it did not."""
        lived = self.lines[: self.lines.index(DEATH)] if DEATH in self.lines else self.lines
        stopped = next((number for number, line in enumerate(lived) if STOPPED.search(line)), len(lived))
        if DEATH in self.lines and stopped == len(lived):
            return ""
        said = [line for line in lived[: stopped + 1] if " s  FAULT " in line]
        said = said or [line for line in self.lines if line] or ["it ended without a word"]
        return said[-1].strip()

    async def end(self) -> int:
        """Its exit status, once it is gone: it is killed if it still runs."""
        if self._process.returncode is None:
            self._process.kill()
        await self._reading
        return await self._process.wait()

    async def _read(self) -> None:
        assert self._process.stdout is not None
        async for line in self._process.stdout:
            await self._tell(line.decode().rstrip())
        self._ended = True
        await self._tell("")

    async def _tell(self, line: str) -> None:
        async with self._news:
            self.lines.append(line)
            self._news.notify_all()


def play(cases: Sequence[Case], jobs: int) -> Iterator[Outcome]:
    """Play cases, `jobs` at a time: each has the drives in a process of its own, and the host in another."""
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        yield from pool.map(play_one, cases)


def play_one(case: Case) -> Outcome:
    """Play a case with the drives in this process."""
    robot = load_model(MISSIONS / "robots" / "artemis.yaml", RobotFile)
    outcome = Outcome(case=case)
    while not outcome.undecided:
        with TemporaryDirectory() as folder:
            reason = clock.run(_attempt(robot, Path(folder), outcome), simulated=False)
        if not reason:
            break
        outcome.replaced.append(reason)
    return outcome


async def _attempt(robot: RobotFile, folder: Path, outcome: Outcome) -> str:
    """Let one host drive and die, and judge what happened; or why it did not live until then."""
    case, port, start = outcome.case, free_port(socket.SOCK_DGRAM), asyncio.get_running_loop().time()
    bus = WatchedBus(words(port), robot.host_node_id)
    world = WatchedWorld(World(robot, seed=case.number, start=start), robot.host_node_id)
    serving = asyncio.create_task(serve(world, bus, robot.bitrate))
    host = await Process.start("run", _mission(case, folder, port))
    try:
        await _live_and_die(case, host)
        await asyncio.sleep(STANDING)
    finally:
        status = await host.end()
        serving.cancel()
        with suppress(asyncio.CancelledError):
            await serving
        bus.close()
    if undecided := host.stopped_before():
        return undecided
    outcome.problems += _problems_of_host(case, host, status)
    for drive in world.nodes:
        outcome.problems += [f"{drive.name} {problem}" for problem in _problems_of_drive(drive, bus, outcome)]
    return ""


async def _live_and_die(case: Case, host: Process) -> None:
    if not await host.says("following"):
        return
    if case.way in SIGNALS:
        await asyncio.sleep(case.after)
        host.send(SIGNALS[case.way])
        await asyncio.sleep(case.seconds)
    if case.way == "kill":
        await asyncio.sleep(STOPPING)
    elif case.way == "stop":
        host.send(signal.SIGCONT)
    if case.way != "kill":
        await host.says("run folder")  # what follows is the page, which takes its time


def _problems_of_host(case: Case, host: Process, status: int) -> list[str]:
    """One that was killed is gone; one that woke up finds the drives in fault, and ends."""
    if case.way == "kill":
        return [] if status == -signal.SIGKILL else [f"host ended with exit status {status}"]
    woken = host.lines[host.lines.index(DEATH) :]
    return [
        f"host woke up and did not say {words!r}: {woken}"
        for words in (" s  fault ", "FAILED")
        if not any(words in line for line in woken)
    ]


def _problems_of_drive(drive: WatchedDrive, bus: WatchedBus, outcome: Outcome) -> Iterator[str]:
    """It went to fault twice, when the watchdog was proven and now, each time when it must; since then it rests."""
    for trip in drive.trips:
        if not WATCH - ROUNDING <= trip.latency <= WATCH + DRIVE_CYCLE + ROUNDING:
            yield f"went to fault {trip.latency * 1000:.3f} ms after the last heartbeat"
        around = bus.beats[trip.beats - 1 : trip.beats + 1]
        if len(around) == 2 and around[1] - around[0] < WATCH:
            yield f"went to fault although the next heartbeat came after {(around[1] - around[0]) * 1000:.3f} ms"
    if len(drive.trips) != 2:
        yield f"went to fault {len(drive.trips)} times instead of twice"
        return
    trip = drive.trips[-1]
    outcome.trips.append(trip)
    outcome.reported = max(outcome.reported, bus.reports[-1] - bus.beats[trip.beats - 1])
    if trip.before is not DriveState.OPERATION_ENABLE:
        yield f"was in {trip.before.value}"
    if drive.enabled > trip.time:
        yield "was enabled again"
    if drive.stands_from is None:
        yield "still turns"
        return
    behind = drive.stands_from - trip.time - abs(trip.rpm) / trip.ramp
    outcome.behind = max(outcome.behind, behind)
    if behind > SETTLING:
        yield f"stood {behind * 1000:.0f} ms later than its ramp, or moved again"


def _mission(case: Case, folder: Path, port: int) -> Path:
    """A figure eight; its first way is straight, then comes a curve."""
    for kind, name in (("robots", "artemis.yaml"), ("paths", "figure_eight.csv")):
        (folder / kind).mkdir()
        shutil.copy(MISSIONS / kind / name, folder / kind)
    follower = f"plugin: indiveri, speed_m_s: {SPEED}"
    if case.way not in SIGNALS:
        follower = (
            f"plugin: seizing, speed_m_s: {SPEED}, way: {case.way}, after_s: {case.after:.6f}, "
            f"seconds: {case.seconds:.6f}"
        )
    mission = folder / "mission.yaml"
    mission.write_text(
        f"mission: host-death\nrobot: robots/artemis.yaml\n"
        f"bus: {json.dumps(words(port))}\nsteps:\n"
        f"  - calibrate: {{steering: from_potentiometers}}\n"
        f"  - follow: {{path: paths/figure_eight.csv, follower: {{{follower}}}}}\n"
    )
    return mission


def words(port: int) -> dict[str, object]:
    """Python-can's, for a bus that stays on this host."""
    return {"interface": "udp_multicast", "channel": GROUP, "hop_limit": 0, "port": port}
