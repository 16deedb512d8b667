"""How a step that follows what was recorded in the run gets its path: a job fits it while the robot stands."""

from __future__ import annotations

from msgspec.structs import replace

from artemis.motion.planned_route import FITTER, packed_poses
from artemis.motion.track import Track
from artemis.states.plan import FollowStep, Shared
from artemis.supervision import catalogue
from artemis.values import Event, Fault, Job, JobKind, Severity, Snapshot, Wish


class TrackFitting:
    """Orders one path each time that the step begins; a step that was interrupted continues along it."""

    def __init__(self, shared: Shared) -> None:
        self._shared, self._entry = shared, -1
        self.begin()

    def begin(self) -> None:
        """The robot stands: what is under way is of no use, and what went wrong may be tried again."""
        self._job: Job | None = None
        self._fault: Fault | None = None

    def step(self, step: FollowStep, stand: Wish, snapshot: Snapshot) -> Wish:
        """Order a path, wait for it, and drive."""
        shared = self._shared
        if shared.entry != self._entry:
            self._entry = shared.entry
            self.begin()
        if shared.route.planned:
            return replace(stand, event=Event.FOLLOW)
        assert isinstance(step.route, str)
        stand = replace(stand, phase=f"fitting a path to {step.route}", fault=self._fault)
        if self._fault is not None:
            return stand
        if self._job is None:
            track = shared.results.tracks.get(step.route, Track())
            (job,) = shared.bring_up.jobs(JobKind.FIT, [FITTER], [shared.position.step])
            self._job = replace(job, values=packed_poses(track.poses))
            return replace(stand, jobs=(self._job,))
        result = next((each for each in snapshot.sensed.results if each.id == self._job.id), None)
        if result is None:
            return stand
        if not result.ok:
            self._fault = catalogue.fault(result.fault, "", result.detail, Severity.CONTROLLED_STOP)
            return replace(stand, fault=self._fault)
        shared.route.drive(result.values)
        return replace(stand, event=Event.FOLLOW)
