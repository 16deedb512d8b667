"""Where the outline of a robot is free on a floor; near the start of a route less room is kept, if there is less."""

from __future__ import annotations

from artemis.motion.arrays import Array
from artemis.route_planning.floor import CELL, SPARE, Cells, Field, clearance, covered, outline_box
from artemis.route_planning.search import FINEST, FIRST, are_free
from artemis.vehicle import RobotFile

FIRST_MARGIN = 0.01
"""Around the outline in the first metre, if something is nearer at the start [m]; what the map shows under it then does
not count."""


class FreeGround:
    """Cells of a floor that are not free, seen by a robot that is to begin at some place of it.

    Attributes:
        clear: Distance from each cell to the nearest that is not free [m].
        begun: The same for the first metre.
        first_box: The outline with the margin that a search keeps there [m], as of `outline_box`.
        first_checked: The same with the one that a fitted route keeps there.
    """

    def __init__(
        self, shown: Cells, occupied: Cells, clear: Field, robot: RobotFile, margin: float, start: Array
    ) -> None:
        """Look at the start.

        Args:
            shown: what the map and its zones show.
            occupied: this, and what scanners see.
            clear: as of `clearance`, of what is occupied.
            robot: has an outline.
            margin: around it [m].
            start: x, y, heading on the floor [m, rad].
        """
        self.clear = self.begun = clear
        self.box, self._checked = outline_box(robot, margin + SPARE), outline_box(robot, margin + FINEST)
        self.first_box, self.first_checked = self.box, self._checked
        if covered(occupied, start, self.box).any():
            self.first_box = self.first_checked = outline_box(robot, FIRST_MARGIN)
            under = covered(shown, start, self.first_box)
            under |= covered(occupied, start, outline_box(robot, 0.0), reach=0.0)
            self.begun = clearance(occupied & ~under)

    def fits(self, pose: Array) -> bool:
        """Whether the outline of a robot that stands at a pose of the floor is free."""
        return bool(are_free(pose.reshape(1, 3), self.clear, CELL, self._checked)[0])

    def fits_first(self, pose: Array) -> bool:
        """The same within the first metre."""
        return bool(are_free(pose.reshape(1, 3), self.begun, CELL, self.first_checked)[0])

    def are_free(self, poses: Array, driven: Array) -> Cells:
        """Whether the outline is free at poses of the floor, each after so far a drive [m]."""
        first = driven < FIRST + CELL
        free = are_free(poses, self.clear, CELL, self._checked)
        free[first] = are_free(poses[first], self.begun, CELL, self.first_checked)
        return free
