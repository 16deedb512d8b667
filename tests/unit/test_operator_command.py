"""`artemis operator`: what its arguments mean, which device is made, and what is shown."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from link_rig import ROBOT

from artemis import clock
from artemis.bridges.operator.status import RobotStatus, ToldFault, status_of
from artemis.commands.operator import DeviceChoice, address_from, robot_from
from artemis.commands.operator_drive import OperatorDrive
from artemis.commands.operator_view import OperatorView, link_line
from artemis.errors import ConfigError, DeviceLost
from artemis.mission.loading import load_mission
from artemis.plugins.contracts import PluginContext
from artemis.testing.observers import ObserverContract
from artemis.values import OperatorInput, Request

MISSIONS = Path(__file__).parents[2] / "missions"
DRIVING = RobotStatus(time=1.0, mode="teleop", phase="driving", speed=0.25, steering=-3.0, counts=True)
FAULT = ToldFault("NET-01", "remote: link to the operator lost", True)
STOPPED = RobotStatus(
    time=2.0, mode="quickstop", phase="stopping", speed=0.0, steering=0.0, counts=False, faults=(FAULT,)
)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("127.0.0.1", ("127.0.0.1", 7482)),
        ("robot.local:9000", ("robot.local", 9000)),
        ("[::1]", ("::1", 7482)),
        ("[fe80::1]:80", ("fe80::1", 80)),
        ("fe80::1", ("fe80::1", 7482)),
    ],
)
def test_addresses(text: str, place: tuple[str, int]) -> None:
    assert address_from(text) == place


@pytest.mark.parametrize("text", ["", ":80", "robot:", "robot:x", "robot:65536", "[]:80", "[::1]x"])
def test_what_is_no_address(text: str) -> None:
    with pytest.raises(ConfigError, match="expected HOST, HOST:PORT"):
        address_from(text)


def test_a_device_is_made_for_the_robot_and_no_faster_than_it_allows() -> None:
    limits = ROBOT.limits.model_copy(update={"speed_m_s": 0.3})
    robot = robot_from(ROBOT.model_copy(update={"limits": limits}).model_dump_json().encode())
    assert robot.limits.speed_m_s == 0.3
    context = PluginContext(name="remote", robot=robot, folder=Path())
    table = str(MISSIONS / "inputs/loop.csv")
    choice = DeviceChoice(name="scripted", options=[f"file={table}", "max_speed_m_s=0.6"])
    choice.check()
    device = choice.made(context)
    speeds = [abs(device.read(tick / 10).speed) for tick in range(400)]
    device.close()
    assert 0.2 < max(speeds) <= 0.3
    inputs = load_mission(MISSIONS / "teleop_hand_over.yaml").mission.inputs
    for name in inputs:
        of_mission = DeviceChoice(name=name, mission=MISSIONS / "teleop_hand_over.yaml")
        made = of_mission.made(context)
        assert made.read(0.0).source == name
        made.close()


def test_keys_and_a_mission_exclude_each_other() -> None:
    choice = DeviceChoice(name="trainee", mission=MISSIONS / "teleop_hand_over.yaml", options=["max_speed_m_s=0.1"])
    with pytest.raises(ConfigError, match="--option: the mission has the keys"):
        choice.check()


def test_a_robot_of_another_version_is_named() -> None:
    with pytest.raises(ConfigError, match="the robot is of another version of artemis: robot: Field required"):
        robot_from(b"{}")


def test_the_line_says_whether_commands_count_and_how_old_they_are() -> None:
    line = link_line(DRIVING, 0.034, 0.0012, "you: +0.25 m/s -3° held")
    assert line == "teleop     +0.25 m/s   -3.0°  DRIVING  age  34 ms  round trip 1.2 ms  you: +0.25 m/s -3° held"
    assert link_line(None, None, None, "device silent") == "no command yet  device silent"
    assert "not driving" in link_line(STOPPED, 0.3, None, "")


def test_what_changes_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    view = OperatorView()
    for status in (DRIVING, DRIVING, STOPPED, STOPPED, DRIVING):
        view.see(status)
    view.device("stick: not plugged in")
    view.device("stick: not plugged in")
    view.device("")
    view.refresh(DRIVING, 0.1, 0.1, "")
    view.forget()
    view.see(DRIVING)
    view.close()
    driving = "robot      teleop: driving (your commands count)"
    assert capsys.readouterr().out.splitlines() == [
        driving,
        "robot      quickstop: stopping (your commands do not count)",
        "FAULT      NET-01 remote: link to the operator lost",
        driving,
        "cleared    NET-01",
        "device     stick: not plugged in",
        "device     it is there again",
        driving,
    ]


def test_a_state_fits_into_a_frame_however_long_its_words_are() -> None:
    import msgspec

    from artemis.supervision import catalogue

    tick = next(ObserverContract().ticks())
    faults = tuple(catalogue.fault("NET-01", "remote", "x" * 5000) for _ in range(50))
    verdict = msgspec.structs.replace(tick.snapshot.verdict, faults=faults)
    tick = msgspec.structs.replace(tick, snapshot=msgspec.structs.replace(tick.snapshot, verdict=verdict))
    assert len(msgspec.json.encode(status_of(tick, "remote"))) < 2000


class Pressed:
    """A device with a request in each sample; its axes are out of range."""

    def __init__(self, *requests: Request) -> None:
        self.requests = requests

    def read(self, now: float) -> OperatorInput:
        return OperatorInput(source="stick", age=0.0, speed=math.nan, enabled=True, requests=self.requests)

    def close(self) -> None: ...


def drive_with(*requests: Request) -> OperatorDrive:
    drive = OperatorDrive("127.0.0.1", 1, bytes(32), None, "carol", DeviceChoice(name="stick"))
    drive._device, drive._start = cast(Any, Pressed(*requests)), 0.0
    return drive


def test_a_stop_is_sent_whatever_else_the_device_says() -> None:
    async def sample() -> OperatorInput:
        return drive_with(Request.ARM, Request.QUICKSTOP)._sample()

    sent = clock.run(sample(), simulated=True)
    assert (sent.requests, sent.enabled, sent.age) == ((Request.QUICKSTOP,), False, None)


def test_of_what_is_asked_for_without_a_link_the_stop_alone_is_asked_for_later() -> None:
    drive, tries = drive_with(Request.QUICKSTOP, Request.ARM), []

    async def connect() -> object:
        tries.append(drive._asked)
        if len(tries) < 3:
            raise DeviceLost("robot", "no answer")
        drive._ask(Request.ACKNOWLEDGE)
        drive._device = cast(Any, Pressed(Request.ARM))
        return "connected"

    drive._connect = cast(Any, connect)
    assert cast(Any, clock.run(drive._again(), simulated=True)) == "connected"
    assert drive._asked == [Request.QUICKSTOP]


@pytest.mark.parametrize(("before", "again"), [(0.5, [Request.QUICKSTOP]), (10.0, [])])
def test_a_stop_that_may_have_been_lost_with_the_link_is_asked_for_again(
    before: float, again: list[Request], monkeypatch: pytest.MonkeyPatch
) -> None:
    drive, asked = drive_with(), []

    async def session(_: object) -> str:
        asked.append(list(drive._asked))
        drive._stop_sent = asyncio.get_running_loop().time() - before
        drive._leaving = len(asked) == 2
        return "lost"

    async def connect() -> object:
        return SimpleNamespace(end=SimpleNamespace(over=""))

    monkeypatch.setattr(drive, "_first", connect)
    monkeypatch.setattr(drive, "_connect", connect)
    monkeypatch.setattr(drive, "_session", session)
    assert clock.run(drive._main(), simulated=False) == 0
    assert asked == [[], again]
