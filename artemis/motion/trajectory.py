"""Where something was, over time: poses at the times at which they were known."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, inf, sin

import numpy as np

from artemis.errors import ConfigError
from artemis.motion.arrays import Array
from artemis.values import Pose


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Trajectory:
    """Poses of one point over time, in one frame."""

    time: Array
    """Of each pose [s], rising, shape (n,)."""
    poses: Array
    """x, y [m], heading [rad], unwrapped (any turns may be given); shape (n, 3). All headings are nan if none is known.
    """

    def __post_init__(self) -> None:
        """Check, and unwrap the heading.

        Raises:
            ConfigError: what is wrong, with the row, from 0.
        """
        time, poses = np.asarray(self.time, dtype=np.float64), np.array(self.poses, dtype=np.float64)
        if time.ndim != 1 or poses.shape != (len(time), 3):
            raise ConfigError(f"trajectory: times {time.shape} and poses {poses.shape}; expected (n,) and (n, 3)")
        if not len(time):
            raise ConfigError("trajectory: no poses; expected at least 1")
        known = np.isfinite(poses[:, 2]).any()
        finite = np.isfinite(np.column_stack([time, poses if known else poses[:, :2]])).all(axis=1)
        if not finite.all():
            row = int(np.argmin(finite))
            raise ConfigError(
                f"trajectory: row {row}: expected finite numbers, found {time[row]}, {poses[row].tolist()}"
            )
        if (falls := np.flatnonzero(np.diff(time) <= 0)).size:
            row = int(falls[0]) + 1
            raise ConfigError(
                f"trajectory: row {row}: time {time[row]} s follows {time[row - 1]} s; expected a later one"
            )
        poses[:, 2] = np.unwrap(poses[:, 2]) if known else np.nan
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "poses", poses)

    @property
    def knows_heading(self) -> bool:
        """Whether the heading is known."""
        return bool(np.isfinite(self.poses[0, 2]))

    def places(self) -> Trajectory:
        """The same with no heading known."""
        poses = self.poses.copy()
        poses[:, 2] = np.nan
        return Trajectory(time=self.time, poses=poses)

    def at(self, times: Array, longest_gap: float = inf) -> Array:
        """Poses at other times, linearly interpolated, the heading along the unwrapped one.

        Args:
            times: in any order [s], shape (m,).
            longest_gap: between two poses that are farther apart [s] nothing is known.

        Returns:
            x, y [m], heading [rad], shape (m, 3); nan before the first pose, after the last, and in gaps.
        """
        times = np.asarray(times, dtype=np.float64)
        after = np.searchsorted(self.time, times).clip(0, len(self.time) - 1)
        inside = (self.time[0] <= times) & (times <= self.time[-1])
        exact = self.time[after] == times
        gaps = np.diff(self.time, prepend=-inf)[after]
        poses = np.column_stack([np.interp(times, self.time, column) for column in self.poses.T])
        return np.where((inside & (exact | (gaps <= longest_gap)))[:, np.newaxis], poses, np.nan)

    def placed(self, origin: Pose) -> Trajectory:
        """The same motion in the frame in which its own frame's origin is at `origin`."""
        x, y, heading = self.poses.T
        c, s = cos(origin.heading), sin(origin.heading)
        poses = np.column_stack([origin.x + c * x - s * y, origin.y + s * x + c * y, heading + origin.heading])
        return Trajectory(time=self.time, poses=poses)

    def of_point(self, point: Pose) -> Trajectory:
        """The poses of another point of the same body, which is at `point` as seen from this one.

        Raises:
            ConfigError: it needs the heading, which is not known.
        """
        if not self.knows_heading:
            raise ConfigError("trajectory: the place of another point needs the heading, which is not known")
        x, y, heading = self.poses.T
        c, s = np.cos(heading), np.sin(heading)
        poses = np.column_stack([x + c * point.x - s * point.y, y + s * point.x + c * point.y, heading + point.heading])
        return Trajectory(time=self.time, poses=poses)
