"""The obstacle stop inside the decision core: ceiling, brake with wheels held, LAS-08, the end of a blocked step."""

from __future__ import annotations

import numpy as np
import pytest
from core_builders import ROUTE, ObedientDrives, StubFollower
from live_core import AHEAD, Live
from msgspec.structs import replace

from artemis.scan import ObstacleRules, Scan
from artemis.states.plan import FollowStep, Plan, Step, TeleopStep
from artemis.values import DriveFeedback, Mode, SetPoints, Tick, Wish
from artemis_lab.bench.obstacle_scenes import ANGLES, BEAMS, FIELD, robot_with_scanner

STOP = ObstacleRules(mode="stop", blocked_after=2.0)
TELEOP = TeleopStep(input="stick", seconds=None)


class HeardDrives(ObedientDrives):
    """Answer each SYNC: the odometry counts."""

    def react(self, wish: Wish, points: SetPoints) -> tuple[DriveFeedback, ...]:
        return tuple(replace(drive, frames=1) for drive in super().react(wish, points))


class Seeing(Live):
    """With a scanner that sees a wall so far ahead of it, or nothing [m]; None: no scans."""

    wall: float | None = 20.0

    def __init__(self, *steps: Step, rules: ObstacleRules = STOP) -> None:
        robot = robot_with_scanner()
        near = robot.scanners["front"].model_copy(update={"least_range_m": 0.1})
        super().__init__(*steps, robot=robot.model_copy(update={"scanners": {"front": near}}), obstacles=rules)
        self.drives = HeardDrives()

    def tick(self, **changes: object) -> Tick:
        if self.wall is not None:
            ranges = np.where(np.abs(ANGLES) < 0.9, self.wall / np.cos(ANGLES), 19.0)
            packed = np.round(1000.0 * ranges + len(self.seen) % 2).astype("<u2").tobytes()
            scan = Scan(
                source="front",
                time=self.time,
                start_angle=-FIELD,
                increment=2 * FIELD / (BEAMS - 1),
                ranges=packed,
                counter=len(self.seen),
            )
            changes = {"scans": (scan,), **changes}
        return super().tick(**changes)


def driving(step: Step = TELEOP, rules: ObstacleRules = STOP) -> Seeing:
    live = Seeing(step, rules=rules)
    live.until(Mode.TELEOP if isinstance(step, TeleopStep) else Mode.FOLLOW)
    live.inputs = (AHEAD,)
    enough = 1.0 if isinstance(step, TeleopStep) else 0.1
    live.until(lambda tick: tick.snapshot.odometry.distance > enough)
    return live


def test_a_free_path_limits_nothing() -> None:
    live = driving()
    assert live.ticks[-1].set_points.clearance is None


def test_slows_down_for_a_wall_and_stands_before_it() -> None:
    live = driving()
    live.wall = 0.2
    first = live.until(lambda tick: tick.set_points.clearance is not None)
    assert first.set_points.speed < 0.7
    stood = live.until(lambda tick: bool(tick.set_points.clearance and tick.set_points.clearance.blocked))
    assert stood.set_points.clearance is not None
    live.until(lambda tick: tick.set_points.speed == 0.0, longest=1.0)
    told = live.until(lambda tick: tick.snapshot.verdict.limits)
    assert [fault.id for fault in told.snapshot.verdict.faults] == ["LAS-08"]
    assert told.mode is Mode.TELEOP


def test_the_rules_of_a_step_go_before_those_of_the_mission() -> None:
    live = Seeing(replace(TELEOP, obstacles=ObstacleRules()), rules=STOP)
    live.until(Mode.TELEOP)
    live.inputs = (AHEAD,)
    live.wall = 0.2
    live.until(lambda tick: tick.snapshot.odometry.distance > 1.0)
    assert max(tick.set_points.speed for tick in live.ticks) == pytest.approx(0.3)


def test_a_blocked_step_waits_and_then_ends_as_blocked() -> None:
    live = driving(FollowStep(route=ROUTE, follower=StubFollower()))
    live.wall = 0.2
    live.until(lambda tick: bool(tick.set_points.clearance and tick.set_points.clearance.blocked))
    begun = live.time
    ended = live.until(lambda tick: tick.wish.outcome != "")
    assert ended.wish.outcome == "blocked"
    assert live.time - begun == pytest.approx(2.0, abs=0.3)
    assert live.until(Mode.END).failed


def test_a_mode_that_says_its_own_fault_keeps_it() -> None:
    live = driving()
    live.wall = 0.2
    live.until(lambda tick: bool(tick.set_points.clearance and tick.set_points.clearance.blocked))
    silent = live.until(lambda tick: tick.wish.fault is not None, inputs=())
    assert silent.wish.fault is not None
    assert silent.wish.fault.id in ("INP-01", "LAS-08")


def test_a_scanner_that_falls_silent_stops_the_robot() -> None:
    live = driving()
    live.wall = None
    live.until(Mode.QUICKSTOP)
    assert "LAS-01" in [fault.id for fault in live.ticks[-1].snapshot.verdict.faults]


def test_a_robot_waits_for_the_first_scan_and_is_not_blocked() -> None:
    live = Seeing(FollowStep(route=ROUTE, follower=StubFollower()), rules=STOP)
    live.wall = None
    live.until(Mode.FOLLOW)
    waits = live.until(lambda tick: tick.wish.phase == "waiting for a scan")
    later = live.until(lambda tick: tick.snapshot.sensed.time > waits.snapshot.sensed.time + 3.0)
    assert later.wish.phase == "waiting for a scan"
    assert {tick.wish.outcome for tick in live.ticks} == {""}
    assert all(fault.id != "LAS-08" for tick in live.ticks for fault in tick.snapshot.verdict.faults)
    live.wall = 8.0
    live.until(lambda tick: tick.snapshot.odometry.distance > 0.1)


def test_the_stop_knows_the_rules_of_every_step() -> None:
    wide, wider = replace(STOP, clear=0.7), replace(STOP, clear=1.0)
    steps = TELEOP, replace(TELEOP, obstacles=wide), FollowStep(route=ROUTE, follower=StubFollower(), obstacles=wider)

    assert Plan(robot=robot_with_scanner(), steps=steps, obstacles=STOP).rules == (STOP, wide, wider)


def test_a_great_distance_to_keep_limits_nothing_on_a_free_path() -> None:
    live = driving(replace(TELEOP, obstacles=replace(STOP, clear=1.0)))
    assert live.ticks[-1].set_points.clearance is None
