"""How a `goto` gets its goal, if it asks for it, and its route: a job plans it while the robot stands in mode ready."""

from __future__ import annotations

from math import degrees

from msgspec.structs import replace

from artemis.motion.planned_route import PLANNER, packed_poses
from artemis.progress import NO_PATH, MissionEvent
from artemis.states.follow import place_fault
from artemis.states.mode import PATIENCE, give_up
from artemis.states.plan import GotoStep, Shared
from artemis.supervision import catalogue
from artemis.values import Event, Fault, Job, JobKind, JobResult, Pose, Snapshot, Wish


def take_goal(shared: Shared, snapshot: Snapshot) -> tuple[MissionEvent, ...]:
    """Take the goal that the present step asks for, if it is another one; a route that leads elsewhere is forgotten."""
    step, route = shared.current, shared.route
    if not isinstance(step, GotoStep) or not step.asks:
        return ()
    goals = [sample.goal for sample in snapshot.sensed.inputs if sample.source == step.asks and sample.goal is not None]
    if not goals or goals[0] == route.goal:
        return ()
    route.take(goals[0])
    return (MissionEvent(kind="goal", place="", text=f"{place_words(goals[0])} (by {step.asks})"),)


def place_words(pose: Pose) -> str:
    """A pose on the map, for people."""
    return f"x {pose.x:.2f} m, y {pose.y:.2f} m, {degrees(pose.heading):.0f} degrees"


class RoutePlanning:
    """Orders one route after the other, each from where the robot stands then; one that is free again is kept."""

    def __init__(self, shared: Shared) -> None:
        self._shared, self._entry = shared, -1
        self._job: Job | None = None
        self._fault: Fault | None = None
        self._goal: Pose | None = None
        self._refused = ""
        self._waited = 0.0

    def begin(self) -> None:
        """The robot stands, perhaps elsewhere: what is under way is of no use."""
        self._job, self._fault, self._refused, self._waited = None, None, "", 0.0

    def step(self, step: GotoStep, stand: Wish, snapshot: Snapshot) -> Wish:
        """Order a route, wait for it, and drive; without one the step ends, unless another route or goal is known."""
        shared, route = self._shared, self._shared.route
        if shared.entry != self._entry:
            self._entry = shared.entry
            self.begin()
        goal = route.goal
        place = step.place if goal is None else place_words(goal)
        stand = replace(stand, phase=f"planning a route to {place}")
        if fault := self._fault or place_fault(snapshot, localized=shared.plan.localized):
            return replace(stand, fault=fault)
        if step.asks and goal is None:
            return self._wait(step, stand, snapshot)
        if goal != self._goal:
            self._goal, self._job = goal, None
        if self._job is None:
            (job,) = shared.bring_up.jobs(JobKind.PLAN, [PLANNER], [shared.position.step])
            present = route.present
            self._job = replace(job, values=present if goal is None else (*packed_poses([goal]), *present))
            return replace(stand, jobs=(self._job,))
        result = next((each for each in snapshot.sensed.results if each.id == self._job.id), None)
        return stand if result is None else self._take(result, step, stand, snapshot)

    def _take(self, result: JobResult, step: GotoStep, stand: Wish, snapshot: Snapshot) -> Wish:
        """What follows from a plan: the drive, the end of the step, or the wait for another goal."""
        route, goal = self._shared.route, self._goal
        if result.fault:
            self._fault = catalogue.fault(result.fault, "", result.detail)
            return replace(stand, fault=self._fault)
        self._job, again, route.replanning = None, route.replanning, False
        checked, route.checking = route.checking, False
        if result.ok and not result.values:
            return replace(stand, over=True)
        if (again or checked) and result.values == route.planned:
            route.replans -= again and result.ok  # it is free again; else there is no other one
            return replace(stand, event=Event.FOLLOW)
        if checked:  # a new zone is in its way: another one is planned in the next tick
            route.drive(())
            return stand
        if result.ok:
            route.drive(result.values)
            return replace(stand, event=Event.FOLLOW, done=0.0)
        if goal is None:
            return replace(stand, outcome=NO_PATH, phase=f"no route to {step.place}: {result.detail}")
        route.goal = None
        route.drive(())
        self._refused, self._waited = f"no route to {place_words(goal)}: {result.detail}; ", 0.0
        return self._wait(step, stand, snapshot)

    def _wait(self, step: GotoStep, stand: Wish, snapshot: Snapshot) -> Wish:
        """Stand until the input gives a goal."""
        self._goal, self._job = None, None
        self._waited += snapshot.dt
        stand = replace(stand, phase=f"{self._refused}waiting for {step.place}")
        return give_up(stand, late=True) if self._waited > PATIENCE else stand
