"""Temperatures of power stages: of which drives, how often, how long they count, and who is not asked."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import pytest
from core_builders import FakeBus
from msgspec.json import encode

from artemis.clock import run
from artemis.devices.bus_gateway import BusGateway
from artemis.devices.can_bus import Frame
from artemis.devices.canopen import SdoAbort
from artemis.devices.epos import EposDrive
from artemis.devices.temperature import EVERY, VALID, temperature_readers
from artemis.errors import DeviceTimeout
from artemis.mission.loading import load_model
from artemis.values import DriveFeedback, Mode
from artemis.vehicle import RobotFile

ROBOTS = Path(__file__).parents[2] / "missions" / "robots"
EPOS4 = load_model(ROBOTS / "artemis_epos4.yaml", RobotFile)
FRESH, OLD = 0.02, 0.5


class Objects:
    """A drive that answers at once with what the test says."""

    late_answers = 0

    def __init__(self, answer: Callable[[], bytes]) -> None:
        self.answer, self.asked = answer, list[float]()

    async def read(self, index: int, subindex: int, size: int = 0) -> bytes:
        assert (index, subindex, size) == (0x3201, 1, 2)
        self.asked.append(asyncio.get_running_loop().time())
        return self.answer()

    async def write(self, index: int, subindex: int, data: bytes, patience: float | None = None) -> None:
        raise AssertionError("it only reads")

    def receive(self, frame: Frame) -> None:
        raise AssertionError("it has no bus")


class Watch:
    """Two drives that are read for a while, on virtual time."""

    def __init__(self, answer: Callable[[], bytes], robot: RobotFile = EPOS4) -> None:
        self.wire = BusGateway(robot, FakeBus())
        self.wire.begin(Mode.FOLLOW, judged=True)
        self.first, self.second = (EposDrive(name, robot, self.wire) for name in ("traction-left", "steer-left"))
        self.objects = Objects(answer)
        self.first.sdo = self.objects
        self.second.sdo = Objects(lambda: (250).to_bytes(2, "little"))
        self.status_age = FRESH
        self.seen: list[tuple[float, float | None]] = []
        """Of the first, ten times a second."""

    def through(self, seconds: float, change: Callable[[float], None] = lambda time: None) -> Watch:
        """`change` is called before each look, with the time."""
        run(self._through(seconds, change), simulated=True)
        return self

    async def _through(self, seconds: float, change: Callable[[float], None]) -> None:
        loop = asyncio.get_running_loop()
        works = temperature_readers([self.first, self.second], self.wire)
        tasks = [asyncio.ensure_future(work) for work in works]
        while loop.time() < seconds:
            change(loop.time())
            self.first.status_time, self.second.status_time = loop.time() - self.status_age, loop.time() - FRESH
            await asyncio.sleep(0.05)
            self.seen.append((loop.time(), self.first.feedback(loop.time()).temperature_c))
        assert self.second.feedback(loop.time()).temperature_c == (25.0 if self.second.family.temperature else None)
        for task in tasks:
            task.cancel()

    @property
    def known(self) -> list[float]:
        """When the temperature was."""
        return [time for time, value in self.seen if value is not None]


def warm() -> bytes:
    return (-314).to_bytes(2, "little", signed=True)


def test_each_drive_is_read_in_turn() -> None:
    watch = Watch(warm).through(200.0)
    assert len(watch.objects.asked) == pytest.approx(200.0 / EVERY, abs=1)
    assert {value for _, value in watch.seen} == {None, -31.4}
    assert watch.known[0] <= EVERY + 0.1
    assert watch.seen[-1][1] == -31.4


def test_a_drive_of_a_family_that_does_not_measure_it_is_not_asked() -> None:
    watch = Watch(warm, load_model(ROBOTS / "artemis.yaml", RobotFile)).through(40.0)
    assert watch.objects.asked == []
    assert watch.known == []


def test_one_that_does_not_answer_has_none_after_a_while_and_again_when_it_does() -> None:
    def answer() -> bytes:
        if 41.0 < asyncio.get_running_loop().time() < 121.0:
            raise DeviceTimeout("traction-left", "no answer")
        return warm()

    watch = Watch(answer).through(160.0)
    gap = [time for time, value in watch.seen if value is None and time > EVERY]
    assert 41.0 + VALID - EVERY <= gap[0] <= 41.0 + VALID
    assert 121.0 <= gap[-1] <= 121.0 + EVERY + 0.1


def test_an_answer_that_breaks_the_protocol_is_none_and_the_next_one_counts() -> None:
    def answer() -> bytes:
        if 15.0 < asyncio.get_running_loop().time() < 45.0:
            raise SdoAbort(0x3201, 1, 0x0504_0001)
        return warm()

    watch = Watch(answer).through(90.0)
    assert len(watch.objects.asked) == pytest.approx(90.0 / EVERY, abs=1)
    assert watch.seen[-1][1] == -31.4


@pytest.mark.parametrize("code", [0x0602_0000, 0x0609_0011])
def test_one_that_has_no_such_object_is_not_asked_again(code: int) -> None:
    def refuses() -> bytes:
        raise SdoAbort(0x3201, 1, code)

    watch = Watch(refuses).through(60.0)
    assert len(watch.objects.asked) == 1
    assert watch.known == []


def test_an_answer_that_cannot_be_one_is_none() -> None:
    assert Watch(lambda: b"\x01").through(40.0).known == []


@pytest.mark.parametrize(
    ("mode", "judged", "age", "asked"),
    [
        (Mode.INIT, False, FRESH, False),  # is being brought up
        (Mode.FOLLOW, True, OLD, False),  # is perhaps to be stopped by SDO
        (Mode.FAULT, False, FRESH, True),  # cools down
        (Mode.FAULT, False, OLD, False),
        (Mode.END, False, FRESH, False),
    ],
)
def test_no_drive_is_asked_that_has_other_things_to_do(mode: Mode, judged: bool, age: float, asked: bool) -> None:
    watch = Watch(warm)

    def change(_: float) -> None:
        watch.wire.begin(mode, judged=judged)
        watch.status_age = age
        watch.second.temperature = 25.0, 1e9  # of no interest here

    watch.through(40.0, change)
    assert bool(watch.objects.asked) == asked


def test_a_record_of_a_drive_without_it_is_as_it_was() -> None:
    assert b"temperature" not in encode(DriveFeedback(name="a"))
