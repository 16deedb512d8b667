"""Both ends of an operator's link over real TCP on loopback, through a proxy that damages what passes."""

from __future__ import annotations

import asyncio
import math
import socket
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, cast

import pytest
from link_rig import DRIVING, NEUTRAL, SECRET, welcome

from artemis import clock
from artemis.bridges.operator import frames
from artemis.bridges.operator.operator_end import RefusedLink
from artemis.bridges.operator.robot_end import MOST_WAITING, RobotEnd
from artemis.bridges.operator.server import OperatorServer
from artemis.bridges.operator.session import DEAD, Arrived
from artemis.clock import until
from artemis.commands.operator import DeviceChoice
from artemis.commands.operator_drive import OperatorDrive, _connected, _RobotProtocol
from artemis.config import Config
from artemis.errors import DeviceLost
from artemis.plugins.contracts import InputDevice, PluginContext
from artemis.values import OperatorInput
from artemis_lab.injections.damaged_link import DamagingProxy

pytestmark = pytest.mark.realtime

PATIENCE = 20.0
"""For anything on a busy computer [s]."""


@dataclass
class Scene:
    """A robot's end that listens, a proxy before it, and an operator who drives through that."""

    end: RobotEnd = field(default_factory=lambda: RobotEnd(SECRET, welcome()))
    problems: list[tuple[str, str]] = field(default_factory=list)
    counted: list[Arrived] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    late: int = 0

    def reported(self) -> None:
        """What the run would be told."""
        if self.end.has_news:
            report = self.end.report
            self.problems += report.problems
            self.counted += [report.newest] if report.newest is not None else []
            self.lost += [report.why] if report.seat == "lost" else []
            self.late += report.late is not None
            self.end.begin_report()

    @property
    def rows(self) -> set[str]:
        return {row for row, _ in self.problems}

    async def connect(self, name: str = "alice", secret: bytes = SECRET, role: int = frames.DRIVE) -> _RobotProtocol:
        return await _connected("127.0.0.1", self.proxy.port, secret, None, name, role)

    async def drive(self, protocol: _RobotProtocol) -> None:
        """Until the link ends."""
        loop = asyncio.get_running_loop()
        while not protocol.closed.done():
            protocol.end.command(DRIVING, loop.time())
            protocol.flush()
            await until(loop.time() + 0.02)

    async def see(self, condition: Callable[[], object]) -> None:
        """Wait for it."""
        loop = asyncio.get_running_loop()
        async with asyncio.timeout(PATIENCE):
            while not condition():
                await until(loop.time() + 0.01)

    async def play(self, act: Callable[[Scene, _RobotProtocol], Awaitable[Any]]) -> None:
        listening = socket.socket()
        listening.bind(("127.0.0.1", 0))
        self.port = listening.getsockname()[1]
        server = OperatorServer(self.end, self.reported)
        self.proxy = DamagingProxy(self.port)
        await server.begin(listening, None)
        await self.proxy.begin()
        try:
            alice = await self.connect()
            driving = asyncio.ensure_future(self.drive(alice))
            await self.see(lambda: self.counted)
            await act(self, alice)
            driving.cancel()
            await alice.finish()
            with suppress(asyncio.CancelledError):
                await driving
        finally:
            await self.proxy.close()
            await server.close("over")


def play(act: Callable[[Scene, _RobotProtocol], Awaitable[Any]]) -> Scene:
    scene = Scene()
    clock.run(scene.play(act), simulated=False)
    return scene


def test_link_lost() -> None:
    async def cut(scene: Scene, _: _RobotProtocol) -> None:
        """Half-open: nothing passes, and no connection is closed."""
        scene.proxy.to_robot.cut = scene.proxy.to_operator.cut = True
        await scene.see(lambda: scene.end.owner is None)

    scene = play(cut)
    assert scene.lost[0] == f"nothing was received for {DEAD:g} s"


def test_latency() -> None:
    async def delay(scene: Scene, _: _RobotProtocol) -> None:
        scene.proxy.to_robot.delay_s = 0.4
        await scene.see(lambda: scene.late >= 5)
        before = len(scene.counted)
        late = scene.late
        await scene.see(lambda: scene.late >= late + 5)
        newest = {arrived.sent for arrived in scene.counted[before - 1 :]}
        assert len(newest) == 1, "none of them counts"

    play(delay)


def test_jitter() -> None:
    async def shake(scene: Scene, _: _RobotProtocol) -> None:
        proxy = scene.proxy
        loop = asyncio.get_running_loop()
        end = loop.time() + PATIENCE
        while "NET-03" not in scene.rows and loop.time() < end:
            proxy.to_robot.stall = not proxy.to_robot.stall
            await until(loop.time() + (0.13 if proxy.to_robot.stall else 0.01))

    assert "NET-03" in play(shake).rows


def test_stall_then_a_burst() -> None:
    async def stall(scene: Scene, _: _RobotProtocol) -> None:
        scene.proxy.to_robot.stall = True
        await until(asyncio.get_running_loop().time() + 0.6)
        scene.proxy.to_robot.stall = False
        await scene.see(lambda: "NET-04" in scene.rows)

    play(stall)


def test_loss() -> None:
    async def lose(scene: Scene, _: _RobotProtocol) -> None:
        scene.proxy.to_robot.loss = 0.4
        await scene.see(lambda: "NET-05" in scene.rows)

    play(lose)


@pytest.mark.parametrize("damage", ["duplicate", "reorder"])
def test_twice_or_in_another_order(damage: str) -> None:
    async def repeat(scene: Scene, alice: _RobotProtocol) -> None:
        setattr(scene.proxy.to_robot, damage, 1.0)
        await alice.closed

    scene = play(repeat)
    assert "NET-06" in scene.rows
    assert "frames were replayed" in scene.lost


def test_replayed() -> None:
    async def replay(scene: Scene, alice: _RobotProtocol) -> None:
        await scene.see(lambda: len(scene.counted) >= 10)
        scene.proxy.to_robot.replay = 10
        await alice.closed

    assert "NET-06" in play(replay).rows


def test_forged() -> None:
    async def forge(scene: Scene, alice: _RobotProtocol) -> None:
        scene.proxy.to_robot.forge = 0.5
        await alice.closed

    scene = play(forge)
    assert "NET-07" in scene.rows
    assert {(arrived.speed, arrived.steering) for arrived in scene.counted} == {(DRIVING.speed, DRIVING.steering)}


def test_wrong_key() -> None:
    async def knock(scene: Scene, alice: _RobotProtocol) -> None:
        with pytest.raises(RefusedLink, match="another secret"):
            await scene.connect("mallory", bytes(32))
        before = len(scene.counted)
        await scene.see(lambda: len(scene.counted) > before)
        assert not alice.closed.done()

    assert play(knock).rows >= {"NET-07"}


def test_second_operator_and_hand_over() -> None:
    async def hand_over(scene: Scene, alice: _RobotProtocol) -> None:
        with pytest.raises(RefusedLink, match=r"alice at 127\.0\.0\.1 has the robot"):
            await scene.connect("bob")
        alice.end.release()
        alice.flush()
        await alice.closed
        assert alice.end.over == "the robot is free"
        bob = await scene.connect("bob")
        bob.end.command(NEUTRAL, asyncio.get_running_loop().time())
        assert scene.end.owner is not None
        assert scene.end.owner.who == "bob at 127.0.0.1"
        await bob.finish()

    assert play(hand_over).rows >= {"NET-08"}


def test_malformed() -> None:
    async def shout(scene: Scene, alice: _RobotProtocol) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", scene.port)
        writer.write(b"GET / HTTP/1.1\r\n\r\n" * 100)
        assert len(await reader.read()) == 2 + 2 + frames.NONCE, "nothing but the greeting"
        writer.close()
        await scene.see(lambda: "NET-09" in scene.rows)
        assert not alice.closed.done()

    play(shout)


def test_flood() -> None:
    async def flood(scene: Scene, alice: _RobotProtocol) -> None:
        loop = asyncio.get_running_loop()
        while "NET-10" not in scene.rows:
            for _ in range(100):
                alice.end.command(DRIVING, loop.time())
            alice.flush()
            await until(loop.time() + 0.01)
        before = len(scene.counted)
        await scene.see(lambda: len(scene.counted) > before)

    play(flood)


def test_connections_that_say_nothing() -> None:
    async def wait(scene: Scene, _: _RobotProtocol) -> None:
        idle = [await asyncio.open_connection("127.0.0.1", scene.port) for _ in range(MOST_WAITING + 2)]
        await scene.see(lambda: "NET-10" in scene.rows)
        for reader, writer in idle:  # all are closed by the robot
            await reader.read()
            writer.close()

    play(wait)


def test_what_is_no_robot() -> None:
    async def ask(answer: bytes) -> None:
        def greet(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            writer.write(answer)
            writer.close()

        server = await asyncio.start_server(greet, "127.0.0.1", 0)
        try:
            await _connected("127.0.0.1", server.sockets[0].getsockname()[1], SECRET, None, "alice", frames.DRIVE)
        finally:
            server.close()
            await asyncio.sleep(0)

    for answer, words in {
        b"SSH-2.0-OpenSSH_9.2\r\n": "it closed the connection",
        b"\0\x05HTTP/": "no robot of artemis",
        b"": "it closed the connection",
        frames.framed(b"\x01\x63" + bytes(16)): "speaks version 99",
    }.items():
        with pytest.raises(RefusedLink, match=words):
            clock.run(ask(answer), simulated=False)
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        place = nobody.getsockname()[1]
        with pytest.raises(DeviceLost, match="refused; does the run of the robot listen there"):
            clock.run(_connected("127.0.0.1", place, SECRET, None, "alice", frames.DRIVE), simulated=False)


class Restless:
    """A stick that moves all the time; a device whose every report is news."""

    Config = Config

    def __init__(self) -> None:
        self.reads = 0
        self.closed = False
        self.missed = False
        """Whether the robot has heard that it was not plugged in."""

    def read(self, now: float) -> OperatorInput:
        self.reads += 1
        if self.reads >= 50 and not self.missed:
            raise DeviceLost("stick", "not plugged in")
        nan = self.reads % 100 == 60
        return OperatorInput(source="stick", age=0.0, speed=math.nan if nan else 0.001 * self.reads, neutral=False)

    def close(self) -> None:
        self.closed = True


class Given(DeviceChoice):
    """That device."""

    def made(self, context: PluginContext) -> InputDevice:
        return cast(InputDevice, STICK)


STICK = Restless()


def test_a_device_that_reports_all_the_time_is_no_flood(capsys: pytest.CaptureFixture[str]) -> None:
    statuses: list[int] = []

    async def drive(scene: Scene, alice: _RobotProtocol) -> None:
        alice.end.release()
        alice.flush()
        await alice.closed
        before = len(scene.counted)
        driving = OperatorDrive("127.0.0.1", scene.port, SECRET, None, "carol", Given(name="stick"))
        running = asyncio.ensure_future(driving._main())
        await scene.see(lambda: any(not arrived.heard for arrived in scene.counted))
        STICK.missed, reads = True, STICK.reads
        await scene.see(lambda: STICK.reads > reads + 300 and len(scene.counted) > before + 50)
        driving._ask("leave")
        statuses.append(await running)
        await scene.see(lambda: scene.end.owner is None)

    scene = play(drive)
    assert (statuses, STICK.closed) == ([0], True)
    assert not scene.rows & {"NET-06", "NET-09", "NET-10"}
    assert not any(math.isnan(arrived.speed) for arrived in scene.counted)
    shown = capsys.readouterr().out.splitlines()
    assert "device     stick: not plugged in" in shown
    assert "device     sent values out of range" in shown
    assert shown[-1] == "link       the robot is free"
