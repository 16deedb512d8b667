"""How far the odometry was from the truth, in words: for the terminal and for the page."""

from __future__ import annotations

from math import degrees

import numpy as np

from artemis.motion.clocks import RUN
from artemis.motion.comparison import Comparison, ErrorStatistics, statistics
from artemis.values import Pose

ALIGNMENTS = {
    "none": "none: both in one frame",
    "start": "by the first pose",
    "best": "best fit of all places",
}


def comparison_rows(comparison: Comparison, source: str) -> list[tuple[str, str]]:
    """What was compared with what, and the errors: name and value; `source` is where the truth comes from."""
    time = comparison.time
    rows = [
        ("truth", f"{source}: {len(time)} poses, {time[0]:.2f} to {time[-1]:.2f} s of the run"),
        ("clock", _clock(comparison)),
        ("point", _point(comparison.sensor)),
        ("alignment", _alignment(comparison)),
        ("place [mm]", _statistics(statistics(comparison.error), 1000, 1)),
    ]
    heading = np.degrees(comparison.heading_error)
    if np.isfinite(heading).any():
        mean = float(np.mean(heading))
        rows.append(("heading [°]", f"{_statistics(statistics(np.abs(heading)), 1, 2)}; mean with sign {mean:+.2f}"))
    for each in comparison.relative:
        distance, turn = 100 * each.translation, np.degrees(each.rotation)
        text = f"{np.mean(distance):.2f} % of the distance, {np.max(distance):.2f} % at most; {np.mean(turn):.2f} deg/m"
        rows.append((f"over {each.length:g} m", text))
    if not len(comparison.relative):
        reason = "the truth knows no heading" if not np.isfinite(heading).any() else "the distance is too short"
        rows.append(("relative", f"not known: {reason}"))
    return rows


def _clock(comparison: Comparison) -> str:
    clock = comparison.clock
    if clock is RUN:
        return "the run's own"
    ahead = "ahead of" if clock.offset >= 0 else "behind"
    gains = "gains" if clock.drift >= 0 else "loses"
    return (
        f"{abs(clock.offset):.3f} s {ahead} the run's (± {1000 * clock.offset_sigma:.0f} ms), "
        f"{gains} {1e6 * abs(clock.drift):.0f} ppm (± {1e6 * clock.drift_sigma:.0f} ppm)"
    )


def _point(sensor: Pose) -> str:
    if sensor == Pose():
        return "centre of the rear axle"
    turned = f", turned by {degrees(sensor.heading):g} deg" if sensor.heading else ""
    return f"{sensor.x:g} m ahead and {sensor.y:g} m left of the rear axle's centre{turned}"


def _alignment(comparison: Comparison) -> str:
    words, origin = ALIGNMENTS[comparison.alignment], comparison.origin
    if comparison.alignment == "none":
        return words
    return (
        f"{words}: odom is at x {origin.x:.3f} m, y {origin.y:.3f} m, {degrees(origin.heading):.2f} deg of the truth's"
    )


def _statistics(errors: ErrorStatistics, scale: float, digits: int) -> str:
    named = (("mean", errors.mean), ("median", errors.median), ("RMS", errors.rms), ("max", errors.max))
    words = [f"{name} {scale * value:.{digits}f}" for name, value in (*named, ("at the end", errors.end))]
    return ", ".join(words)
