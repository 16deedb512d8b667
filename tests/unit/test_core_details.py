"""What the core and its loop begin with, and what a tick says: single values that whole runs rest on."""

from __future__ import annotations

from typing import ClassVar

import pytest
from core_builders import NAMES, PERIOD, ROBOT, FakeBus, drive, sensed
from live_core import AHEAD, REST, Live
from robot_rig import Rig

from artemis.clock import run
from artemis.config import Config
from artemis.devices.drive import Drives
from artemis.drive_states import DriveState
from artemis.motion.track import Track
from artemis.plugins.guard import PluginGuard
from artemis.robot import LIMITED_SPEED, Core, Robot
from artemis.states.plan import Plan, TeleopStep, WaitStep
from artemis.values import Cause, Event, Mode, OperatorInput, Pose, PoseFix, Request, Tick


def test_limited_speed_is_a_slow_walk() -> None:
    assert pytest.approx(0.3) == LIMITED_SPEED


def test_core_begins_where_the_plan_does_and_hands_out_what_its_run_leaves_behind() -> None:
    plan = Plan(robot=ROBOT, steps=(), start=Pose(x=3.0, y=-1.0), tracks={"way": Track(poses=[Pose(x=1.0)])})
    core = Core(plan, PERIOD)
    assert core.decide(sensed(0.0)).snapshot.odometry.pose == Pose(x=3.0, y=-1.0)
    assert core.results.tracks == dict(plan.tracks)
    assert Core(Plan(robot=ROBOT, steps=()), PERIOD).decide(sensed(0.0)).snapshot.odometry.pose == Pose()


def test_pose_of_a_localized_run_means_nothing_until_a_fix_comes() -> None:
    for localized in (False, True):
        pose = Core(Plan(robot=ROBOT, steps=(), localized=localized), PERIOD).decide(sensed(0.0)).snapshot.pose
        assert pose.lost is localized


def test_first_tick_judges_no_drive() -> None:
    silent = tuple(drive(name, state=DriveState.UNKNOWN, age=None, nmt=None, heartbeat_age=None) for name in NAMES)
    core = Core(Plan(robot=ROBOT, steps=()), PERIOD)
    for tick in range(50):
        assert core.decide(sensed(tick * PERIOD, drives=silent)).snapshot.verdict.faults == ()


def test_odometry_has_its_origin_where_the_wheels_were_aligned_and_counts_from_there() -> None:
    live = Live(TeleopStep(input="stick", seconds=None))
    live.until(Mode.TELEOP)
    live.until(lambda tick: tick.snapshot.odometry.pose.x > 0.2, longest=3.0, inputs=(AHEAD,))


def test_tick_says_why_its_mode_began() -> None:
    live = Live(WaitStep(seconds=9.0))
    assert live.until(Mode.READY).cause == Cause(event=Event.ALIGNED)
    assert live.tick().cause is None
    stopped = live.tick(requests=(Request.QUICKSTOP,), inputs=(REST,))
    assert stopped.cause == Cause(event=Event.STOP, request=Request.QUICKSTOP)


SURE = (0.01, 0.0, 0.0, 0.01, 0.0, 0.01)


class AskedLocalizer:
    """A localizer that notes when it is asked."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self) -> None:
        self.times: list[float] = []

    def fixes(self, now: float) -> tuple[PoseFix, ...]:
        self.times.append(round(now, 6))
        return (PoseFix(time=now, pose=Pose(x=now), covariance=SURE, source="tracker"),)

    def close(self) -> None: ...


def test_times_are_those_of_the_run_whenever_it_begins() -> None:
    asked: list[float] = []

    def read(now: float) -> OperatorInput:
        asked.append(round(now, 6))
        return OperatorInput(source="stick")

    rig = Rig(stick=read)
    attended: list[float] = []

    def there(time: float) -> tuple[bool, bool]:
        attended.append(round(time, 6))
        return True, False

    rig.attended = there
    rig.begins, rig.localizer = 1.5, (localizer := AskedLocalizer())
    rig.run(0.1)
    times = [round(seen.time, 6) for seen in rig.core.seen]
    assert times[:3] == [0.0, 0.02, 0.04]
    assert asked == attended == localizer.times == times
    assert [round(fix.time, 6) for seen in rig.core.seen for fix in seen.fixes] == times
    assert [round(seen.sent, 6) for seen in rig.core.seen] == [0.0, *times[:-1]]
    assert not any(seen.urgent or seen.late for seen in rig.core.seen)


def test_nobody_attends_a_robot_of_which_nothing_else_is_said() -> None:
    async def main() -> Tick:
        core = Core(Plan(robot=ROBOT, steps=()), PERIOD)
        robot = Robot(core, Drives(ROBOT, FakeBus()), PluginGuard({}, lambda: 0.0), PERIOD, lambda tick: None)
        return robot.tick(0.0)

    sensed = run(main(), simulated=True).snapshot.sensed
    assert (sensed.attended, sensed.awaited) == (False, False)


def test_bus_that_is_found_lost_between_ticks_makes_an_extra_tick_that_says_why() -> None:
    rig = Rig()

    def unplug() -> None:
        rig.bus.lost = True
        rig.bus.wake()

    rig.at(0.051, unplug)
    rig.run(0.1)
    assert [round(seen.time, 6) for seen in rig.urgent] == [0.051]
    assert "unplugged" in rig.urgent[0].faults[0].text


def test_health_of_the_bus_is_sensed() -> None:
    rig = Rig()

    def disturb() -> None:
        rig.bus.error_frames += 3

    rig.at(0.03, disturb)
    rig.run(0.1)
    assert [seen.bus.error_frames for seen in rig.core.seen] == [0, 0, 3, 0, 0, 0]


def test_callback_that_fails_without_an_exception_ends_the_run_with_what_was_said() -> None:
    rig = Rig()
    rig.at(0.03, lambda: rig.loop.call_exception_handler({"message": "something odd"}))
    with pytest.raises(ExceptionGroup) as caught:
        rig.run(0.1)
    assert [(type(error), str(error)) for error in caught.value.exceptions] == [(RuntimeError, "something odd")]
