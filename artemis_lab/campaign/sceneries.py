"""What stands and walks around a robot with laser scanners, drawn at random; some of it is in its way.

Nothing that it could not know of is touched through no fault of its own: nothing is nearer than its scanner sees when
the run begins, nothing appears out of nowhere, nothing is shiny, and people come from where it looks.
"""

from __future__ import annotations

import math
import random
from typing import Any

from artemis.vehicle import RobotFile

Things = dict[str, Any]
BESIDE = 0.3
"""Nothing is nearer to the robot when the run begins [m]."""
AWAY = 0.25
"""Nor nearer to a scanner than this beyond its least range [m]."""
_TRIES = 40


class SceneryDice:
    """Draws the surroundings of one robot."""

    def __init__(self, dice: random.Random, robot: RobotFile, heading: float) -> None:
        """`heading` of the robot, which stands at the origin [rad]."""
        assert robot.outline is not None
        self._dice, self._outline, self._heading = dice, robot.outline, heading
        self._scanners = [(it.x_m, it.y_m, it.least_range_m + AWAY) for it in robot.scanners.values()]

    def drawn(self, length: float) -> Things:
        """A hall, and in it what stands or walks; `length` of the run [s]."""
        dice = self._dice
        found: Things = {"walls": [self._hall()], "poles": [], "boxes": [], "persons": []}
        if dice.random() < 0.6:
            self._add(found, dice.uniform(1.2, 3.5), dice.uniform(-0.35, 0.35))
        for _ in range(dice.choice((0, 1, 2, 3))):
            self._add(found, dice.uniform(0.8, 5.0), dice.uniform(-math.pi, math.pi))
        if dice.random() < 0.25:
            found["persons"].append(self._person(dice.uniform(5.0, max(6.0, length))))
        return found

    def _hall(self) -> Things:
        """Four walls, somehow turned."""
        turn, dice = self._dice.uniform(-0.4, 0.4), self._dice
        front, back, left, right = (
            dice.uniform(2.5, 9.0),
            dice.uniform(2.0, 6.0),
            *(dice.uniform(1.6, 6.0) for _ in "lr"),
        )
        corners = [(front, -right), (front, left), (-back, left), (-back, -right), (front, -right)]
        return {"points": [self._placed(*_turned(x, y, turn)) for x, y in corners]}

    def _add(self, found: Things, distance: float, bearing: float) -> None:
        """Something so far away [m], ahead by `bearing` [rad], or farther if that is too near the robot."""
        dice, kind = self._dice, self._dice.choice(("poles", "poles", "boxes", "persons"))
        surface = dice.choice(("plain", "plain", "plain", "dark"))
        length, width = (
            (dice.uniform(0.02, 0.3), 0.0) if kind == "poles" else (dice.uniform(0.2, 0.8), dice.uniform(0.2, 0.5))
        )
        for _ in range(_TRIES):
            x, y = distance * math.cos(bearing), distance * math.sin(bearing)
            if self._is_clear(x, y, math.hypot(length, width) / 2.0):
                break
            distance += 0.1
        x, y = self._placed(x, y)
        if kind == "poles":
            thing: Things = {"x_m": x, "y_m": y, "diameter_m": round(length, 3), "surface": surface}
            if dice.random() < 0.3:
                thing["until_s"] = round(dice.uniform(8.0, 20.0), 2)
        elif kind == "boxes":
            turn = round(dice.uniform(-90.0, 90.0), 1)
            thing = {"x_m": x, "y_m": y, "length_m": round(length, 3), "width_m": round(width, 3), "heading_deg": turn}
        else:
            thing = {"path": [[0.0, x, y]]}
        found[kind].append(thing)

    def _is_clear(self, x: float, y: float, radius: float) -> bool:
        o = self._outline
        beside = math.hypot(max(-o.rear_m - x, x - o.front_m, 0.0), max(abs(y) - o.half_width_m, 0.0))
        seen = all(math.hypot(x - sx, y - sy) - radius > near for sx, sy, near in self._scanners)
        return seen and beside - radius > BESIDE

    def _person(self, time: float) -> Things:
        """Somebody who walks across ahead of the robot at about that time [s], and maybe stays in its way."""
        dice, side = self._dice, self._dice.choice((-1.0, 1.0))
        ahead, pace = dice.uniform(1.8, 3.5), dice.uniform(0.4, 1.2)
        begin = ahead + dice.uniform(-0.5, 1.5), side * dice.uniform(1.5, 3.0)
        end = (ahead, 0.0) if dice.random() < 0.4 else (ahead + dice.uniform(-0.3, 1.0), -side * dice.uniform(1.5, 3.0))
        took = math.dist(begin, end) / pace
        path = [[round(time, 2), *self._placed(*begin)], [round(time + took, 2), *self._placed(*end)]]
        return {"path": path, "diameter_m": round(dice.uniform(0.25, 0.5), 2)}

    def _placed(self, x: float, y: float) -> tuple[float, float]:
        """In the world, of a place in the robot's frame when the run begins."""
        x, y = _turned(x, y, self._heading)
        return round(x, 4), round(y, 4)


def _turned(x: float, y: float, angle: float) -> tuple[float, float]:
    return x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle)
