"""Routes of the present step that jobs make, of a `goto` or of what was recorded: what modes ready and follow share."""

from __future__ import annotations

from msgspec import json

from artemis.motion.planned_route import NOT_KEPT, ONLY_CHECKED
from artemis.values import Pose

SAME_PLACE = 0.1
"""On a route: nearer than this the robot stands where it stood [m]."""


class RouteProgress:
    """Of the present step.

    Attributes:
        planned: The newest route (`motion.planned_route.packed_route`); empty: it has to be made.
        goal: What the step was given, if it asks for one.
        replans: How often another route was planned for an obstacle.
        replanning: Another one is to be planned, now that the robot stands.
        checking: The present one is to be checked for new zones, now that the robot may drive on.
        stood: For how long the robot has stood for an obstacle since it last drove, or looked for another route [s].
        unseen: It was to be planned last because ground was not seen: then the present one is of no use, free or not.
    """

    def __init__(self, state: str) -> None:
        """The step begins, or is resumed with what its `state` was; the route is planned anew."""
        numbers = json.decode(state, type=tuple[float, ...]) if state else (0.0,)
        self.replans = int(numbers[0])
        self.goal = Pose(x=numbers[1], y=numbers[2], heading=numbers[3]) if len(numbers) > 1 else None
        self.replanning, self.checking, self.unseen = False, False, False
        self.stood = 0.0
        self.planned: tuple[int, ...] = ()
        self._stood = 0.0, 0.0
        """Where on the route the robot stood when it looked for another one last [m], and for how long in all [s]."""

    @property
    def state(self) -> str:
        """What counts in another run, too (JSON); empty: nothing."""
        goal = () if self.goal is None else (self.goal.x, self.goal.y, self.goal.heading)
        return json.encode((self.replans, *goal)).decode() if self.replans or goal else ""

    def take(self, goal: Pose) -> None:
        """Another goal: a route that leads elsewhere is forgotten."""
        self.goal, self.replans, self.replanning, self.checking = goal, 0, False, False
        self.drive(())

    def drive(self, planned: tuple[int, ...]) -> None:
        """Another route is there; (): none is."""
        self.planned, self._stood = planned, (0.0, 0.0)

    def waited(self, done: float) -> float:
        """How long the robot has waited at `done` [m] before it looked for another route last [s]."""
        return self._stood[1] if abs(done - self._stood[0]) < SAME_PLACE else 0.0

    @property
    def present(self) -> tuple[int, ...]:
        """The present route, for a robot that has one; after `NOT_KEPT` or `ONLY_CHECKED` if that is so."""
        if self.checking:
            return (ONLY_CHECKED, *self.planned)
        if not self.replanning:
            return ()
        return (NOT_KEPT, *self.planned) if self.unseen else self.planned

    def check(self) -> None:
        """Have the present route checked before the robot drives on."""
        self.checking, self.stood = True, 0.0

    def replan(self, most: int, done: float, blocked: float, *, unseen: bool = False) -> bool:
        """Have another route planned for an obstacle, if that was done less than `most` times; whether it will be.

        The robot is at `done` [m] of the present one, and has stood there for `blocked` [s].
        """
        if not self.planned or self.replans >= most:
            return False
        self._stood, self.unseen = (done, self.waited(done) + blocked), unseen
        self.replans, self.replanning, self.stood = self.replans + 1, True, 0.0
        return True
