"""What a scanner saw some seconds ago and should still see, however the robot has moved since: by its odometry.

A cover that slides over the window hides a little more in each scan, so one scan says nothing against the one before.
Key scans are kept for some seconds. What stood still in one has to be there: its place is where the odometry says, and
the beams there have to return something, the thing itself or what has come in front of it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import cos, degrees, radians, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from artemis.motion.angles import difference
from artemis.mounting import Mounting
from artemis.values import Pose

SECTOR = 2.0
"""Beams are looked at in sectors of this width [degrees], of which one return is enough."""
EVERY, KEPT = 1.0, 4
"""A key scan is taken so often [s], and so many are kept."""
STANDS = 0.3
"""What was as far away in the key scan before, but for this [m], stands still; so near each other points are joined."""
FURTHER, ALWAYS = 0.1, 8.0
"""A thing that has come no further away than this [m], or is nearer than the second, returns as it did: even one that
reflects 2 % is seen from 8 m (SICK, operating instructions LMS1xx, 8012471)."""
APPROACH = 0.15
"""What was seen this little beyond the least range may have come too near to be seen [m]."""
JUMP, TURN = 0.3, radians(20.0)
"""The odometry was set anew where it moves further than this [m, rad] from scan to scan."""
_NOTHING = np.zeros(0, np.bool_)

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Sectors = NDArray[np.intp]


class MissingReturns(NamedTuple):
    """What does not return any more."""

    degrees: float
    """Of the view."""
    share: float
    """Of what should return; 0 where that is less than a fifth of the view."""


class _Key(NamedTuple):
    time: float
    pose: Pose
    x: Floats
    """In the frame of the odometry, of every other return [m]."""
    y: Floats
    ranges: Floats
    """Its distance then [m]."""
    stands: Flags
    joined: Flags
    """With the next one: both are of one surface."""


class ExpectedReturns:
    """Of one scanner."""

    def __init__(self, mounting: Mounting) -> None:
        self._mounting, self._least = mounting, mounting.least_range_m
        self._nearest = self._least + APPROACH
        self._keys: deque[_Key] = deque(maxlen=KEPT)
        self._pose: Pose | None = None
        self.fit(0, 0.0, 1.0, _NOTHING)

    def fit(self, beams: int, start: float, increment: float, unmasked: Flags) -> None:
        """Begin with scans of other beams: from `start` on, each `increment` further [rad]; some may be masked."""
        self.forget()
        self._width = max(1, round(radians(SECTOR) / abs(increment)))
        self._sectors = beams // self._width
        self._unmasked = unmasked
        whole = self._sectors * self._width
        self._watched = unmasked[:whole].reshape(-1, self._width).all(axis=1)
        self._near = np.zeros(self._sectors, np.bool_)
        self._degrees = degrees(abs(increment)) * self._width
        self._heading = self._mounting.heading + start + increment * (beams - 1) / 2.0
        self._side = 1.0 if increment > 0.0 else -1.0
        angles = [start + increment * beam + self._mounting.heading for beam in range(beams)]
        self._cos, self._sin = np.array([cos(each) for each in angles]), np.array([sin(each) for each in angles])
        edges = [abs(increment) * (self._width * sector - beams / 2.0) for sector in range(self._sectors + 1)]
        self._edges = _bearing(np.array([cos(each) for each in edges]), np.array([sin(each) for each in edges]))

    def forget(self) -> None:
        """As if nothing had been seen."""
        self._keys.clear()

    def move(self, pose: Pose, *, uncounted: bool, frozen: bool) -> None:
        """Where the robot is by its odometry.

        Where that was set anew, or the wheels may have rolled uncounted, nothing is known of the motion; what is
        `frozen`, because it does not return, is looked for as if the robot had not moved.
        """
        before, self._pose = self._pose, pose
        if before is None:
            return
        moved = abs(pose.x - before.x) + abs(pose.y - before.y)
        if uncounted or moved > JUMP or abs(difference(pose.heading, before.heading)) > TURN:
            if frozen:
                self._keys = deque([self._carried(key, before, pose) for key in self._keys], KEPT)
            else:
                self.forget()

    def take(self, metres: Floats) -> None:
        """One more scan: remember where the last return came from just beyond the least range."""
        nearest = self._by_sector(np.where(metres >= self._least, metres, np.inf)).min(axis=1, initial=np.inf)
        self._near = np.where(nearest < np.inf, nearest <= self._nearest, self._near)

    def keep(self, metres: Floats, now: float) -> None:
        """Make a scan a key scan if it is time for one, run time `now` [s]."""
        pose = self._pose
        if pose is None or (self._keys and now - self._keys[-1].time < EVERY):
            return
        if self._keys and now - self._keys[-1].time > KEPT * EVERY:
            self.forget()
        beams = ((metres >= self._least) & self._unmasked).nonzero()[0][::2]
        ranges = metres[beams]
        at_x, at_y = self._place(pose)
        c, s = cos(pose.heading), sin(pose.heading)
        along, aside = self._cos[beams], self._sin[beams]
        x, y = at_x + ranges * (c * along - s * aside), at_y + ranges * (s * along + c * aside)
        joined = np.append(np.abs(np.diff(x)) + np.abs(np.diff(y)) < STANDS, [False] * bool(len(x)))
        stands = self._standing(ranges, beams // self._width, pose)
        self._keys.append(_Key(now, pose, x, y, ranges, stands, joined))

    def lost(self, metres: Floats) -> MissingReturns:
        """What stood still in the key scans and does not return any more."""
        pose = self._pose
        if pose is None or not any([key.stands.any() for key in self._keys]):
            return MissingReturns(0.0, 0.0)
        expected = np.zeros(self._sectors, np.bool_)
        near: list[tuple[_Key, Flags, Sectors]] = []
        for key in self._keys:
            distances, sectors = self._seen(key, pose)
            within = sectors >= 0
            due = key.stands & within & (distances <= np.maximum(key.ranges + FURTHER, ALWAYS))
            expected[sectors[due & (distances > self._nearest)]] = True
            near.append((key, within & (distances <= self._nearest), sectors))
        expected &= self._watched
        gone = expected & ~self._by_sector(metres >= self._least).any(axis=1) & ~self._near
        if gone.any():
            gone &= ~self._too_near(near)
        number, all = int(np.count_nonzero(gone)), int(np.count_nonzero(expected))
        enough = 5 * all >= int(np.count_nonzero(self._watched))
        return MissingReturns(number * self._degrees, number / all if all and enough else 0.0)

    def _too_near(self, near: Sequence[tuple[_Key, Flags, Sectors]]) -> Flags:
        """Sectors in which something that was seen is now nearer than it could be seen.

        Args:
            near: key scans, which of their points are so near, and in which sectors all of them are.
        """
        edges = np.zeros(self._sectors + 1, np.int64)
        for key, points, sectors in near:
            pairs = (points[:-1] & points[1:] & key.joined[:-1]).nonzero()[0]
            single = sectors[points]
            first = np.concatenate((single, np.minimum(sectors[pairs], sectors[pairs + 1])))
            last = np.concatenate((single, np.maximum(sectors[pairs], sectors[pairs + 1])))
            np.add.at(edges, first, 1)
            np.add.at(edges, last + 1, -1)
        hidden = np.cumsum(edges[:-1]) > 0
        wider = hidden.copy()
        wider[1:] |= hidden[:-1]
        wider[:-1] |= hidden[1:]
        return wider

    def _standing(self, ranges: Floats, sectors: Sectors, pose: Pose) -> Flags:
        """Which returns were where they are now in the key scan before, too."""
        if not self._keys:
            return np.zeros(len(ranges), np.bool_)
        key = self._keys[-1]
        distances, seen = self._seen(key, pose)
        least, most = np.full(self._sectors + 1, np.inf), np.full(self._sectors + 1, -np.inf)
        np.minimum.at(least, seen, distances)  # the last element is of no sector
        np.maximum.at(most, seen, distances)
        least[-1], most[-1] = np.inf, -np.inf
        sectors = np.minimum(sectors, self._sectors)
        return np.asarray((ranges >= least[sectors] - STANDS) & (ranges <= most[sectors] + STANDS))

    def _seen(self, key: _Key, pose: Pose) -> tuple[Floats, Sectors]:
        """Distances [m] and sectors in which the points of a key scan are seen from here; -1: in none."""
        at_x, at_y = self._place(pose)
        dx, dy = key.x - at_x, key.y - at_y
        heading = pose.heading + self._heading
        c, s = cos(heading), sin(heading)
        ahead, aside = c * dx + s * dy, self._side * (c * dy - s * dx)
        sectors = np.searchsorted(self._edges, _bearing(ahead, aside), side="right") - 1
        return np.sqrt(dx * dx + dy * dy), np.where(sectors < self._sectors, sectors, -1)

    def _place(self, pose: Pose) -> tuple[float, float]:
        """Of the scanner, in the frame of the odometry [m]."""
        c, s, there = cos(pose.heading), sin(pose.heading), self._mounting
        return pose.x + c * there.x_m - s * there.y_m, pose.y + s * there.x_m + c * there.y_m

    def _carried(self, key: _Key, before: Pose, pose: Pose) -> _Key:
        """A key scan, moved with the robot."""
        turn = pose.heading - before.heading
        c, s = cos(turn), sin(turn)
        dx, dy = key.x - before.x, key.y - before.y
        return key._replace(x=pose.x + c * dx - s * dy, y=pose.y + s * dx + c * dy)

    def _by_sector(self, beams: NDArray[np.generic]) -> NDArray[np.generic]:
        return beams[: self._sectors * self._width].reshape(-1, self._width)


def _bearing(ahead: Floats, aside: Floats) -> Floats:
    """Grows with the angle from x from -2 to 2, in steps that every computer rounds alike: no angle is needed."""
    length = np.abs(ahead) + np.abs(aside)
    part = aside / np.where(length > 0.0, length, 1.0)
    return np.where(ahead >= 0.0, part, np.where(aside >= 0.0, 2.0 - part, -2.0 - part))
