"""What every localizer must do, as tests: see `artemis.testing.contracts`."""

from __future__ import annotations

from math import pi

import numpy as np

from artemis.clock import stopwatch
from artemis.plugins.contracts import Localizer, SeesTicks
from artemis.plugins.fixes import plain_fixes
from artemis.plugins.guard import LATE
from artemis.plugins.registry import LOCALIZERS
from artemis.scan import Scan
from artemis.testing.contracts import PERIOD, PluginContract
from artemis.values import (
    DriveFeedback,
    LocatedPose,
    Mode,
    Odometry,
    Pose,
    PoseFix,
    Sensed,
    SetPoints,
    Snapshot,
    Tick,
    Verdict,
    Wish,
)

SPEED = 0.2
"""The robot of the ticks drives so fast along the x axis [m/s],"""
ROOM = (-3.0, 9.0, -4.0, 3.0)
"""in a room from x to x, y to y [m], in which nothing stands."""
BEAMS = 541
LONGEST = 10 * LATE
"""So long a call may take [s]: a busy computer makes longer what is late from `LATE` on."""


class LocalizerContract(PluginContract):
    """A localizer: inherit, set `plugin`, `options` and `files` if it has any, a `robot` with scanners if it sees."""

    group = LOCALIZERS
    duration: float = 30.0
    """So long it is asked [s], of run time: nothing waits for it."""

    def tick(self, now: float) -> Tick:
        """What one that `SeesTicks` is shown at run time `now` [s]; override it for another drive."""
        pose = Pose(x=SPEED * now)
        scans = tuple(
            room_scan(name, now - PERIOD, pose.x + mounting.x_m, mounting.y_m, mounting.heading)
            for name, mounting in self.robot.scanners.items()
        )
        drives = tuple(DriveFeedback(name=name, age=0.0) for name in self.robot.drives)
        snapshot = Snapshot(
            sensed=Sensed(index=round(now / PERIOD), time=now, drives=drives, scans=scans),
            dt=PERIOD,
            pose=LocatedPose(pose=pose),
            odometry=Odometry(pose=pose, speed=SPEED, distance=pose.x, driven=pose.x),
            standing=False,
            set_points=SetPoints(speed=SPEED),
            verdict=Verdict(),
        )
        return Tick(snapshot=snapshot, mode=Mode.TELEOP, wish=Wish(), set_points=SetPoints(speed=SPEED))

    def found(self) -> list[tuple[float, PoseFix]]:
        """What a new one finds tick by tick, with the run times [s]; it is closed afterwards."""
        localizer: Localizer = self.make()
        found, times = [], []
        try:
            for tick in range(round(self.duration / PERIOD)):
                now, begun = tick * PERIOD, stopwatch()
                answer = localizer.fixes(now)
                times.append((stopwatch() - begun, now))
                fixes = plain_fixes(answer)
                assert fixes is not None, f"fixes({now:.2f}) gave {answer!r}: not whole (PLG-06)"
                for fix, told in zip(fixes, answer, strict=True):
                    assert fix is not None, f"fixes({now:.2f}) gave {told!r}: it cannot be true (LOC-04)"
                    found.append((now, fix))
                if isinstance(localizer, SeesTicks):
                    problem: object = localizer.see(self.tick(now))
                    assert problem == "", f"see() at {now:.2f} s gave {problem!r}: a warning (LOC-06), or no text"
        finally:
            localizer.close()
            localizer.close()
        took, now = sorted(times)[-1 - len(times) // 100]  # one of 100 may be late: what else the computer does
        assert took <= LONGEST, (
            f"fixes({now:.2f}) takes {1000 * took:.0f} ms, {1000 * LONGEST:.0f} are allowed (PLG-03)"
        )
        return found

    def test_fixes_are_whole_and_told_once(self) -> None:
        """Each answer is a tuple of fixes that can be true, and none comes again."""
        times = [fix.time for _, fix in self.found()]
        assert len(set(times)) == len(times), "a fix was reported twice"

    def test_fixes_are_of_the_past(self) -> None:
        """And not so old that nobody knows where the odometry was then."""
        for now, fix in self.found():
            assert now - 2.0 <= fix.time <= now + PERIOD, (
                f"fixes({now:.2f}) gave one of {fix.time:.2f} s: it is not used"
            )


def room_scan(name: str, time: float, x: float, y: float, heading: float) -> Scan:
    """What a scanner at (x, y) [m] that looks to `heading` [rad] sees of `ROOM` at a run time [s], all at once."""
    angles = np.linspace(-0.75 * pi, 0.75 * pi, BEAMS)
    dx, dy = np.cos(angles + heading), np.sin(angles + heading)
    along = np.where(dx > 0, ROOM[1] - x, x - ROOM[0]) / np.maximum(np.abs(dx), 1e-9)
    across = np.where(dy > 0, ROOM[3] - y, y - ROOM[2]) / np.maximum(np.abs(dy), 1e-9)
    ranges = np.rint(1000.0 * np.minimum(along, across)).astype("<u2").tobytes()
    increment = float(angles[1] - angles[0])
    return Scan(source=name, time=time, start_angle=float(angles[0]), increment=increment, ranges=ranges)
