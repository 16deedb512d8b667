"""How soon what a far hand does is on the robot's wire, how soon a cut is noticed, and what a flood costs a tick."""

from __future__ import annotations

import asyncio
import json
import socket
import subprocess
import sys
import threading
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from artemis import clock
from artemis.app import run_mission
from artemis.bridges.operator.link_process import LinkProcess, LinkSettings, serve
from artemis.bridges.operator.operator_end import OperatorEnd
from artemis.bridges.operator.pairing import write_secret
from artemis.bridges.operator.session import LinkReport
from artemis.clock import cpu_time, stopwatch, until
from artemis.commands.operator_drive import _RobotProtocol
from artemis.devices.can_bus import Traffic
from artemis.errors import ArtemisError
from artemis.mission.loading import load_mission, load_model
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs import network
from artemis.plugins.inputs.network import NetworkConfig, NetworkInput
from artemis.values import Mode, OperatorInput, Tick
from artemis.vehicle import RobotFile
from artemis_lab.bench.ports import free_port
from artemis_lab.injections.damaged_link import DamagingProxy

PERIOD = 0.02
"""Of a tick [s]."""
SECRET = bytes(range(32))


@dataclass(slots=True)
class Ticks:
    """What was seen of a run's ticks, in their order."""

    times: list[float] = field(default_factory=list)
    """When a tick's frames had been written."""
    late: list[float] = field(default_factory=list)
    """How long after its time on the schedule it began [s]."""
    speeds: list[float] = field(default_factory=list)
    """What was commanded [m/s]."""
    cpu: list[float] = field(default_factory=list)
    """Processor time that the run's process has used [s]."""
    faults: dict[str, float] = field(default_factory=dict)
    """What went wrong, and when [s]."""
    reports: list[tuple[float, float]] = field(default_factory=list)
    floods: list[tuple[float, float]] = field(default_factory=list)

    def see(self, tick: Tick, traffic: Traffic) -> None:
        """Write a tick down."""
        for fault in tick.snapshot.verdict.faults:
            self.faults.setdefault(f"{fault.id} {fault.text}", tick.snapshot.time)
        if tick.mode is Mode.TELEOP:
            self.times.append(stopwatch())
            self.late.append(tick.snapshot.sensed.late)
            self.speeds.append(tick.wish.command.speed)
            self.cpu.append(cpu_time())

    def latencies(self) -> list[tuple[float, float]]:
        """From each report that came in no flood to the frames that carry it, and how late that tick began [s]."""
        found = []
        for time, speed in self.reports:
            if any(begun - 0.5 <= time <= ended + 0.5 for begun, ended in self.floods):
                continue
            place = bisect_left(self.times, time)
            if not place or self.speeds[place - 1] == speed:
                continue  # the one before never came: this one changes nothing
            after = [n for n in range(place, min(place + 50, len(self.times))) if self.speeds[n] == speed]
            if after:
                found.append((self.times[after[0]] - time, self.late[after[0]]))
        return found

    def split(self, values: list[float]) -> tuple[list[float], list[float]]:
        """Values of ticks without and with a flood."""
        apart: tuple[list[float], list[float]] = [], []
        for time, value in zip(self.times, values, strict=True):
            apart[any(begun <= time <= ended for begun, ended in self.floods)].append(value)
        return apart

    @property
    def cpu_per_tick(self) -> list[float]:
        """Processor time of the run's process since the tick before [s]."""
        return [0.0, *(after - before for before, after in zip(self.cpu, self.cpu[1:], strict=False))]


class LinkThread(LinkProcess):
    """The same link in a thread of the run's process: what it is compared with."""

    def __init__(self, listening: socket.socket, settings: LinkSettings) -> None:
        self._thread: threading.Thread | None = None
        super().__init__(listening, settings)

    def _begin(self) -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        for each in (ours, theirs):
            each.setblocking(False)
        self._thread = threading.Thread(target=self._serve, args=(self._listening, theirs), daemon=True)
        self._thread.start()
        ours.send(self._first)
        self._ours = ours

    def tell(self, status: bytes) -> None:
        """What the robot does, for the operator."""
        if self._ours is not None:
            with suppress(OSError):
                self._ours.send(status)

    def close(self) -> None:
        """End it."""
        if self._ours is not None:
            self._forget(self._ours)
        if self._thread is not None:
            self._thread.join(5.0)

    def _ended(self, ours: socket.socket) -> LinkReport:
        """The thread is no more: what is compared is lost."""
        self._forget(ours)
        raise ArtemisError("the thread of the operator's link has ended")

    @staticmethod
    def _serve(listening: socket.socket, port: socket.socket) -> None:
        with listening, port:
            asyncio.run(serve(listening, port))


def run_beside(command: Sequence[str], mission: Path, ticks: Ticks) -> str:
    """Run a mission while another program is at it; returns what that printed as errors.

    Raises:
        ArtemisError: the run failed.
    """
    program = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        if run_mission(load_mission(mission), mission, watch=ticks.see).failed:
            raise ArtemisError(f"the run failed: {ticks.faults}")
        _, errors = program.communicate(timeout=20)
    finally:
        program.kill()
        program.wait()
    return errors


def drive(robot: Path, seconds: float, seed: int, *, flood: bool, thread: bool = False) -> Ticks:
    """A run in real time on simulated drives, driven over the network by a hand in another process."""
    ticks = Ticks()
    with TemporaryDirectory() as made, _link(thread=thread):
        folder = Path(made)
        secret, out, port = folder / "operator.secret", folder / "hand.json", free_port()
        write_secret(secret, SECRET)
        (folder / "robot.yaml").write_bytes(robot.read_bytes())
        mission = folder / "mission.yaml"
        given = {"remote": {"plugin": "network", "port": port, "secret": "operator.secret"}}
        steps = [{"teleop": {"input": "remote", "until": {"button": "done"}}}]
        words = {"mission": "bench", "robot": "robot.yaml", "bus": "simulation", "inputs": given, "steps": steps}
        mission.write_text(json.dumps(words))
        command = [sys.executable, "-m", "artemis_lab.bench.operator_hand"]
        arguments = [str(port), str(secret), str(out), str(seconds), str(seed), "flood" if flood else "quiet"]
        errors = run_beside([*command, *arguments], mission, ticks)
        if not out.exists():
            raise ArtemisError(errors)
        told = json.loads(out.read_text())
        ticks.reports, ticks.floods = told["reports"], [tuple(each) for each in told["floods"]]
    return ticks


def cuts(robot: Path, times: int) -> list[float]:
    """From a link that is cut without a word to the tick that finds it lost [s]; ticks at 50 Hz, in real time."""
    return clock.run(_cuts(load_model(robot, RobotFile), times), simulated=False)


async def _cuts(robot: RobotFile, times: int) -> list[float]:
    loop, found = asyncio.get_running_loop(), []
    with TemporaryDirectory() as made:
        write_secret(Path(made) / "secret", SECRET)
        config = NetworkConfig(port=free_port(), secret="secret")
        device = NetworkInput(config, PluginContext(name="remote", robot=robot, folder=Path(made), real_time=True))
        proxy = DamagingProxy(config.port)
        await proxy.begin()
        try:
            await until(loop.time() + 0.5)
            for number in range(times):
                found.append(await _one_cut(device, proxy, number / times))
        finally:
            await proxy.close()
            device.close()
    return found


async def _one_cut(device: NetworkInput, proxy: DamagingProxy, phase: float) -> float:
    loop = asyncio.get_running_loop()
    proxy.to_robot.cut = proxy.to_operator.cut = False
    _, protocol = await loop.create_connection(
        lambda: _RobotProtocol(OperatorEnd(SECRET, "hand")), "127.0.0.1", proxy.port
    )
    sending = asyncio.ensure_future(_send(protocol))
    cut, deadline, index = 0.0, loop.time(), 0
    while True:
        deadline += PERIOD
        await until(deadline)
        sample = device.read(loop.time())
        rows = {row for row, _ in device.take_problems()}
        if cut and "NET-01" in rows:
            break
        index += sample.age is not None and sample.age < 0.2
        if index == 25:
            await until(loop.time() + phase * PERIOD)
            proxy.to_robot.cut = proxy.to_operator.cut = True
            cut = loop.time()
            index += 1
    found = loop.time() - cut
    sending.cancel()
    protocol.abort()
    await protocol.closed
    while device._report.seat == "held":  # noqa: SLF001 (nobody else needs to know)
        await until(loop.time() + PERIOD)
        device.read(loop.time())
    return found


async def _send(protocol: _RobotProtocol) -> None:
    loop = asyncio.get_running_loop()
    hand = OperatorInput(source="hand", age=0.0)
    while True:
        protocol.end.command(hand, loop.time())
        protocol.flush()
        await until(loop.time() + PERIOD)


@contextmanager
def _link(*, thread: bool) -> Iterator[None]:
    with patch.object(network, "LinkProcess", LinkThread if thread else LinkProcess):
        yield
