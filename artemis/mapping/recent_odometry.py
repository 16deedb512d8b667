"""The odometry of the last ticks, at the times at which the drives measured it: where the robot was during a scan."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from operator import itemgetter

from artemis.mapping.sighting import Sighting
from artemis.motion.perception import moment, stale_age
from artemis.motion.poses import placed, seen_from
from artemis.scan import Scan
from artemis.values import Pose, Tick
from artemis.vehicle import RobotFile

KEPT = 150
"""Ticks whose odometry is kept: a scan comes later than it was measured, by less."""


class RecentOdometry:
    """Poses by the odometry, in a frame that never jumps."""

    def __init__(self, robot: RobotFile) -> None:
        """Take the robot: its driven wheels are what counts."""
        self._places, self._stale = itemgetter(*robot.places), stale_age(0.0)
        self._kept: deque[tuple[float, Pose]] = deque(maxlen=KEPT)
        self._origin, self._resets = Pose(), False
        self._gaps = 0

    def see(self, tick: Tick) -> None:
        """Take in the odometry of a tick. Where that is set to another pose, the robot stands."""
        snapshot = tick.snapshot
        left, right, *_ = self._places(snapshot.sensed.drives)
        time, pose = moment(snapshot.time, left, right, self._stale), snapshot.odometry.pose
        if self._resets and self._kept:
            self._origin = placed(self._kept[-1][1], seen_from(pose, Pose()))
        self._resets = tick.wish.reset_pose
        self._gaps += snapshot.odometry.uncounted
        if not self._kept or time > self._kept[-1][0]:
            self._kept.append((time, placed(self._origin, pose)))

    def sighting(self, scan: Scan) -> Sighting | None:
        """The scan with the robot's poses during it; None: the odometry does not reach to its end yet."""
        lasting = scan.beam_time * max(0, len(scan.millimetres) - 1)
        if not self._kept or self._kept[-1][0] < scan.time + lasting:
            return None
        begin, middle, end = (self._at(scan.time + share * lasting) for share in (0.0, 0.5, 1.0))
        return Sighting(scan=scan, time=scan.time + lasting / 2, begin=begin, middle=middle, end=end, gaps=self._gaps)

    def _at(self, time: float) -> Pose:
        """Between two ticks; the first one kept, where it was before."""
        after = bisect_right(self._kept, time, key=lambda kept: kept[0])
        if after in (0, len(self._kept)):
            return self._kept[after - 1 if after else 0][1]
        (then, pose), (later, next_pose) = self._kept[after - 1], self._kept[after]
        share, step = (time - then) / (later - then), seen_from(pose, next_pose)
        return placed(pose, Pose(x=share * step.x, y=share * step.y, heading=share * step.heading))
