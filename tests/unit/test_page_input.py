"""The input `page`: from reports of the page's process to samples, and what happens to the hand when it fails."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from dataclasses import replace
from math import radians
from pathlib import Path

import msgspec
import pytest

from artemis.bridges.operator.session import AT_ONCE, Arrived, LinkReport
from artemis.bridges.page.port import ENDED, PagePort, connected_to
from artemis.bridges.page.session import FRESH
from artemis.errors import ConfigError, DeviceLost
from artemis.mission.loading import load_model
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.page import PageInput, PageInputConfig
from artemis.plugins.stated import stale_limit
from artemis.values import Request
from artemis.vehicle import RobotFile

ROBOT = load_model(Path(__file__).parents[2] / "missions/robots/artemis.yaml", RobotFile)
CONTEXT = PluginContext(name="page", robot=ROBOT, folder=Path())


class Port:
    """Reports that a test makes."""

    def __init__(self) -> None:
        self.reports: list[LinkReport] = []
        self.news: Callable[[], None] = lambda: None

    def watch(self, news: Callable[[], None]) -> None:
        self.news = news

    def take(self) -> list[LinkReport]:
        reports, self.reports = self.reports, []
        return reports

    def tell(self, status: bytes) -> None:
        raise AssertionError

    def close(self) -> None:
        pass


class Hand:
    """Somebody at the page, and the input that reads what he does."""

    def __init__(self, config: PageInputConfig | None = None) -> None:
        self.now, self.port, self.woken = 0.0, Port(), 0
        context = replace(CONTEXT, wake=self._wake)
        self.input = PageInput(config or PageInputConfig(), context, self.port, lambda: self.now)

    def _wake(self) -> None:
        self.woken += 1

    def does(self, held: bool, x: float = 0.0, y: float = 0.0, *, old: float = 0.0) -> None:
        neutral = not held and x == y == 0.0
        newest = Arrived(self.now - old, True, held, neutral, 0.0, 0.0, 0.0, (x, y))
        self.port.reports.append(LinkReport("held", "phone", 0.0, newest=newest))

    def drives(self, seconds: float, held: bool, x: float = 0.0, y: float = 0.0) -> None:
        for _ in range(round(seconds / 0.02)):
            self.now += 0.02
            self.does(held, x, y)
            self.input.read(self.now)


def test_full_deflection_is_the_mission_s_speed_and_the_robot_s_angle() -> None:
    hand = Hand(PageInputConfig(max_speed_m_s=0.5))
    hand.drives(0.1, held=False)
    hand.drives(1.0, held=True, x=-1.0, y=1.0)
    sample = hand.input.read(hand.now)
    assert sample.enabled
    assert not sample.neutral
    assert sample.speed == 0.5
    assert sample.steering == pytest.approx(radians(ROBOT.limits.steering_deg), abs=1e-9)  # left


def test_it_counts_only_after_everything_was_released() -> None:
    hand = Hand()
    hand.drives(0.2, held=True, y=1.0)
    assert not hand.input.read(hand.now).enabled
    hand.drives(0.04, held=False)
    hand.drives(0.04, held=True, y=1.0)
    assert hand.input.read(hand.now).enabled


def test_a_gap_stops_and_has_to_be_released() -> None:
    hand = Hand()
    hand.drives(0.1, held=False)
    hand.drives(0.5, held=True, y=1.0)
    hand.now += FRESH - 0.01
    assert hand.input.read(hand.now).enabled
    assert hand.input.take_problems() == []
    hand.now += 0.02
    assert not hand.input.read(hand.now).enabled
    assert [row for row, _ in hand.input.take_problems()] == ["NET-01"]
    hand.drives(0.5, held=True, y=1.0)
    assert not hand.input.read(hand.now).enabled, "still held"


def test_a_hand_that_let_go_wishes_nothing() -> None:
    hand = Hand()
    hand.drives(0.1, held=False)
    hand.drives(1.0, held=True, y=1.0)
    hand.drives(0.02, held=False, y=1.0)
    sample = hand.input.read(hand.now)
    assert (sample.enabled, sample.speed) == (False, 0.0)


def test_the_direction_changes_at_standstill_only() -> None:
    hand = Hand()
    hand.drives(0.1, held=False)
    hand.drives(2.0, held=True, y=1.0)
    hand.drives(0.1, held=True, y=-1.0)
    assert hand.input.read(hand.now).speed == 0.0
    hand.drives(3.0, held=True, y=-1.0)
    assert hand.input.read(hand.now).speed == -ROBOT.limits.speed_m_s


def test_a_stop_makes_a_tick_of_its_own() -> None:
    hand = Hand()
    hand.port.reports.append(LinkReport(requests=[Request.QUICKSTOP]))
    hand.port.news()
    assert hand.woken == 1
    assert hand.input.read(0.0).requests == (Request.QUICKSTOP,)


def test_who_gave_control_back_leaves_no_fault() -> None:
    hand = Hand()
    hand.drives(0.1, held=False)
    hand.port.reports.append(LinkReport("free", "phone", 1.0))
    sample = hand.input.read(1.0)
    assert (sample.enabled, sample.neutral, sample.age) == (False, True, 0.0)
    assert hand.input.take_problems() == []


def test_who_went_away_with_control_leaves_one() -> None:
    hand = Hand()
    hand.port.reports.append(LinkReport("lost", "phone", 1.0, "the connection was closed"))
    assert not hand.input.read(1.0).enabled
    assert hand.input.take_problems() == [("NET-01", "phone: the connection was closed")]


@pytest.mark.parametrize("required", [True, False])
def test_nobody_is_waited_for_where_nobody_is_required(required: bool) -> None:
    sample = Hand(PageInputConfig(required=required)).input.read(0.0)
    assert (sample.neutral, sample.age) == ((False, None) if required else (True, 0.0))


def test_without_real_time_nobody_drives() -> None:
    made = PageInput(PageInputConfig(), CONTEXT)
    with pytest.raises(DeviceLost, match="pace: fast"):
        made.read(0.0)
    made.close()


def test_its_age_limit_is_its_own() -> None:
    assert stale_limit(PageInput) == FRESH


def test_more_speed_than_the_robot_has_is_refused() -> None:
    with pytest.raises(ConfigError, match="max_speed_m_s"):
        PageInput(PageInputConfig(max_speed_m_s=1.9), CONTEXT)


# ------------------------------------------------------------------------------------------ the local socket


def test_a_process_reports_over_the_local_socket_and_its_end_is_a_loss() -> None:
    async def go() -> list[LinkReport]:
        port, came = PagePort("page"), asyncio.Event()
        try:
            port.watch(came.set)
            process = connected_to(os.getpid(), "page")
            assert process is not None
            process.send(msgspec.msgpack.encode(LinkReport("held", "phone", 1.0)))
            async with asyncio.timeout(5):
                await came.wait()
                reports = port.take()
                while not reports:
                    await asyncio.sleep(0)
                    reports = port.take()
                process.close()
                while len(reports) < 2:
                    await asyncio.sleep(0)
                    reports += port.take()
            again = connected_to(os.getpid(), "page")
            assert again is not None
            again.close()
        finally:
            port.close()
            port.close()
        assert connected_to(os.getpid(), "page") is None
        return reports

    held, lost = asyncio.run(go())
    assert (held.seat, lost.seat, lost.who, lost.why) == ("held", "lost", "phone", ENDED)


def test_a_tick_takes_only_so_many_reports_and_leaves_the_rest_to_the_next() -> None:
    async def go() -> list[int]:
        port = PagePort("page")
        try:
            port.watch(lambda: None)
            process = connected_to(os.getpid(), "page")
            assert process is not None
            await asyncio.sleep(0)
            for _ in range(AT_ONCE + 5):
                process.send(msgspec.msgpack.encode(LinkReport("held", "phone", 1.0)))
            while not (first := port.take()):
                await asyncio.sleep(0)
            process.close()
            return [len(first), len(port.take())]
        finally:
            port.close()

    assert asyncio.run(go()) == [AT_ONCE, 5 + 1]  # with the page's end


def test_one_run_has_one_page() -> None:
    port = PagePort("page")
    try:
        with pytest.raises(ConfigError, match="local socket"):
            PagePort("page")
    finally:
        port.close()
