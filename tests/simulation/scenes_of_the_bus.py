"""How the rows COM-.. are made to happen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from every_row import Effect, Scene, in_phase, once
from rig import Run, Seen
from watched import STEERING, TRACTION, Truth

from artemis.drive_states import Goal
from artemis.values import Severity

LEFT, RIGHT = TRACTION
STEER_LEFT, STEER_RIGHT = STEERING
BOOT = 0.05
"""A drive boots in this time [s]."""
CONFIGURING = 0.16
"""Four drives are configured side by side in this time, and judged together [s]."""
SECURING, RELEASING = 0.04, 0.06
"""Traction drives come before steering drives, and all are judged together [s]."""
THREE_TRIES = 0.15
"""An SDO request is given up after this time [s]."""
ANSWER = 0.2
"""What was commanded in this time may still be on its way to a wheel [s]."""


def _asked_to_enable(role: str) -> Effect:
    return once(lambda seen: getattr(seen.tick.wish, role) is Goal.ENABLED)


def _asked_otherwise(seen: Seen) -> bool:
    """The set-point is 0.15 m/s less than before."""
    return seen.tick.set_points.speed_left <= 0.4 - 0.15


def away(node: str, degrees: float, later: float = 0.0) -> Effect:
    """The wheel is truly so far from its set-point."""

    def effect(run: Run, at: float) -> float:
        def error(seen: Seen, truth: Truth) -> float:
            side = STEERING.index(node)
            points = seen.tick.set_points
            return abs((points.steering_left, points.steering_right)[side] - truth.wheel_angles[side])

        limit = math.radians(degrees)
        first = next(s for s in run.seen if s.time >= at and error(s, run.truth_at(s.now)) > limit)
        return first.time + later - at

    return effect


def _stale_target(node: str, target: int) -> Scene:
    """Set-points clear a target, too: here the drive hears none until the target is looked at."""
    lost = {"at_s": 0.9, "inject": "COM-12", "node": node, "duration_s": 0.175}
    looked_at = in_phase("clear target", 0.02)
    return Scene(of="bring-up", at=0.901, node=node, options={"target": target}, along=[lost], effect=looked_at)


BUS_SCENES: Mapping[str, Scene | Sequence[Scene]] = {
    "COM-01": Scene(node=LEFT, coasts=[LEFT]),
    "COM-02": [Scene(node=RIGHT, coasts=[RIGHT]), Scene(node=STEER_LEFT, options={"state": "switched on"})],
    "COM-03": [
        Scene(of="bring-up", node=STEER_RIGHT, effect=_asked_to_enable("steering")),
        Scene(of="bring-up", node=LEFT, effect=_asked_to_enable("traction")),
    ],
    "COM-04": [Scene(node=RIGHT), Scene(node=STEER_RIGHT, options={"mode": 3})],
    "COM-05": [Scene(node=LEFT), Scene(node=STEER_LEFT)],
    "COM-06": [_stale_target(LEFT, 1000), _stale_target(STEER_LEFT, 20000)],
    "COM-07": Scene(of="bring-up", node=RIGHT, effect=in_phase("configure", CONFIGURING)),
    "COM-08": [
        Scene(of="bring-up", node=LEFT, effect=in_phase("secure", SECURING)),
        Scene(of="bring-up", node=STEER_LEFT, effect=in_phase("secure", SECURING)),
    ],
    "COM-09": Scene(of="bring-up", node=STEER_RIGHT, effect=in_phase("secure", 0.08)),
    "COM-10": Scene(of="bring-up", node=LEFT, effect=in_phase("configure", CONFIGURING)),
    "COM-11": [Scene(node=LEFT, options={"duration_s": 1.0}), Scene(node=STEER_RIGHT, options={"duration_s": 1.0})],
    "COM-12": [
        Scene(node=LEFT, seen=["RUN-01"], effect=once(_asked_otherwise, ANSWER)),
        Scene(of="swinging", node=STEER_LEFT, seen=["STE-06"], device="", effect=away(STEER_LEFT, 4.0)),
    ],
    "COM-14": [Scene(node=LEFT, device=""), Scene(device="", options={"count": 3, "length": 0})],
    "COM-15": Scene(node=RIGHT, options={"duration_s": 0.5}, seen=["COM-11"]),
    "COM-16": Scene(node=LEFT, options={"overtaken_by": 12}),
    "COM-17": [
        Scene(node=LEFT, device="", coasts=[LEFT]),
        Scene(node=STEER_LEFT, device="", options={"says": "pre-operational"}),
    ],
    "COM-18": Scene(),
    "COM-19": Scene(of="bring-up", node=STEER_LEFT, effect=in_phase("secure")),
    "COM-20": Scene(),
    "COM-21": Scene(alone=True),
    "COM-22": Scene(alone=True),
    "COM-24": Scene(),
    "COM-25": [Scene(), Scene(options={"times": None, "duration_s": 0.3}, alone=True)],
    "COM-26": [Scene(node=RIGHT, effect=BOOT, coasts=[RIGHT]), Scene(node=STEER_LEFT, effect=BOOT)],
    "COM-27": [Scene(node=RIGHT), Scene(node=STEER_RIGHT, options={"state": "stopped"})],
    "COM-28": [Scene(node=LEFT), Scene(node=STEER_LEFT)],
    "COM-29": Scene(options={"duration_s": 1.0}),
    "COM-30": [
        Scene(of="bring-up", device=LEFT, effect=in_phase("proving the watchdog", 1.5)),
        Scene(of="bring-up", node=STEER_RIGHT, effect=in_phase("proving the watchdog", 1.5)),
    ],
    "COM-31": [
        Scene(severity=Severity.WARN, effect=0.12),  # SYS-01 stops the robot already
        Scene(options={"seconds": 0.16}, effect=0.16),
    ],
    "COM-32": Scene(of="bring-up"),
    "COM-33": [
        Scene(of="bring-up", node=LEFT, options={"answers": "another product"}, effect=in_phase("secure", SECURING)),
        Scene(of="bring-up", node=STEER_RIGHT, seen=["COM-08"], effect=in_phase("secure", SECURING + THREE_TRIES)),
    ],
    "COM-34": Scene(of="standing", node=RIGHT, effect=in_phase("ending", RELEASING)),
}
