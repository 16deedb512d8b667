"""What a mission may say of obstacles, for all of its steps or for one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from artemis.config import Config
from artemis.mission.keys import Positive
from artemis.scan import ObstacleRules
from artemis.vehicle import RobotFile

DRIVES_INTO = {"off": "drive into what it could see", "slow": "creep into what it sees"}
"""Modes in which it may touch something."""
Distance = Annotated[float, Field(ge=0.03, le=1.0)]


class Obstacles(Config):
    """What the robot does about what its laser scanners see. One word stands for its `mode`."""

    mode: Literal["stop", "slow", "off"] = "stop"
    """stop: the robot stops in time; slow: it creeps instead of stopping, and may touch what is in its way; off: it
    ignores obstacles."""
    margin_m: Distance = 0.08
    """The outline is enlarged by this on every side."""
    clear_m: Distance = 0.05
    """The robot stops at this distance from contact with the enlarged outline."""
    blocked_after_s: Positive = 30.0
    """A step in which the robot waits longer for a free path ends with the outcome `blocked`; the robot continues by
    itself once the path has been free for a second."""
    unseen_reverse: Literal["refused", "allowed"] = "refused"
    """Reversing over ground that no scanner has seen, and that the robot did not drive over, within the last minute."""
    reason: Annotated[str, Field(min_length=3, max_length=200)] | None = None
    """Why the robot may touch what is in its way; required for `off` and `slow` on a real bus."""

    @model_validator(mode="before")
    @classmethod
    def _word(cls, data: Any) -> Any:  # noqa: ANN401 (of a file)
        return {"mode": data} if isinstance(data, str) else data

    def rules(self, *, by_hand: bool = False) -> ObstacleRules:
        """The same for the decision core; a person who drives does not wait."""
        return ObstacleRules(
            mode=self.mode,
            margin=self.margin_m,
            clear=self.clear_m,
            blocked_after=self.blocked_after_s,
            free_after=0.0 if by_hand else 1.0,
            unseen_reverse=self.unseen_reverse == "allowed",
        )


def ignored(obstacles: Obstacles | None, robot: RobotFile) -> str | None:
    """What it means that a robot may touch what its scanners could see; None: it may not."""
    if obstacles is None or obstacles.mode not in DRIVES_INTO or not robot.scanners:
        return None
    from artemis.motion.obstacles import SLOW_SPEED, UNSEEING_SPEED

    speed = SLOW_SPEED if obstacles.mode == "slow" else UNSEEING_SPEED
    why = "" if obstacles.reason is None else f" ({obstacles.reason})"
    return f"{obstacles.mode}: the robot may {DRIVES_INTO[obstacles.mode]}, at up to {speed:g} m/s{why}"


def rules_for(obstacles: Obstacles | None, robot: RobotFile, *, by_hand: bool = False) -> ObstacleRules | None:
    """What holds for a robot: one with a scanner stops for what it sees unless the mission says otherwise."""
    return (obstacles or Obstacles()).rules(by_hand=by_hand) if robot.scanners else None


def check_obstacles(obstacles: Obstacles, robot: RobotFile, *, simulated: bool) -> Iterator[str]:
    """What is wrong with it for a robot."""
    if not robot.scanners and obstacles.mode != "off":
        yield "the robot has no scanner, so it cannot see obstacles: describe one in the robot file (`scanners`)"
    elif obstacles.mode in DRIVES_INTO and robot.scanners and not simulated and obstacles.reason is None:
        mode, what = obstacles.mode, DRIVES_INTO[obstacles.mode]
        yield f"mode: {mode} lets the robot {what}; write why: {{mode: {mode}, reason: ...}}"
