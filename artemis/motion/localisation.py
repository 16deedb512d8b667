"""Where the robot is on the map: a localizer's fixes, each placed at its own time, carried on by the odometry.

An extended Kalman filter of the pose, which is a measured one itself. Between two fixes the odometry tells the motion;
its drift is unknown but grows with the distance. A fix that comes late is sorted in, and what followed is computed
again: so the order in which fixes arrive changes nothing. A fix that cannot be true is not believed at once: a tracker
may see something else. A few that agree with each other over some time are: then the robot is where they say.

The filter takes the errors of fixes for independent. What fixes of one place have in common (`PoseFix.common`) is
therefore kept beside it, neither estimated nor reduced, and added to what is told: a Schmidt-Kalman filter, in which
such errors are considered but not estimated (A. H. Jazwinski, Stochastic Processes and Filtering Theory, 1970, 8.4).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable
from math import hypot, inf, radians

from msgspec import Struct
from msgspec.structs import replace

from artemis.motion.angles import difference, wrap
from artemis.motion.poses import placed, seen_from
from artemis.values import LocatedPose, Odometry, Pose, PoseFix

KEPT = 2.0
"""Odometry is kept for so long [s]; a fix that is older is not used."""
POSITION_DRIFT, HEADING_DRIFT = 0.04, radians(2)
"""Standard deviation of the odometry's loss over a distance [m/m, rad/m]: scale of the wheels, zero of the steering."""
POSITION_WALK, HEADING_WALK = 0.01, radians(1)
"""What it loses besides after one metre [m, rad]: slip and play; grows with the root of the distance."""
POSITION_CREEP, HEADING_CREEP = 0.001, radians(0.05)
"""What is lost in one second by itself [m, rad]: no fix is believed for ever, even at rest; grows with the root."""
GATE = 16.27
"""A fix is believed up to this squared distance in its own and the estimate's covariance: chi-square with three
degrees of freedom, 0.999."""
AGREEING, AGREEING_TIME = 5, 1.0
"""So many fixes in a row that agree with each other, over so long [s], are believed whatever was before."""
CORRECTION, TURNING = 0.1, radians(5)
"""While the robot moves, its pose is corrected no faster than this [m/s, rad/s]."""
LOST_DISTANCE = 5.0
"""After this distance without a fix that was believed [m] the pose means nothing."""
JUMP, JUMP_TURN = 0.3, radians(10)
"""Fixes that are not believed and say that the robot is so far away, or so askew [m, rad], contradict the pose."""

Covariance = tuple[float, ...]
"""xx, xy, xh, yy, yh, hh, of x, y [m] and heading h [rad]."""


class _Moment(Struct, frozen=True):
    """The odometry's pose at a time [s], and the whole distance that was rolled until then [m]."""

    time: float
    odom: Pose
    distance: float


class _Estimate(Struct, frozen=True):
    """The pose on the map at a moment, and how sure it is."""

    at: _Moment
    pose: Pose
    covariance: Covariance
    common: Covariance = ()
    """What the newest fix shares with those beside it; not in the covariance."""


class _Belief(Struct, frozen=True):
    """All that is concluded from the fixes until one of them."""

    estimate: _Estimate
    rival: _Estimate | None = None
    """What the newest fixes say that were not believed."""
    since: float = 0.0
    """When they began [s]."""
    agreeing: int = 0
    refused: int = 0


class Localisation:
    """Keeps the located pose from tick to tick. Pure: the same odometry and fixes give the same poses."""

    def __init__(self, period: float) -> None:
        """`period` of the scheduled ticks [s]."""
        self._period = period
        self._moments: list[_Moment] = []
        self._distance = 0.0
        self._waiting: list[PoseFix] = []
        self._used: list[PoseFix] = []
        """In the order of their times."""
        self._beliefs: list[_Belief] = []
        """What was concluded from each of them and all before it."""
        self._base: _Belief | None = None
        """What was concluded before the first of them."""
        self._shown: tuple[Pose, Pose] | None = None
        """The pose that was told last, in `odom` and in `map`; None: it meant nothing."""
        self._source, self._unused = "", 0
        self._lost_at = -inf
        """When a localizer last told that it is lost [s]; never later than it was told."""

    def reset(self, pose: Pose) -> None:
        """The odometry goes on from `pose`, the robot standing where it is."""
        if not self._moments:
            return
        last = self._moments[-1].odom

        def anew(moment: _Moment) -> _Moment:
            return replace(moment, odom=placed(pose, seen_from(last, moment.odom)))

        def again(belief: _Belief) -> _Belief:
            rival = belief.rival and replace(belief.rival, at=anew(belief.rival.at))
            return replace(belief, estimate=replace(belief.estimate, at=anew(belief.estimate.at)), rival=rival)

        self._moments = [anew(moment) for moment in self._moments]
        self._beliefs = [again(belief) for belief in self._beliefs]
        self._base = self._base and again(self._base)
        self._shown = self._shown and (placed(pose, seen_from(last, self._shown[0])), self._shown[1])
        self._distance = 0.0

    def forget(self) -> None:
        """The robot may have rolled uncounted: only a fix from now on tells where it is."""
        self._drop()
        self._moments.clear()

    def _drop(self) -> None:
        """No fix so far tells where the robot is."""
        if (belief := self._belief) is not None:
            self._unused += belief.refused
        for known in (self._used, self._beliefs, self._waiting):
            known.clear()
        self._base = self._shown = None

    def move(self, time: float, odometry: Odometry) -> None:
        """Take in where the wheels say that the robot was at a run time [s]: at each scheduled tick."""
        distance = 0.0
        if self._moments:
            last = self._moments[-1]
            distance, time = last.distance + abs(odometry.distance - self._distance), max(time, last.time)
            if time == last.time:
                self._moments.pop()
        self._distance = odometry.distance
        self._moments.append(_Moment(time, odometry.pose, distance))
        old = bisect_right(self._moments, time - KEPT, key=lambda moment: moment.time) - 1
        del self._moments[: max(old, 0)]

    def take(self, fixes: Iterable[PoseFix], now: float) -> None:
        """Place what was found, each at its own time, at run time `now` [s]. Of a lost localizer nothing counts."""
        fixes, self._waiting = (*self._waiting, *fixes), []
        for fix in fixes:
            if fix.doubt >= 1.0:
                self._lost_at = max(self._lost_at, min(fix.time, now))
                self._drop()
            elif not fix.covariance:
                continue
            elif not self._moments or not max(self._moments[0].time, self._lost_at) <= fix.time <= now + self._period:
                self._unused += 1
            elif fix.time > self._moments[-1].time:
                self._waiting.append(fix)
            else:
                place = bisect_right(self._used, fix.time, key=lambda used: used.time)
                self._used.insert(place, fix)
                del self._beliefs[place:]
        for fix in self._used[len(self._beliefs) :]:
            self._beliefs.append(_believed(self._belief, fix, self._moment(fix.time)))
        while self._used and self._used[0].time < self._moments[0].time:
            del self._used[0]
            self._base = self._beliefs.pop(0)
        if fixes:
            self._source = max(fixes, key=lambda fix: fix.time).source

    def located(self, now: float, dt: float, *, at_once: bool, unheard: bool, odometry: Odometry) -> LocatedPose:
        """Where the robot is.

        Args:
            now: Run time [s].
            dt: Time since the last scheduled tick [s].
            at_once: The robot stands: its pose may jump.
            unheard: Whether the wheels roll and nobody counts.
            odometry: Of now.
        """
        belief = self._belief
        if belief is None or not self._moments:
            return LocatedPose(pose=odometry.pose, lost=True, unused=self._unused)
        best, moment = belief.estimate, self._moments[-1]
        expected = _carried(best, moment)
        pose, told = expected.pose, expected if not best.common else _carried(_whole(best), moment)
        if self._shown is not None and not at_once:
            before, shown = self._shown
            pose = _nearer(placed(shown, seen_from(before, moment.odom)), pose, dt)
        lost = unheard or moment.distance - best.at.distance > LOST_DISTANCE
        self._shown = None if lost else (moment.odom, pose)
        return LocatedPose(
            pose=pose,
            frame="map",
            source=self._source,
            age=now - best.at.time,
            covariance=told.covariance,
            lost=lost,
            unused=self._unused + belief.refused,
            contradicted=0.0 if belief.rival is None else _contradicted(belief.rival, belief.since, expected, moment),
        )

    @property
    def _belief(self) -> _Belief | None:
        return self._beliefs[-1] if self._beliefs else self._base

    def _moment(self, time: float) -> _Moment:
        """Between two that are kept."""
        index = bisect_right(self._moments, time, key=lambda moment: moment.time)
        before = self._moments[index - 1]
        if index == len(self._moments):
            return before
        after = self._moments[index]
        share = (time - before.time) / (after.time - before.time)
        step = seen_from(before.odom, after.odom)
        there = Pose(x=share * step.x, y=share * step.y, heading=share * step.heading)
        return _Moment(time, placed(before.odom, there), before.distance + share * (after.distance - before.distance))


def _believed(before: _Belief | None, fix: PoseFix, at: _Moment) -> _Belief:
    """What is concluded from a fix and all those before it."""
    alone = _Estimate(at, fix.pose, fix.covariance, fix.common)
    if before is None:
        return _Belief(alone)
    if (estimate := _joined(before.estimate, alone)) is not None:
        return _Belief(estimate, refused=before.refused)
    rival = before.rival and _joined(before.rival, alone)
    since, agreeing = (before.since, before.agreeing + 1) if rival else (fix.time, 1)
    rival = rival or alone
    if agreeing >= AGREEING and fix.time - since >= AGREEING_TIME:
        return _Belief(rival, refused=before.refused)
    return _Belief(before.estimate, rival, since, agreeing, before.refused + 1)


def _contradicted(rival: _Estimate, since: float, expected: _Estimate, now: _Moment) -> float:
    """How long fixes have agreed that the robot is somewhere else [s]; 0: that is not far away."""
    off = seen_from(expected.pose, _carried(rival, now).pose)
    jumped = hypot(off.x, off.y) > JUMP or abs(off.heading) > JUMP_TURN
    return rival.at.time - since if jumped else 0.0


def _carried(estimate: _Estimate, to: _Moment) -> _Estimate:
    """What the odometry makes of an estimate until a later moment."""
    pose = placed(estimate.pose, seen_from(estimate.at.odom, to.odom))
    dx, dy = pose.x - estimate.pose.x, pose.y - estimate.pose.y
    distance, time = to.distance - estimate.at.distance, to.time - estimate.at.time
    turn = (HEADING_DRIFT * distance) ** 2 + HEADING_WALK**2 * distance + HEADING_CREEP**2 * time
    shift = (POSITION_DRIFT * distance) ** 2 + POSITION_WALK**2 * distance + POSITION_CREEP**2 * time
    shift += turn * (dx * dx + dy * dy) / 3  # the heading was lost on the way, not at its begin
    xx, xy, xh, yy, yh, hh = estimate.covariance
    covariance = (
        xx - 2 * dy * xh + dy * dy * hh + shift,
        xy - dy * yh + dx * xh - dx * dy * hh,
        xh - dy * hh,
        yy + 2 * dx * yh + dx * dx * hh + shift,
        yh + dx * hh,
        hh + turn,
    )
    return _Estimate(to, pose, covariance, estimate.common)


def _whole(estimate: _Estimate) -> _Estimate:
    """With what its fixes have in common in the covariance."""
    covariance = tuple(own + shared for own, shared in zip(estimate.covariance, estimate.common, strict=True))
    return replace(estimate, covariance=covariance)


def _joined(estimate: _Estimate, fix: _Estimate) -> _Estimate | None:
    """An estimate, carried to the moment of a fix and corrected by it; None: both cannot be true."""
    expected = _carried(estimate, fix.at)
    off = (
        fix.pose.x - expected.pose.x,
        fix.pose.y - expected.pose.y,
        difference(fix.pose.heading, expected.pose.heading),
    )
    innovation = [p + r for p, r in zip(expected.covariance, fix.covariance, strict=True)]
    inverse = _rows(_inverse(*innovation))
    weighed = [a * off[0] + b * off[1] + c * off[2] for a, b, c in inverse]
    if not _dot(weighed, off) <= GATE:
        return None
    known, given = _rows(expected.covariance), _rows(fix.covariance)
    x, y, heading = (a * weighed[0] + b * weighed[1] + c * weighed[2] for a, b, c in known)
    moved = expected.pose
    pose = Pose(x=moved.x + x, y=moved.y + y, heading=wrap(moved.heading + heading))
    # what is left, P - P S^-1 P, is P S^-1 R: sums of small numbers only
    gain = [[_dot(row, column) for column in inverse] for row in known]
    left = [[_dot(row, column) for column in given] for row in gain]
    covariance = (
        left[0][0],
        (left[0][1] + left[1][0]) / 2,
        (left[0][2] + left[2][0]) / 2,
        left[1][1],
        (left[1][2] + left[2][1]) / 2,
        left[2][2],
    )
    return _Estimate(fix.at, pose, covariance, fix.common)


def _nearer(pose: Pose, target: Pose, dt: float) -> Pose:
    """A pose, corrected towards another one as far as is allowed in a time [s]."""
    dx, dy, turn = target.x - pose.x, target.y - pose.y, difference(target.heading, pose.heading)
    share = min(1.0, CORRECTION * dt / max(hypot(dx, dy), 1e-12))
    turn = min(max(turn, -TURNING * dt), TURNING * dt)
    return Pose(x=pose.x + share * dx, y=pose.y + share * dy, heading=wrap(pose.heading + turn))


def _rows(c: Covariance) -> tuple[tuple[float, float, float], ...]:
    return (c[0], c[1], c[2]), (c[1], c[3], c[4]), (c[2], c[4], c[5])


def _dot(a: Iterable[float], b: Iterable[float]) -> float:
    (a0, a1, a2), (b0, b1, b2) = a, b
    return a0 * b0 + a1 * b1 + a2 * b2


def _inverse(xx: float, xy: float, xh: float, yy: float, yh: float, hh: float) -> Covariance:
    """Of a symmetric matrix."""
    a, b, c = yy * hh - yh * yh, xh * yh - xy * hh, xy * yh - xh * yy
    d, e, f = xx * hh - xh * xh, xy * xh - xx * yh, xx * yy - xy * xy
    whole = xx * a + xy * b + xh * c
    return a / whole, b / whole, c / whole, d / whole, e / whole, f / whole
