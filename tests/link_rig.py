"""An operator and his robot on virtual time: both ends of a link, and a network between that damages what passes."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import msgspec
from msgspec.structs import replace

from artemis.bridges.operator import frames
from artemis.bridges.operator.link_process import _DECODER, _ENCODER
from artemis.bridges.operator.operator_end import OperatorEnd, RefusedLink
from artemis.bridges.operator.robot_end import RobotEnd, RobotLink
from artemis.bridges.operator.session import BEAT_EVERY, LinkReport, Problem
from artemis.bridges.operator.status import Welcome
from artemis.mission.loading import load_model
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.network import NetworkConfig, NetworkInput
from artemis.values import OperatorInput, Request
from artemis.vehicle import RobotFile
from artemis_lab.injections.damaged_link import DamagedLine, LinkDamage

ROBOT = load_model(Path(__file__).parents[1] / "missions/robots/artemis.yaml", RobotFile)
SECRET = bytes(range(32))
STEP, SEND_EVERY, TICK = 0.002, 0.02, 0.02
NEUTRAL = OperatorInput(source="", age=0.0)
DRIVING = OperatorInput(source="", age=0.0, speed=0.4, steering=0.2, enabled=True, neutral=False, axes=(0.1, 0.8))


def welcome() -> bytes:
    """What a robot says of itself."""
    return msgspec.json.encode(Welcome(robot=msgspec.Raw(ROBOT.model_dump_json().encode())))


class Operator:
    """One operator, connected to the robot over a network of his own."""

    def __init__(self, net: Net, name: str, secret: bytes, role: int, seed: int) -> None:
        drawn = random.Random(seed)
        self.net, self.end = net, OperatorEnd(secret, name, role, drawn.randbytes)
        self.link: RobotLink | None = net.robot.connected("10.0.0.2", net.now)
        self.to_robot, self.to_operator = LinkDamage(), LinkDamage()
        self._lines = DamagedLine(self.to_robot, seed), DamagedLine(self.to_operator, seed + 1)
        self.hand = NEUTRAL
        self.hangs = False
        """His program does nothing."""
        self.own_time: Callable[[float], float] = lambda now: now
        """His clock."""
        self.refused = ""
        self._sent = -1.0

    def step(self, now: float) -> None:
        """Let bytes pass."""
        to_robot, to_operator = self._lines
        if self.link is not None:
            to_operator.feed(bytes(self.link.output), now)
            self.link.output.clear()
            self.link.receive(to_robot.take(now), now)
            if self.link.closing:
                to_operator.feed(bytes(self.link.output), now)
                self.net.robot.disconnected(self.link, now)
                self.link = None
        if self.hangs or self.refused:
            return
        mine = self.own_time(now)
        try:
            self.end.receive(to_operator.take(now), mine)
        except RefusedLink as error:
            self.refused = str(error)
        if now - self._sent >= SEND_EVERY and not self.end.over:
            self._sent = now
            self.send(self.hand)
        if self.end.output:
            to_robot.feed(bytes(self.end.output), now)
            self.end.output.clear()

    def send(self, sample: OperatorInput) -> None:
        """Send what he wishes; a request once."""
        self.end.command(sample, self.own_time(self.net.now))
        self.hand = replace(self.hand, requests=())

    def leave(self) -> None:
        """Release the seat."""
        self.end.release()

    def close(self) -> None:
        """His connection is closed, without a word."""
        if self.link is not None:
            self.net.robot.disconnected(self.link, self.net.now)
            self.link = None
        self.refused = self.refused or "closed"


class Seen(NamedTuple):
    """What a tick sees of the link."""

    time: float
    sample: OperatorInput
    problems: list[Problem]

    @property
    def rows(self) -> set[str]:
        return {row for row, _ in self.problems}


class Net:
    """A robot's end, its operators, and the input that ticks ask."""

    def __init__(self, seed: int = 1, **keys: object) -> None:
        allow = [Request[word.upper()] for word in keys.get("allow", ())]  # type: ignore[attr-defined]
        self.now = 0.0
        self.seed = seed
        self.robot = RobotEnd(SECRET, welcome(), allow, random.Random(seed).randbytes)
        self.operators: list[Operator] = []
        self.woken = 0
        context = PluginContext(name="stick", robot=ROBOT, folder=Path(), wake=self._wake)
        config = NetworkConfig.model_validate(keys)
        self.input = NetworkInput(config, context, self, lambda: self.now)
        self._beat = self._tick = 0.0
        self.seen: list[Seen] = []

    def operator(self, name: str = "alice", secret: bytes = SECRET, role: int = frames.DRIVE) -> Operator:
        """Another one connects."""
        self.operators.append(Operator(self, name, secret, role, self.seed + 10 * len(self.operators) + 1))
        return self.operators[-1]

    def advance(self, until: float) -> None:
        """Let time pass on the network."""
        while self.now < until - 1e-9:
            self.now = round(self.now + STEP, 6)
            if self.now >= self._beat:
                self._beat = round(self._beat + BEAT_EVERY, 6)
                self.robot.beat(self.now)
            for operator in self.operators:
                operator.step(self.now)

    def run(self, seconds: float) -> list[Seen]:
        """Let time pass, with ticks that ask the input; what these saw."""
        begun, end = len(self.seen), self.now + seconds
        while self.now < end - 1e-9:
            self._tick = round(self._tick + TICK, 6)
            self.advance(self._tick)
            self.seen.append(Seen(self.now, self.input.read(self.now), self.input.take_problems()))
        return self.seen[begun:]

    def _wake(self) -> None:
        self.woken += 1

    # ------------------------------------------------------------------------------------------ as the link's process

    def watch(self, news: Callable[[], None]) -> None:
        """Nothing calls back on virtual time."""

    def take(self) -> list[LinkReport]:
        """Through the bytes that two processes exchange."""
        if not self.robot.has_news:
            return []
        report = _DECODER.decode(_ENCODER.encode(self.robot.report))
        self.robot.begin_report()
        return [report]

    def tell(self, status: bytes) -> None:
        """For the next beat."""
        self.robot.status = status

    def close(self) -> None:
        """Nothing is open."""


def driving(seed: int = 1, **keys: object) -> tuple[Net, Operator]:
    """An operator who drives since a second."""
    net = Net(seed, **keys)
    operator = net.operator()
    net.run(0.4)
    operator.hand = DRIVING
    net.run(0.6)
    return net, operator


class LinkedInput(NetworkInput):
    """The input in a whole run on virtual time: the network is as far as the run."""

    live = False

    def __init__(self, net: Net) -> None:
        super().__init__(NetworkConfig(), PluginContext(name="stick", robot=ROBOT, folder=Path()), net, lambda: net.now)
        self.net = net

    def read(self, now: float) -> OperatorInput:
        self.net.advance(now)
        return super().read(now)
