"""How a step that follows what was recorded gets its path: fitted by a job, once, while the robot stands."""

from __future__ import annotations

import asyncio
import math

import numpy as np
import pytest
from core_builders import PERIOD, ROBOT, StubFollower, fault_of, shared, snapshot
from msgspec.structs import replace

from artemis.clock import SimulatedLoop
from artemis.devices.track_fitter import TrackFitter, TrackUse
from artemis.motion.planned_route import FITTER, packed_poses, unpacked_route
from artemis.motion.rounding import CURVATURE_SHARE
from artemis.motion.track import Track
from artemis.states.follow import FollowMode
from artemis.states.plan import FollowStep
from artemis.states.ready import ReadyMode
from artemis.states.route_progress import RouteProgress
from artemis.values import Event, Job, JobKind, JobResult, Pose, Severity, Wish

DRIVEN = [Pose(x=0.05 * number) for number in range(41)]
USE = TrackUse(speed=0.3, close_within=0.0, round_corners=0.0, allow_slowdown=False, reserve=False)


def done(job: Job, use: TrackUse = USE) -> JobResult:
    """What the fitter makes of a job."""
    fitter = TrackFitter(ROBOT, {0: use}, virtual=True)
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        return runner.run(fitter.perform(job))


class Standing:
    """Mode ready of a robot that has recorded a path."""

    def __init__(self, poses: list[Pose] = DRIVEN) -> None:
        self.follower = StubFollower()
        self.shared = shared(FollowStep(route="shown", follower=self.follower, speed=0.3))
        self.shared.results.tracks["shown"] = Track(poses=list(poses))
        self.mode, self.time = ReadyMode(self.shared), 0.0
        self.mode.enter(snapshot(0.0))

    def tick(self, *results: JobResult) -> Wish:
        self.time += PERIOD
        return self.mode.step(snapshot(self.time, results=results))


def test_a_path_is_ordered_once_and_followed_when_it_is_there() -> None:
    robot = Standing()
    (job,) = robot.tick().jobs
    assert (job.kind, job.drive, job.value, job.values) == (JobKind.FIT, FITTER, 0.0, packed_poses(DRIVEN))
    assert robot.tick().jobs == ()
    result = done(job)
    assert robot.tick(result).event is Event.FOLLOW
    assert unpacked_route(robot.shared.route.planned).length == pytest.approx(2.0, abs=1e-3)

    follow = FollowMode(robot.shared)
    follow.enter(snapshot(robot.time))
    assert follow.step(snapshot(robot.time)).fault is None
    assert robot.follower.starts == 1


def test_a_step_that_was_interrupted_goes_on_without_another_path() -> None:
    robot = Standing()
    (job,) = robot.tick().jobs
    robot.tick(done(job))
    robot.mode.enter(snapshot(robot.time))
    wish = robot.tick()
    assert (wish.jobs, wish.event) == ((), Event.FOLLOW)


def test_a_step_that_begins_anew_has_another_path_made() -> None:
    robot = Standing()
    (job,) = robot.tick().jobs
    robot.tick(done(job))
    robot.shared.entry, robot.shared.route = robot.shared.entry + 1, RouteProgress("")
    assert len(robot.tick().jobs) == 1
    assert robot.shared.route.planned == ()


def test_an_interruption_while_it_is_fitted_orders_it_again() -> None:
    robot = Standing()
    (old,) = robot.tick().jobs
    robot.mode.enter(snapshot(robot.time))
    (new,) = robot.tick(done(old)).jobs
    assert new.id != old.id
    assert robot.tick(replace(done(old), id=new.id)).event is Event.FOLLOW


def test_what_cannot_be_followed_stops_the_robot_and_says_why() -> None:
    robot = Standing(DRIVEN[:3])
    (job,) = robot.tick().jobs
    for wish in (robot.tick(done(job)), robot.tick()):
        assert fault_of(wish)[0] == "PTH-01"
        assert wish.fault is not None
        assert wish.fault.severity is Severity.CONTROLLED_STOP
        assert "at least 0.3 m are needed" in wish.fault.text
        assert wish.event is None
    robot.mode.enter(snapshot(robot.time))  # acknowledged
    assert len(robot.tick().jobs) == 1


def test_a_process_that_ended_is_a_fault_of_its_own() -> None:
    robot = Standing()
    (job,) = robot.tick().jobs
    wish = robot.tick(JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=False, fault="PTH-10"))
    assert fault_of(wish)[0] == "PTH-10"


def test_a_path_driven_at_full_lock_is_rounded_by_the_job_where_its_follower_wants_that() -> None:
    most = math.tan(math.radians(ROBOT.limits.steering_deg)) / ROBOT.geometry.wheelbase_m
    radius = 1 / (0.95 * most)
    turn = [(radius * math.sin(0.05 * n), radius * (1 - math.cos(0.05 * n)), 0.05 * n) for n in range(63)]
    lead = [(0.05 * n - 2.0, 0.0, 0.0) for n in range(40)]
    back = [(x, 2 * radius, math.pi) for x, _, _ in lead[::-1]]
    driven = [Pose(x=x, y=y, heading=heading) for x, y, heading in [*lead, *turn, *back]]
    job = Job(id=1, kind=JobKind.FIT, drive=FITTER, value=0.0, values=packed_poses(driven))
    for reserve in (False, True):
        result = done(job, replace(USE, allow_slowdown=True, reserve=reserve))
        assert result.ok, result.detail
        (part,) = unpacked_route(result.values).parts
        assert bool(np.abs(part.path.curvature).max() <= CURVATURE_SHARE * most + 1e-6) is reserve
