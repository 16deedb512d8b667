"""Random persons before a robot that does as it wishes: who crosses, steps in, or steps aside, and goes on later."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from artemis_lab.bench.obstacle_scenes import HALL, OUTLINE, SCANNER, STEP, Array, Passage, Scene, Steady, drive

CLOSEST = 0.04
"""Nobody steps nearer to the outline by himself [m]."""
GOES_ON = 3.0
"""For so long [s]."""


class Walk(NamedTuple):
    """A part of what a person does."""

    x: float
    y: float
    """Velocity [m/s]."""
    seconds: float = math.inf
    gap: float = CLOSEST
    """It ends earlier if it has brought him so near to the outline [m]."""
    after: float = 0.0
    """It begins once the robot has stood for so long [s]."""


@dataclass(slots=True, kw_only=True)
class Pedestrian(Scene):
    """All circles are one person, who walks one way after the other, and stays where the last one ended."""

    walks: deque[Walk]
    _at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    _stands: float = 0.0
    _found: float = math.inf
    _walked: float = 0.0

    @property
    def fastest(self) -> float:
        """So that the distance is asked in each step: he moves by it."""
        return math.inf

    def distance(self, x: float, y: float, heading: float) -> float:
        """As of any scene."""
        self._stands = self._stands + STEP if self._at == (x, y, heading) else 0.0
        self._at = x, y, heading
        found = Scene.distance(self, x, y, heading)
        if self.walks and self._walked > 0.0:
            walk = self.walks[0]
            if self._walked >= walk.seconds or (found < walk.gap and found < self._found):
                self.walks.popleft()
                self._walked = 0.0
        self._found, self.moves = found, np.zeros_like(self.moves)
        if self.walks and self._stands >= self.walks[0].after:
            self._walked += STEP
            self.moves += self.walks[0][:2]
        return found


def _body(dice: np.random.Generator, x: float, y: float) -> Array:
    """Of a person at a place [m]: a body, or two legs; circles."""
    if dice.random() < 0.5:
        return np.array([[x, y, dice.uniform(0.1, 0.2)]])
    apart, turn = dice.uniform(0.08, 0.15), dice.uniform(0.0, math.pi)
    dx, dy, radius = apart * math.cos(turn), apart * math.sin(turn), dice.uniform(0.05, 0.07)
    return np.array([[x - dx, y - dy, radius], [x + dx, y + dy, radius]])


def _going_on(dice: np.random.Generator) -> list[Walk]:
    """He stays, or walks on after some seconds, anywhere."""
    if dice.random() < 0.5:
        return []
    pause, walk, turn = dice.uniform([1.0, 0.2, -math.pi], [9.0, 1.2, math.pi])
    return [Walk(0.0, 0.0, pause), Walk(walk * math.cos(turn), walk * math.sin(turn), GOES_ON)]


def crossing(seed: int) -> tuple[Scene, float]:
    """A person who walks at 1.5 m/s to where the robot would be, and never yields; how long that takes [s]."""
    dice = np.random.default_rng(seed)
    meet = dice.uniform(1.5, 3.5)
    angle = math.radians(dice.uniform(45.0, 135.0)) * (1.0 if dice.random() < 0.5 else -1.0)
    x, y = 0.7 * (meet - 0.7) + dice.uniform(-0.3, 0.9), dice.uniform(-0.2, 0.2)
    walk = 1.5 * math.cos(angle), 1.5 * math.sin(angle)
    return Scene(circles=np.array([[x - walk[0] * meet, y - walk[1] * meet, 0.2]]), moves=np.array([walk])), meet


def stepping_in(seed: int) -> tuple[Pedestrian, float]:
    """A person who walks to where the robot brakes; when that is [s]. In a hall or on open ground."""
    dice = np.random.default_rng(seed)
    meet, turn, walk = dice.uniform([1.5, math.radians(-150.0), 0.4], [3.0, math.radians(150.0), 1.6])
    x, y = 0.7 * (meet - 0.7) + OUTLINE.front_m + dice.uniform(0.0, 0.4), dice.uniform(-0.2, 0.2)
    vx, vy = -walk * math.cos(turn), -walk * math.sin(turn)
    hall = HALL if dice.random() < 0.5 else np.zeros((0, 4))
    walks = deque([Walk(vx, vy, gap=dice.uniform(0.05, 0.35)), *_going_on(dice)])
    return Pedestrian(hall, _body(dice, x - vx * meet, y - vy * meet), walks=walks), meet


def stepping_aside(seed: int) -> tuple[Pedestrian, float]:
    """A person in a hall, who steps aside once the robot has stopped before him: it would roll into him there.

    Returns:
        The scene, and how fast the robot drives [m/s].
    """
    dice = np.random.default_rng(seed)
    turn = math.radians(90.0 + dice.uniform(-20.0, 20.0)) * (1.0 if dice.random() < 0.5 else -1.0)
    x, y, walk = dice.uniform([OUTLINE.front_m + 1.0, -0.2, 0.1], [OUTLINE.front_m + 2.0, 0.2, 0.6])
    far, speed = dice.uniform([0.1, 0.2], [0.4, 0.7])
    aside = Walk(walk * math.cos(turn), walk * math.sin(turn), far / walk, after=1.0)
    return Pedestrian(HALL, _body(dice, x, y), walks=deque([aside, *_going_on(dice)])), speed


def crossed(seed: int) -> Passage:
    """A robot at full speed, and such a person."""
    scene, meet = crossing(seed)
    return drive(scene, Steady(0.7), seed, seconds=meet + 1.0)


def stepped_in(seed: int) -> Passage | None:
    """A robot at full speed, and such a person; None: he would begin out of its sight."""
    scene, meet = stepping_in(seed)
    if math.hypot(scene.circles[0, 0] - SCANNER.x_m, scene.circles[0, 1]) < 1.0:
        return None
    return drive(scene, Steady(0.7), seed, seconds=meet + 14.0)


def stepped_aside(seed: int) -> Passage:
    """A robot that drives straight on, and such a person."""
    scene, speed = stepping_aside(seed)
    return drive(scene, Steady(speed), seed, seconds=2.0 / speed + 14.0)
