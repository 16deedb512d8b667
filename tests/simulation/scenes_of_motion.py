"""How the rows RUN-.., STE-.., CAL-.. and PTH-.. are made to happen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from every_row import SETTINGS, SPEED, Effect, Scene, once, when
from rig import BRAKING, Run, Seen
from scenes_of_the_bus import away
from watched import DRIVES, STEERING, TRACTION, Truth

from artemis.supervision.catalogue import ROWS
from artemis.values import Severity

LEFT, RIGHT = TRACTION
STEER_LEFT, STEER_RIGHT = STEERING
ASKED = 0.02
"""A follower is asked at the next tick [s]."""
TO_BE_READ = 0.02
"""A position is read with the next SYNC [s]."""
AT = SETTINGS["driving"].at
ANALOG_STEP = 0.35
"""An analog input tells angles this coarsely [degrees]."""
FADED = 0.1
"""Deceleration that is left of a driven wheel's [m/s²]."""
RAMP_DELAY = 0.1
"""A drive begins its quick stop within this time [s]."""


def faster_than(speed: float) -> Effect:
    """A driven wheel truly rolls so fast [m/s]."""
    return when(lambda truth: max(abs(rolling) for rolling in truth.wheel_speeds) > speed)


def apart(share: float) -> Effect:
    """The driven wheels truly differ by this share of the faster one."""

    def differ(truth: Truth) -> bool:
        slow, fast = sorted(abs(rolling) for rolling in truth.wheel_speeds)
        return fast - slow > share * fast

    return when(differ)


def turned(node: str, degrees: float) -> Effect:
    """The wheel truly turned so far, or its motor did."""

    def effect(run: Run, at: float) -> float:
        def angle(seen: Seen) -> float:
            return next(drive.position for drive in seen.tick.snapshot.sensed.drives if drive.name == node)

        ticks = [seen for seen in run.seen if seen.time >= at]
        return next(s.time for s in ticks if abs(angle(s) - angle(ticks[0])) > math.radians(degrees)) - at

    return effect


def loaded(node: str, share: float) -> Effect:
    """The motor's current is so much of what its drive lets it have."""

    def is_loaded(seen: Seen) -> bool:
        drive = seen.tick.snapshot.sensed.drives[DRIVES.index(node)]
        return abs(drive.current) > share * 2.0

    return once(is_loaded)


def off_the_line(distance: float) -> Effect:
    """So far from a path along x [m]."""
    return when(lambda truth: abs(truth.pose.y) > distance)


ASIDE = {"inject": "RUN-12", "options": {"speed_m_s": 0.4, "steering_deg": 45.0}}
BLOCKED = {"inject": "RUN-04", "node": RIGHT}

MOTION_SCENES: Mapping[str, Scene | Sequence[Scene]] = {
    "RUN-01": [
        Scene(node=LEFT, effect=faster_than(SPEED + 0.15)),
        Scene(node=RIGHT, options={"gain": -1.0}, effect=when(lambda truth: truth.wheel_speeds[1] < -0.15)),
    ],
    "RUN-02": Scene(of="bring-up", at=0.841, options={"duration_s": 0.3}, effect=faster_than(0.05), coasts=TRACTION),
    "RUN-03": Scene(
        options={"deceleration_m_s2": FADED},
        operator=[(AT + 0.02, "quickstop")],
        effect=0.02 + RAMP_DELAY + 0.15 / (BRAKING - FADED),
        coasts=TRACTION,
    ),
    "RUN-04": [Scene(node=LEFT, seen=["RUN-05"], device=""), Scene(node=LEFT, along=[{"at_s": AT, **BLOCKED}])],
    "RUN-05": [
        Scene(node=LEFT, device="", options={"slip": 0.27}, severity=Severity.LIMIT, effect=apart(0.25)),
        Scene(of="driving on", node=LEFT, device="", options={"slip": 0.27}, effect=2.0),
        Scene(node=RIGHT, options={"slip": 0.6}, seen=["RUN-01", "RUN-05"], effect=apart(0.25)),
    ],
    "RUN-06": Scene(node=RIGHT, device=RIGHT, seen=["COM-02"], coasts=[RIGHT]),
    "RUN-10": [
        Scene(node=LEFT, options={"count": 2}, effect=TO_BE_READ),
        Scene(node=STEER_RIGHT, options={"count": None}, effect=TO_BE_READ),
    ],
    "RUN-11": [
        Scene(of="following", device="follow"),
        Scene(of="following", device="follow", options={"value": "inf"}),
    ],
    "RUN-12": Scene(
        of="following",
        options={"speed_m_s": 1.0, "steering_deg": 0.0, "duration_s": 1.2},
        operator=[(6.2, "end")],
        effect=ASKED,
    ),
    "STE-01": Scene(of="swinging", node=STEER_LEFT, seen=["STE-06"], device="", effect=away(STEER_LEFT, 3.0)),
    "STE-02": [
        Scene(of="nudged", node=STEER_RIGHT, effect=loaded(STEER_RIGHT, 0.9)),
        Scene(of="swinging", node=STEER_RIGHT, seen=["DRV-25"], effect=away(STEER_RIGHT, 3.0)),
    ],
    "STE-03": [
        Scene(node=STEER_LEFT),
        Scene(
            node=STEER_RIGHT,
            options={"potentiometer": 2, "offset_v": 0.0, "drift_v_s": 0.2},
            effect=(3.0 + ANALOG_STEP) / 72 / 0.2,
        ),
    ],
    "STE-04": [Scene(node=STEER_LEFT), Scene(node=STEER_RIGHT, options={"potentiometer": 2, "voltage": 0.0})],
    "STE-05": Scene(node=STEER_RIGHT),
    "STE-06": Scene(of="swinging", node=STEER_LEFT, seen=["STE-05"], effect=turned(STEER_LEFT, 4.0)),
    "STE-07": Scene(of="swinging", node=STEER_RIGHT, seen=["STE-05"], effect=turned(STEER_RIGHT, 4.0)),
    "CAL-01": [
        Scene(of="calibrating", node=STEER_LEFT, seen=ROWS["CAL-01"].shows_as),
        Scene(of="bring-up", node=STEER_RIGHT, seen=ROWS["CAL-01"].shows_as),
        Scene(
            of="measuring",
            inject="STE-03",
            node=STEER_LEFT,
            options={"potentiometer": 2, "offset_v": 0.0, "drift_v_s": 0.002},
            effect=when(lambda truth: truth.time > 12.0),  # told once the wheel is measured
            longest=60.0,
        ),
    ],
    "CAL-02": Scene(of="bring-up", node=STEER_RIGHT),
    "PTH-06": [
        Scene(of="following", effect=off_the_line(0.3), severity=Severity.LIMIT, device="", **ASIDE),  # type: ignore[arg-type]
        Scene(of="following", at=6.601, effect=off_the_line(0.6), **ASIDE),  # type: ignore[arg-type]
    ],
    "PTH-07": [
        Scene(of="following", seen=["RUN-04"], device=LEFT),
        Scene(
            of="following",
            inject="RUN-12",
            options={"speed_m_s": 0.08, "steering_deg": 0.0},
            along=[{"at_s": 5.6, "inject": "PTH-07"}],
            effect=0.8,
        ),
    ],
    "PTH-08": Scene(of="following to the end", effect=when(lambda truth: truth.pose.x > 0.8 + 0.2)),
    "PTH-09": Scene(of="following", device="follower"),
}
