"""Faults of what tells where the robot is and where it shall go: scanner, localisation, path."""

from __future__ import annotations

from artemis.supervision.catalogue.row import ITSELF, LIMIT, MINUTE, S2, Found, K, Row, Threshold, automatic

_TEN = 10 * MINUTE
_ABSENT, _LOADING = Found.ABSENT, Found.LOADING
_LASER, _LOCALISATION = "needs a laser scanner", "a localizer's fixes are judged one by one: such a pose is not used"

SURROUNDINGS: dict[str, Row] = {
    "LAS-01": Row("scanner lost", _ABSENT, S2, automatic(5, _TEN), reason=_LASER),
    "LAS-02": Row("scanner frozen", _ABSENT, S2, automatic(5, _TEN), reason=_LASER),
    "LAS-03": Row("garbage telegram", _ABSENT, S2, ITSELF, reason=_LASER),
    "LAS-04": Row("split telegrams", _ABSENT, S2, ITSELF, reason=_LASER),
    "LAS-05": Row("scanner reports an error", _ABSENT, LIMIT, automatic(2, _TEN), reason=_LASER),
    "LAS-06": Row("ranges implausible", _ABSENT, S2, ITSELF, reason=_LASER),
    "LAS-07": Row("scanner clock drifts", _ABSENT, S2, ITSELF, reason=_LASER),
    "LAS-08": Row(
        "obstacle",
        Found.MODE,
        LIMIT,
        ITSELF,
        "stands for an obstacle",
        "remove it, or drive around it by hand; it drives on once the path has been free for a second",
        within=0.06,
    ),
    "LOC-01": Row(
        "pose stale",
        Found.MODE,
        S2,
        K,
        "no localizer has seen the robot for too long",
        "does it see the robot? drive back by hand to where it does",
    ),
    "LOC-02": Row("pose jump", _ABSENT, S2, automatic(2, _TEN), reason=_LOCALISATION),
    "LOC-03": Row("divergence", _ABSENT, S2, automatic(1, _TEN), reason=_LOCALISATION),
    "LOC-04": Row("pose is not a number", _ABSENT, S2, ITSELF, reason=_LOCALISATION),
    "LOC-05": Row("pose times run backwards", _ABSENT, S2, ITSELF, reason=_LOCALISATION),
    "PTH-01": Row("path missing", _LOADING, within=0.0),
    "PTH-02": Row("path with wrong points", _LOADING, within=0.0),
    "PTH-03": Row("path too sharp", _LOADING, within=0.0),
    "PTH-04": Row("path with gaps", _LOADING, within=0.0),
    "PTH-05": Row(
        "start too far from the path",
        Found.MODE,
        S2,
        K,
        "start pose too far from the path",
        "place the robot at the path, heading along it",
    ),
    "PTH-06": Row(
        "off the path",
        Found.MODE,
        S2,
        K,
        "off the path",
        "follower, speed, slip; odometry against the true pose",
        within=0.32,
        stages=(Threshold(LIMIT, 0.3, 0.28),),
    ),
    "PTH-07": Row(
        "no progress",
        Found.MEASURED,
        S2,
        automatic(1),
        "makes no progress along the path",
        "follower, blocked wheel",
        within=3.02,
        of="less than 1 cm driven while driving",
        stages=(Threshold(S2, 0.0, 3.0),),
        shows_as=("RUN-04",),
    ),
    "PTH-08": Row(
        "end of the path missed",
        Found.MODE,
        S2,
        K,
        "drove on beyond the end of the path",
        "follower, speed",
    ),
    "PTH-09": Row("follower late", Found.EDGE, S2, K, "answered late", "it must return within 15 ms", within=0.08),
}
