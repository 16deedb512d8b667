"""Shapes of the paths that a campaign draws."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence


def table(points: Sequence[tuple[float, float]]) -> str:
    """Points as a path file."""
    return "x,y\n" + "".join(f"{x:.4f},{y:.4f}\n" for x, y in points)


Shape = tuple[list[tuple[float, float]], float, int, float]
"""Points [m], speed [m/s], laps, and length of one lap [m]."""


def straight(dice: random.Random) -> Shape:
    """Ahead."""
    speed = round(dice.uniform(0.15, 0.65), 2)
    length = max(0.5, speed * dice.uniform(2.0, 5.0))
    return [(length * part / 20, 0.0) for part in range(21)], speed, 1, length


def arc(dice: random.Random) -> Shape:
    """A bend with one radius."""
    speed = round(dice.uniform(0.15, 0.45), 2)
    length, radius = max(0.5, speed * dice.uniform(2.0, 5.0)), dice.choice((-1, 1)) * dice.uniform(3.0, 6.0)
    return sampled(lambda distance: 1.0 / radius, length), speed, 1, length


def circle(dice: random.Random) -> Shape:
    """Whole laps."""
    radius, speed, laps = dice.uniform(0.7, 0.8), round(dice.uniform(0.5, 0.6), 2), dice.choice((1, 1, 1, 1, 2))
    side, count = dice.choice((-1, 1)), 120
    turns = [math.tau * part / count for part in range(count)]
    points = [(radius * math.sin(turn), side * radius * (1.0 - math.cos(turn))) for turn in turns]
    return [*points, points[0]], speed, laps, math.tau * radius


def slalom(dice: random.Random) -> Shape:
    """Bends to both sides."""
    speed, wave, side = round(dice.uniform(0.15, 0.28), 2), dice.uniform(3.0, 4.0), dice.choice((-1, 1))
    length, width = max(0.6, speed * dice.uniform(3.0, 5.0)), dice.uniform(0.03, 0.08)
    strength = side * width * (math.tau / wave) ** 2
    return sampled(lambda distance: strength * math.sin(math.tau * distance / wave), length), speed, 1, length


def eight(dice: random.Random) -> Shape:
    """The middle of a figure eight: a bend, and one to the other side."""
    speed, side = round(dice.uniform(0.15, 0.28), 2), dice.choice((-1, 1))
    length = max(1.0, speed * 5.0)
    strength = side * dice.uniform(0.2, 0.4)
    return sampled(lambda distance: strength * math.sin(math.tau * distance / length), length), speed, 1, length


def sampled(curvature: Callable[[float], float], length: float) -> list[tuple[float, float]]:
    """Points of a path that begins at the origin, ahead."""
    x = y = heading = 0.0
    step, points = 0.02, [(0.0, 0.0)]
    for number in range(max(1, round(length / step))):
        heading += curvature((number + 0.5) * step) * step
        x, y = x + step * math.cos(heading), y + step * math.sin(heading)
        points.append((x, y))
    return points[::3]
