"""How a `goto` gets its route: a job plans it while the robot stands in mode ready."""

from __future__ import annotations

from msgspec.structs import replace

from artemis.motion.planned_route import PLANNER
from artemis.progress import NO_PATH
from artemis.states.follow import place_fault
from artemis.states.plan import GotoStep, Shared
from artemis.values import Event, Job, JobKind, Snapshot, Wish


class RoutePlanning:
    """Orders one route after the other, each from where the robot stands then; one that is free again is kept."""

    def __init__(self, shared: Shared) -> None:
        self._shared, self._entry = shared, -1
        self._job: Job | None = None

    def begin(self) -> None:
        """The robot stands, perhaps elsewhere: what is under way is of no use."""
        self._job = None

    def step(self, step: GotoStep, stand: Wish, snapshot: Snapshot) -> Wish:
        """Order a route, wait for it, and drive; without one the step ends, unless another route is known."""
        shared = self._shared
        if shared.entry != self._entry:
            self._entry, self._job = shared.entry, None
            shared.planned, shared.replans, shared.replanning, shared.stood = (), 0, False, (0.0, 0.0)
        stand = replace(stand, phase=f"planning a route to {step.place}")
        if fault := place_fault(snapshot, localized=shared.plan.localized):
            return replace(stand, fault=fault)
        if self._job is None:
            (job,) = shared.bring_up.jobs(JobKind.PLAN, [PLANNER], [shared.position.step])
            self._job = replace(job, values=shared.planned) if shared.replanning else job
            return replace(stand, jobs=(self._job,))
        result = next((each for each in snapshot.sensed.results if each.id == self._job.id), None)
        if result is None:
            return stand
        self._job, again, shared.replanning = None, shared.replanning, False
        if result.ok and not result.values:
            return replace(stand, over=True)
        if again and result.values == shared.planned:  # it is free again
            shared.replans -= 1
            return replace(stand, event=Event.FOLLOW)
        if result.ok:
            shared.planned, shared.stood = result.values, (0.0, 0.0)
            return replace(stand, event=Event.FOLLOW, done=0.0)
        return replace(stand, event=Event.FOLLOW) if again else replace(stand, outcome=NO_PATH)
