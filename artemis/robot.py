"""The main path: sense, judge, advance, step, limit, write, observe. Nothing else moves the robot."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from math import inf
from typing import Any

from msgspec.structs import replace

from artemis.clock import until
from artemis.devices.device import Actuators
from artemis.drive_states import Goal
from artemis.motion.limits import Gate
from artemis.motion.obstacles import ObstacleStop
from artemis.motion.pace import Pace
from artemis.motion.perception import Perception
from artemis.plugins.guard import PluginGuard
from artemis.progress import Answer, TypedAnswer
from artemis.states.modes import Modes
from artemis.states.plan import Plan, Shared
from artemis.supervision import catalogue
from artemis.supervision.supervisor import Supervisor
from artemis.supervision.supply import SAG
from artemis.values import Fault, Job, JobResult, Pose, Request, Sensed, SetPoints, Snapshot, Tick, Wish

LIMITED_SPEED = 0.3  # ceiling of the speed while a verdict says LIMIT [m/s]


class Core:
    """The decision core, a pure function: (its state, sensed) -> (its state, tick). Replay repeats it bit for bit."""

    def __init__(self, plan: Plan, period: float) -> None:
        """`period` of the scheduled ticks [s]."""
        self._shared = shared = Shared(plan)
        self.results, self._modes, self._pace = shared.results, Modes(shared), Pace()
        self._perception = Perception(plan.robot, period, plan.start or Pose(), localized=plan.localized)
        self._supervisor = Supervisor(plan.robot, period, plan.policies, plan.blind, plan.needs_scanners)
        self._gate, self._gentle = Gate(plan.robot, period=period), plan.robot.limits.acceleration_m_s2 / 2
        self._obstacles = ObstacleStop(plan.robot, plan.rules) if plan.robot.scanners else None
        self._wish, self._points = Wish(supervised=False), SetPoints()

    def decide(self, sensed: Sensed) -> Tick:
        """One tick, from what is sensed to what is to be done."""
        verdict = self._supervisor.judge(sensed, self._wish, self._modes.mode, self._points, self._modes.spare)
        seen = self._perception.perceive(sensed, verdict, self._points)
        why = self._modes.advance(seen, self._wish.event)
        mode, wish = self._modes.mode, self._modes.step(seen)
        if wish.reset_pose:
            self._perception.reset()
        self._wish, self._points, self._supervisor.odometry = wish, self._limit(wish, seen), seen.odometry
        at, told, points, failed = self._shared.position, self._modes.events, self._points, self._modes.failed
        return Tick(
            snapshot=seen, mode=mode, cause=why, position=at, events=told, wish=wish, failed=failed, set_points=points
        )

    def _limit(self, wish: Wish, snapshot: Snapshot) -> SetPoints:
        """The gate, from its last set-points on; wheels whose drives are off, or shall be, stay where they are."""
        verdict, sensed = snapshot.verdict, snapshot.sensed
        ceiling, stop = min(self._shared.top_speed, LIMITED_SPEED if verdict.limits else inf), verdict.stops
        last = self._perception.as_they_stand(sensed, self._points)
        free = self._obstacles and self._obstacles.look(wish, last, snapshot, self._shared.rules)
        if free:
            ceiling, stop = min(ceiling, free.speed), stop or abs(last.speed) > free.speed
        dt = self._pace.since_sent(snapshot)
        if verdict.faults and SAG in [fault.id for fault in verdict.faults]:
            ceiling = min(ceiling, abs(last.speed) + dt * self._gentle)
        points = self._gate.limit(wish.command, last, dt, ceiling, stop or wish.steering is Goal.DISABLED)
        points = self._perception.as_they_stand(sensed, points)
        return replace(points, clearance=free) if free else points


class Robot:
    """The decision core joined to devices and inputs: ticks on schedule, jobs beside the ticks."""

    def __init__(
        self,
        core: Core,
        devices: Actuators,
        guard: PluginGuard,
        period: float,
        observe: Callable[[Tick], None],
        attended: Callable[[float], tuple[bool, bool]] = lambda time: (False, False),
    ) -> None:
        """`observe` sees every tick; `attended`: at a run time [s], what `Sensed.attended` and `awaited` are."""
        self._core, self._devices, self._guard, self._period, self._observe = core, devices, guard, period, observe
        self._requests, self._answers = list[Request](), list[Answer]()
        self._results, self._faults = list[JobResult](), list[Fault]()
        self._index, self._start, self._late, self._sent = 0, 0.0, 0.0, 0.0
        self._ticking, self._attended = False, attended
        self._failure: BaseException | None = None

    def tick(self, now: float, urgent: bool = False) -> Tick:
        """One tick at loop time `now` [s]. An urgent one, off the schedule, writes stop frames only."""
        self._ticking = True
        tick = self._core.decide(self._sense(now, urgent))
        self._devices.write(tick)
        for job in tick.wish.jobs:
            self._tasks.create_task(self._perform(job))
        if not urgent:
            self._sent = asyncio.get_running_loop().time() - self._start
        self._guard.show(tick)
        self._observe(tick)
        self._ticking = False
        return tick

    async def run(self) -> None:
        """Tick on schedule until the ordered end. Should the program fail, the drives are stopped first."""
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(self._fail)
        self._start = deadline = loop.time()
        try:
            async with asyncio.TaskGroup() as self._tasks:
                works = self._devices.begin(self._start, self.tick_now, self._meet)
                beside = [self._tasks.create_task(work) for work in works]
                while not self.tick(loop.time()).wish.finished:
                    deadline += self._period
                    await until(deadline)
                    if self._failure is not None:
                        raise self._failure
                    self._late = loop.time() - deadline
                    deadline += self._late if self._late > self._period else 0.0  # ticks that were missed stay missed
                for task in beside:
                    task.cancel()
        except BaseException:
            self._devices.stop()
            raise

    def report(self, fault: Fault) -> None:
        """Something was noticed beside the ticks."""
        self._faults.append(fault)

    def request(self, request: Request | Answer) -> None:
        """What an operator asks for, or answers. A quick stop acts at once, not at the next tick."""
        kept: list[Any] = self._requests if isinstance(request, Request) else self._answers
        kept.append(request)
        if request is Request.QUICKSTOP:
            self.tick_now()

    def _sense(self, now: float, urgent: bool) -> Sensed:
        readings = self._devices.sense(now)
        inputs, fixes = self._guard.read(now - self._start), self._guard.fixes(now - self._start)
        self._faults += [catalogue.fault(*problem) for problem in self._guard.take_problems()]
        self._requests += [request for sample in inputs for request in sample.requests]
        self._index, (attended, awaited) = self._index + 1, self._attended(now - self._start)
        sensed = Sensed(
            index=self._index - 1,
            time=now - self._start,
            late=0.0 if urgent else self._late,
            sent=self._sent,
            attended=attended,
            awaited=awaited,
            drives=readings.drives,
            bus=readings.bus,
            inputs=inputs,
            requests=tuple(self._requests),
            results=tuple(self._results),
            faults=tuple(self._faults),
            fixes=fixes,
            scans=readings.scans,
            battery_v=readings.battery_v,
        )
        if urgent or self._answers or any([sample.answers for sample in inputs]):  # more than 15 keywords are slow
            texts = [it for it in self._answers if isinstance(it, str)]
            typed = [it for it in self._answers if isinstance(it, TypedAnswer)]
            texts += [answer for sample in inputs for answer in sample.answers]
            sensed = replace(sensed, urgent=urgent, answers=tuple(texts), typed=tuple(typed))
        for taken in (self._requests, self._answers, self._results, self._faults):
            taken.clear()
        return sensed

    def _meet(self, id: str, device: str, seen: str) -> None:
        """Keep what a device reports for the next tick, each problem once."""
        if (fault := catalogue.fault(id, device, seen)) not in self._faults:
            self._faults.append(fault)

    async def _perform(self, job: Job) -> None:
        self._results.append(await self._devices.perform(job))

    def tick_now(self) -> None:
        """An extra tick, off the schedule: something urgent waits to be read."""
        if self._index and not self._ticking:
            self.tick(asyncio.get_running_loop().time(), urgent=True)

    def _fail(self, _loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """A callback beside the ticks failed: stop the drives now, and end the run with its error."""
        self._failure = context.get("exception") or RuntimeError(context["message"])
        self._devices.stop()
