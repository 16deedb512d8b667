"""How a step goto gets its route, drives it, and gets another one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from core_builders import PERIOD, ROBOT, StubFollower, fault_of, shared, snapshot
from msgspec.structs import replace

from artemis.motion.planned_route import NOT_KEPT, ONLY_CHECKED, PLANNER, packed_route, planned_route
from artemis.progress import BLOCKED, NO_PATH
from artemis.scan import Clearance, ObstacleRules
from artemis.states.blocked import REPLAN_AFTER, heeded
from artemis.states.follow import FollowMode
from artemis.states.goto import take_goal
from artemis.states.plan import FollowStep, GotoStep, Shared, WaitStep
from artemis.states.ready import ReadyMode
from artemis.states.route_progress import RouteProgress
from artemis.values import (
    Event,
    JobKind,
    JobResult,
    LocatedPose,
    Mode,
    OperatorInput,
    Pose,
    SetPoints,
    Wish,
)

X = np.linspace(0.0, 2.0, 41)
VALUES = packed_route(planned_route(np.column_stack([X, 0 * X, np.full(41, 0.4)]), ROBOT, 0.4))
OTHER = packed_route(planned_route(np.column_stack([X, 0.1 * X * X, np.full(41, 0.4)]), ROBOT, 0.4))


def step(**options: Any) -> GotoStep:  # noqa: ANN401 (keys of the step)
    return GotoStep(route="", place="gate", follower=StubFollower(), speed=0.4, **options)


class Standing:
    """Mode ready of a robot whose step is a goto."""

    def __init__(self, *steps: GotoStep | WaitStep) -> None:
        self.shared = shared(*(steps or (step(),)))
        self.mode, self.time = ReadyMode(self.shared), 0.0
        self.mode.enter(snapshot(0.0))

    def tick(self, *results: JobResult, **changes: Any) -> Wish:  # noqa: ANN401 (of the snapshot)
        self.time += PERIOD
        seen = snapshot(self.time, results=results, **changes)
        wish = self.mode.step(seen)
        self.shared.advance(wish, seen, standing=True)
        return wish

    def planned(self, values: tuple[int, ...], *, ok: bool = True, detail: str = "") -> Wish:
        """Order a route, and get it."""
        (job,) = self.tick().jobs
        return self.tick(JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=ok, values=values, detail=detail))


def test_a_route_is_ordered_once_and_driven_when_it_is_there() -> None:
    robot = Standing()
    first = robot.tick()
    assert [(job.kind, job.drive, job.value) for job in first.jobs] == [(JobKind.PLAN, PLANNER, 0.0)]
    assert first.phase == "planning a route to gate"
    assert robot.tick().jobs == ()
    result = JobResult(id=first.jobs[0].id, kind=JobKind.PLAN, drive=PLANNER, ok=True, values=VALUES)
    assert robot.tick(result).event is Event.FOLLOW
    assert robot.shared.route.planned == VALUES


def test_a_robot_that_is_there_is_done_and_one_without_a_route_says_so() -> None:
    assert Standing().planned(()).over
    refused = Standing().planned((), ok=False, detail="no path leads there")
    assert (refused.outcome, refused.phase) == (NO_PATH, "no route to gate: no path leads there")


def test_a_lost_pose_is_a_fault_and_nothing_is_ordered() -> None:
    wish = Standing().tick(pose=LocatedPose(lost=True))
    assert fault_of(wish)[0] == "RUN-08"
    assert wish.jobs == ()


def test_what_was_ordered_before_a_stop_does_not_count() -> None:
    robot = Standing()
    (old,) = robot.tick().jobs
    robot.mode.enter(snapshot(robot.time))
    wish = robot.tick(JobResult(id=old.id, kind=old.kind, drive=old.drive, ok=True, values=VALUES))
    assert len(wish.jobs) == 1
    assert wish.event is None


def test_where_no_other_route_leads_it_drives_on_along_the_one_it_has() -> None:
    robot = Standing()
    robot.planned(VALUES)
    assert robot.shared.route.replan(3, 0.5, 2.5)
    robot.mode.enter(snapshot(robot.time))
    wish = robot.planned((*VALUES,), ok=False)
    assert (wish.event, wish.outcome, robot.shared.route.planned) == (Event.FOLLOW, "", VALUES)
    assert (robot.shared.route.replanning, robot.shared.route.replans) == (False, 1)


def test_a_route_that_the_planner_does_not_give_back_is_not_driven_on() -> None:
    robot = Standing()
    robot.planned(VALUES)
    assert robot.shared.route.replan(3, 0.5, 2.5)
    robot.mode.enter(snapshot(robot.time))
    wish = robot.planned((), ok=False, detail="a zone that is new is in the way")
    assert (wish.event, wish.outcome) == (None, NO_PATH)
    assert wish.phase == "no route to gate: a zone that is new is in the way"


def test_with_a_given_goal_such_a_route_is_forgotten_and_another_goal_waited_for() -> None:
    robot = Standing(step(asks="stick"))
    goal = OperatorInput(source="stick", age=0.0, goal=Pose(x=1.0))
    take_goal(robot.shared, snapshot(0.0, inputs=(goal,)))
    robot.planned(VALUES)
    assert robot.shared.route.replan(3, 0.5, 2.5)
    robot.mode.enter(snapshot(robot.time))
    wish = robot.planned((), ok=False, detail="a zone that is new is in the way")
    assert (wish.event, wish.outcome, robot.shared.route.planned, robot.shared.route.goal) == (None, "", (), None)
    assert "a zone that is new is in the way; waiting" in wish.phase


def test_a_route_that_is_free_again_is_gone_on_with_and_uses_up_no_other_one() -> None:
    robot = Standing()
    robot.planned(VALUES)
    robot.shared.position = replace(robot.shared.position, done=0.5)
    for _ in range(5):
        assert robot.shared.route.replan(3, 0.5, 2.5)
        robot.mode.enter(snapshot(robot.time))
        (job,) = robot.tick().jobs
        assert job.values == VALUES
        wish = robot.tick(JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=True, values=(*VALUES,)))
        assert (wish.event, wish.done) == (Event.FOLLOW, None)
    assert robot.shared.route.replans == 0
    assert robot.shared.route.waited(0.55) == 12.5
    assert robot.shared.route.waited(0.7) == 0.0


def test_a_step_that_begins_anew_forgets_the_route_and_what_was_tried() -> None:
    robot = Standing()
    robot.planned(VALUES)
    robot.shared.route.replan(3, 0.5, 2.5)
    robot.tick()
    assert robot.shared.position.state == "[1]"
    robot.shared.route = RouteProgress("")
    robot.tick()
    assert (robot.shared.route.planned, robot.shared.route.replans, robot.shared.route.replanning) == ((), 0, False)


def blocked(steps: Shared, seconds: float, *, standing: bool = True, unseen: bool = False) -> Wish:
    clearance = Clearance(speed=0.0, distance=0.02, blocked=seconds, unseen=unseen)
    seen = replace(snapshot(10.0, set_points=SetPoints(clearance=clearance)), standing=standing)
    return heeded(steps, Mode.FOLLOW, Wish(done=1.0), seen)


def test_another_route_is_sought_after_some_seconds_so_often_as_the_step_says() -> None:
    steps = shared(step(replans=1, obstacles=ObstacleRules(mode="stop", blocked_after=5.0)))
    steps.route.planned = VALUES

    assert fault_of(blocked(steps, REPLAN_AFTER - 0.1))[0] == "LAS-08"
    assert fault_of(blocked(steps, REPLAN_AFTER, standing=False))[0] == "LAS-08"
    asked = blocked(steps, REPLAN_AFTER)
    assert (asked.event, asked.outcome, asked.done, steps.route.replanning) == (Event.DONE, "", 1.0, True)
    assert fault_of(blocked(steps, 5.0 - REPLAN_AFTER - 0.1))[0] == "LAS-08"
    assert blocked(steps, 5.0 - REPLAN_AFTER).outcome == BLOCKED  # with what it waited before


def freed(steps: Shared, *, standing: bool = True) -> Wish:
    """In the first tick in which nothing is in the way any more."""
    seen = replace(snapshot(10.0), standing=standing)
    return heeded(steps, Mode.FOLLOW, Wish(done=1.0, phase="following"), seen)


def test_after_a_wait_in_which_no_route_was_planned_the_present_one_is_checked_before_it_is_driven_on() -> None:
    steps = shared(step(replans=0, obstacles=ObstacleRules(mode="stop", blocked_after=60.0)))
    steps.route.planned = VALUES

    blocked(steps, REPLAN_AFTER - 0.1)
    assert freed(steps).phase == "following", "a plan is never that young"
    blocked(steps, 30.0)
    asked = freed(steps)
    assert (asked.event, asked.done, steps.route.present) == (Event.DONE, 1.0, (ONLY_CHECKED, *VALUES))
    steps.route.checking = False
    assert freed(steps).phase == "following", "once"
    blocked(steps, 30.0)
    assert freed(steps, standing=False).phase == "following"
    assert freed(steps).phase == "following"


@pytest.mark.parametrize("ok", [True, False])
def test_a_checked_route_is_driven_on_or_another_one_planned(ok: bool) -> None:
    robot = Standing()
    robot.planned(VALUES)
    robot.shared.route.check()
    robot.mode.enter(snapshot(robot.time))
    wish = robot.planned((*VALUES,), ok=ok)
    assert (wish.event, robot.shared.route.replans, robot.shared.route.checking) == (Event.FOLLOW, 0, False)
    robot.shared.route.check()
    robot.mode.enter(snapshot(robot.time))
    assert robot.planned((), ok=False).event is None
    (job,) = robot.tick().jobs
    assert job.values == (), "from nothing"
    wish = robot.tick(JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=False, detail="a zone"))
    assert (wish.outcome, wish.phase) == (NO_PATH, "no route to gate: a zone")


def test_steps_that_follow_a_given_path_wait() -> None:
    steps = shared(FollowStep(route="shown", follower=StubFollower()))
    wish = blocked(steps, REPLAN_AFTER)
    assert (fault_of(wish)[0], wish.event) == ("LAS-08", None)


def test_what_was_tried_and_the_given_goal_are_in_the_position_also_of_a_step_that_is_interrupted() -> None:
    robot = Standing(step(asks="stick"))
    goal = OperatorInput(source="stick", age=0.0, goal=Pose(x=0.1, y=1 / 3, heading=-2.0))
    take_goal(robot.shared, snapshot(0.0, inputs=(goal,)))
    robot.planned(VALUES)
    robot.shared.route.replan(3, 0.5, 2.5)
    robot.tick()
    resumed = Shared(replace(robot.shared.plan, begin=robot.shared.position))
    assert (resumed.route.goal, resumed.route.replans) == (goal.goal, 1)
    assert (resumed.route.planned, resumed.route.state) == ((), robot.shared.route.state)
    assert len(robot.shared.position.state) < 80


def test_where_ground_was_not_seen_another_route_is_planned_once_and_nothing_waited_for() -> None:
    steps = shared(step(replans=3, obstacles=ObstacleRules(mode="stop", blocked_after=30.0)))
    steps.route.planned = VALUES

    rolling = blocked(steps, 0.1, standing=False, unseen=True)
    assert rolling.fault is not None
    assert "the ground ahead was not seen" in rolling.fault.text
    asked = blocked(steps, 0.1, unseen=True)
    assert (asked.event, asked.outcome, steps.route.replanning) == (Event.DONE, "", True)
    assert steps.route.present == (NOT_KEPT, *VALUES), "it leads over unseen ground, however free it is"
    ended = blocked(steps, 0.1, unseen=True)
    assert (fault_of(ended)[0], ended.outcome) == ("LAS-08", BLOCKED), "also where it never moved, somebody is told why"


def test_where_the_robot_waited_for_an_obstacle_unseen_ground_has_another_route_planned_all_the_same() -> None:
    steps = shared(step(replans=3, obstacles=ObstacleRules(mode="stop", blocked_after=30.0)))
    steps.route.planned = VALUES

    assert blocked(steps, REPLAN_AFTER).event is Event.DONE
    assert steps.route.present == VALUES
    asked = blocked(steps, 0.1, unseen=True)
    assert (asked.event, asked.outcome, steps.route.present[:1]) == (Event.DONE, "", (NOT_KEPT,))
    assert blocked(steps, 0.1, unseen=True).outcome == BLOCKED


def test_a_new_route_is_begun_and_the_same_one_gone_on_with() -> None:
    follower = StubFollower()
    steps = shared(replace(step(), follower=follower))
    mode = FollowMode(steps)
    for values, starts in ((VALUES, 1), (VALUES, 1), (OTHER, 2)):
        steps.route.planned = values
        mode.enter(snapshot(0.0))
        mode.step(snapshot(0.0))
        assert follower.starts == starts


def test_a_planner_that_died_is_a_fault_and_never_an_outcome() -> None:
    for replanning in (False, True):
        robot = Standing()
        if replanning:
            robot.planned(VALUES)
            robot.shared.route.replan(3, 0.5, 2.5)
            robot.mode.enter(snapshot(robot.time))
        (job,) = robot.tick().jobs
        died = JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=False, fault="PTH-10", detail="twice")
        for wish in (robot.tick(died), robot.tick()):
            assert fault_of(wish)[0] == "PTH-10"
            assert (wish.outcome, wish.event, wish.over, wish.jobs) == ("", None, False, ())
        robot.mode.enter(snapshot(robot.time))  # acknowledged
        assert len(robot.tick().jobs) == 1
