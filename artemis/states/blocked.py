"""What a mode does while an obstacle stops the robot: it says so, and does not wait for ever."""

from __future__ import annotations

from msgspec.structs import replace

from artemis.progress import BLOCKED
from artemis.scan import ObstacleRules
from artemis.states.mode import stand
from artemis.supervision import catalogue
from artemis.values import Event, Mode, Snapshot, Wish


def is_blocked(snapshot: Snapshot) -> bool:
    """Whether the robot stands for an obstacle."""
    clearance = snapshot.set_points.clearance
    return clearance is not None and clearance.blocked > 0.0


def held_up(rules: ObstacleRules, mode: Mode, wish: Wish, snapshot: Snapshot) -> Wish:
    """The wish of a mode whose robot is blocked, with the fault LAS-08; after too long the end of its step."""
    clearance = snapshot.set_points.clearance
    assert clearance is not None
    if mode is not Mode.TELEOP and clearance.blocked >= rules.blocked_after and snapshot.standing:
        ended = stand(snapshot, event=Event.DONE, tracking=wish.tracking)
        return replace(ended, acted=wish.acted, done=wish.done, outcome=BLOCKED)
    fault = wish.fault or catalogue.fault("LAS-08", "", f"{max(clearance.distance, 0.0):.2f} m are free")
    return replace(wish, fault=fault, phase="waiting for a free path")
