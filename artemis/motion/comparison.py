"""How far a trajectory is from the true one: absolute errors after an alignment, relative errors over distances.

Absolute and relative errors as of Sturm et al., "A Benchmark for the Evaluation of RGB-D SLAM Systems" (IROS 2012), the
relative ones over lengths as of Geiger et al., "Are we ready for autonomous driving?" (CVPR 2012).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import atan2
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from artemis.errors import ConfigError
from artemis.motion.arrays import Array, wrapped
from artemis.motion.clocks import RUN, Clock, estimate_clock, longest_gap
from artemis.motion.poses import placed, seen_from
from artemis.motion.trajectory import Trajectory
from artemis.values import Pose

Alignment: TypeAlias = Literal["none", "start", "best"]
ALIGNMENTS: tuple[Alignment, ...] = get_args(Alignment)
LENGTHS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)
"""Distances [m] over which relative errors are taken, as far as the run goes."""
STARTS = 1000
"""Stretches of one length, at most; they begin evenly spread over the distance."""
LEAST_POSES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorStatistics:
    """Errors in a few numbers, in the unit of the errors."""

    mean: float
    median: float
    rms: float
    max: float
    end: float
    """The last one."""


def statistics(errors: Array) -> ErrorStatistics:
    """In a few numbers; `errors` are not negative, shape (n,)."""
    return ErrorStatistics(
        mean=float(np.mean(errors)),
        median=float(np.median(errors)),
        rms=float(np.sqrt(np.mean(errors**2))),
        max=float(np.max(errors)),
        end=float(errors[-1]),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Relative:
    """Errors of the motion over stretches of one length."""

    length: float
    """[m]."""
    translation: Array
    """Of each stretch, as a share of its distance, shape (k,)."""
    rotation: Array
    """Of each stretch [rad/m], not negative, shape (k,)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Comparison:
    """A run's poses at the times at which the true ones are known, both of one point of the robot, in one frame.

    Arrays have one row a true pose.
    """

    time: Array
    """By the run's clock [s], shape (n,)."""
    distance: Array
    """Of the point by the odometry, forward and back, since the first of these poses [m], shape (n,)."""
    estimated: Array
    """x, y [m], heading [rad], unwrapped, shape (n, 3), moved into the frame of the truth as `alignment` says."""
    true: Array
    """Likewise, as given; the headings are nan if they are not known."""
    sensor: Pose
    """The point, seen from the rear axle's centre, x ahead, y left."""
    alignment: Alignment
    origin: Pose
    """Of the odometry's frame in that of the truth, after the alignment."""
    clock: Clock
    relative: tuple[Relative, ...]
    """By length; empty if the truth knows no heading."""

    @property
    def error(self) -> Array:
        """Distance from the true place [m], shape (n,)."""
        return np.asarray(np.hypot(*(self.estimated - self.true)[:, :2].T))

    @property
    def heading_error(self) -> Array:
        """By how much the estimated heading is left of the true one [rad], in [-pi, pi], shape (n,)."""
        return wrapped(self.estimated[:, 2] - self.true[:, 2])


def compare(
    estimated: Trajectory,
    truth: Trajectory,
    *,
    alignment: Alignment,
    sensor: Pose,
    same_clock: bool,
) -> Comparison:
    """Compare the odometry with the truth, at the times of the latter.

    Args:
        estimated: the pose of the rear axle's centre by the odometry, frame `odom`, clock of the run.
        truth: the pose of the tracker, in its own frame.
        alignment: `none`, both frames are one; `start`, the first poses that both know are made equal; `best`, least
            squares of the places (Umeyama 1991 in the plane, without scale).
        sensor: the tracker's pose on the robot, seen from the rear axle's centre, x ahead, y left.
        same_clock: both have one clock; else its offset and drift are estimated from the motions.

    Raises:
        ConfigError: they have nothing in common, or the clocks cannot be told; what to try.
    """
    estimated = estimated.of_point(sensor)
    clock = RUN if same_clock else estimate_clock(estimated, truth)
    time = clock.run_time(truth.time)
    poses = estimated.at(time, longest_gap(estimated.time))
    both = np.isfinite(poses[:, 0])
    if both.sum() < LEAST_POSES:
        (begin, end), (first, last) = estimated.time[[0, -1]], time[[0, -1]]
        raise ConfigError(
            f"the truth spans {first:.2f} to {last:.2f} s by the run's clock, the run {begin:.2f} to {end:.2f} s: "
            f"{both.sum()} poses in common, expected at least {LEAST_POSES}"
        )
    time, poses, true = time[both], poses[both], truth.poses[both]
    driven = np.append(0.0, np.cumsum(np.hypot(*np.diff(estimated.poses[:, :2], axis=0).T)))
    distance = np.interp(time, estimated.time, driven)
    origin = _aligned(poses, true, alignment)
    moved = Trajectory(time=time, poses=poses).placed(origin).poses
    return Comparison(
        time=time,
        distance=distance - distance[0],
        estimated=moved,
        true=true,
        sensor=sensor,
        alignment=alignment,
        origin=origin,
        clock=clock,
        relative=tuple(_relative(moved, true, distance - distance[0])) if truth.knows_heading else (),
    )


def _aligned(poses: Array, true: Array, alignment: Alignment) -> Pose:
    """Where the origin of the estimated poses' frame is in the frame of the true ones."""
    if alignment == "none":
        return Pose()
    if alignment == "start":
        if not np.isfinite(true[0, 2]):
            raise ConfigError("alignment by the start needs the true heading, which is not known; use best or none")
        return placed(_pose(true[0]), seen_from(_pose(poses[0]), Pose()))
    return best_origin(poses[:, :2], true[:, :2])


def _pose(row: Array) -> Pose:
    x, y, heading = row.tolist()
    return Pose(x=x, y=y, heading=heading)


def best_origin(places: Array, true: Array) -> Pose:
    """The origin of the frame of `places` in that of `true` by least squares of the distances; both of shape (n, 2)."""
    middle, true_middle = places.mean(axis=0), true.mean(axis=0)
    (x, y), (true_x, true_y) = (places - middle).T, (true - true_middle).T
    turn = atan2(float(np.sum(x * true_y - y * true_x)), float(np.sum(x * true_x + y * true_y)))
    back = placed(Pose(heading=turn), Pose(x=float(-middle[0]), y=float(-middle[1])))
    return Pose(x=float(true_middle[0]) + back.x, y=float(true_middle[1]) + back.y, heading=turn)


def _relative(estimated: Array, true: Array, distance: Array) -> Iterator[Relative]:
    """For each length that the run has: from evenly spread poses on, to the first pose so far along the run."""
    for length in LENGTHS:
        if distance[-1] < length:
            return
        begin = np.unique(np.searchsorted(distance, np.linspace(0.0, distance[-1] - length, STARTS)))
        end = np.searchsorted(distance, distance[begin] + length)
        begin, end = begin[end < len(distance)], end[end < len(distance)]
        moved, turned = _motion(estimated, begin, end)
        truly_moved, truly_turned = _motion(true, begin, end)
        driven = distance[end] - distance[begin]
        yield Relative(
            length=length,
            translation=np.hypot(*(moved - truly_moved).T) / driven,
            rotation=np.abs(wrapped(turned - truly_turned)) / driven,
        )


def _motion(poses: Array, begin: NDArray[np.int64], end: NDArray[np.int64]) -> tuple[Array, Array]:
    """Distance [m], shape (k, 2), and turn [rad], shape (k,), of later poses as seen from earlier ones."""
    dx, dy, turn = (poses[end] - poses[begin]).T
    c, s = np.cos(poses[begin, 2]), np.sin(poses[begin, 2])
    return np.column_stack([c * dx + s * dy, c * dy - s * dx]), turn
