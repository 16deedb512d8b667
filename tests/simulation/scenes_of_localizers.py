"""How the rows LOC-.. are made to happen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from every_row import Scene
from rig import Run

from artemis.motion.localisation import LOST_DISTANCE
from artemis.values import Severity

PERIOD = 0.1
"""Of the tracker: something may show up to one later [s]."""
SCENE = Scene(of="following", localizer=True, effect=PERIOD)


def scene(severity: Severity | None = None, **options: Any) -> Scene:  # noqa: ANN401
    return replace(SCENE, options=options, severity=severity)


def driven_unseen(run: Run, at: float) -> float:
    """Until the robot has driven without a fix as far as it may [s]."""
    ticks = [seen for seen in run.seen if seen.time >= at]
    first = ticks[0].tick.snapshot.odometry.driven
    return next(seen.time for seen in ticks if seen.tick.snapshot.odometry.driven - first > LOST_DISTANCE) - at


LOCALIZER_SCENES: Mapping[str, Scene | Sequence[Scene]] = {
    "LOC-01": Scene(of="following far", localizer=True, effect=driven_unseen, longest=30.0),
    "LOC-02": [scene(), replace(scene(y_m=0.0, heading_deg=15.0), effect=0.45)],  # fits no motion: counted anew once
    "LOC-03": [replace(scene(Severity.LIMIT, doubt=0.7), effect=1.0), scene()],
    "LOC-04": replace(scene(), device="localizer"),
    "LOC-05": [scene(Severity.WARN, duration_s=0.15), scene(), scene(seconds=1.0)],
}
