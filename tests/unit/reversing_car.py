"""A car whose pose is known exactly, driven by mode follow's parts through the gate: what tests of reversing share."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path as FilePath

import numpy as np
from core_builders import PERIOD, ROBOT, snapshot

from artemis.motion.limits import Gate
from artemis.motion.odometry import move
from artemis.motion.path import Path, path_from_points
from artemis.motion.route import Part, Route
from artemis.planning import made
from artemis.plugins.contracts import Follower, Following, PluginContext
from artemis.plugins.registry import FOLLOWERS, load
from artemis.states.parts import PartByPart
from artemis.values import Odometry, Pose, SetPoints, Snapshot


def follower(name: str = "indiveri", speed: float = 0.3) -> Follower:
    """A built-in one."""
    plugin = load(FOLLOWERS, name)
    context = PluginContext(name=name, robot=ROBOT, folder=FilePath())
    new: Follower = made(plugin, plugin.Config.model_validate({"speed_m_s": speed}), context)
    return new


@dataclass
class Car:
    """Does what left the gate one tick ago."""

    pose: Pose = field(default_factory=Pose)
    points: SetPoints = field(default_factory=SetPoints)
    rolls: SetPoints = field(default_factory=SetPoints)
    distance: float = 0.0
    ticks: int = 0

    def snapshot(self) -> Snapshot:
        odometry = Odometry(
            pose=self.pose, speed=self.rolls.speed, steering=self.rolls.steering, distance=self.distance
        )
        stands = self.rolls.speed == 0.0 and self.points.speed == 0.0
        return snapshot(self.ticks * PERIOD, standing=stands, set_points=self.points, odometry=odometry)

    def obey(self, following: Following) -> None:
        """One tick passes."""
        self.rolls, self.points = self.points, GATE.limit(following.command, self.points, PERIOD)
        distance, angle = self.rolls.speed * PERIOD, self.rolls.steering
        self.distance += distance * math.cos(angle)
        self.pose = move(self.pose, distance * math.cos(angle), distance * math.sin(angle) / ROBOT.geometry.wheelbase_m)
        self.ticks += 1


GATE = Gate(ROBOT, PERIOD)


def drive(driver: PartByPart, car: Car, *, longest: float = 120.0) -> list[tuple[Snapshot, Following]]:
    """To the end of the route, and to standstill."""
    steps: list[tuple[Snapshot, Following]] = []
    while not (steps and steps[-1][1].finished and steps[-1][0].standing):
        assert len(steps) * PERIOD < longest, f"not finished: {steps[-1]}"
        seen = car.snapshot()
        following = driver.step(seen)
        assert isinstance(following, Following), following
        steps.append((seen, following))
        car.obey(following)
    return steps


def bend(turn: float, radius: float, begin: Pose, *, backward: bool = False) -> Path:
    """An arc of the rear axle that turns the robot by `turn` [rad] from `begin` on."""
    distance = (-1 if backward else 1) * abs(turn) * radius
    poses = [move(begin, distance * share, turn * share) for share in np.linspace(0.0, 1.0, 21).tolist()]
    return path_from_points(np.array([p.x for p in poses]), np.array([p.y for p in poses]), between_halts=True)


def three_point_turn() -> Route:
    """Arcs of 60 degrees to the left: forwards, backwards, forwards."""
    pose, parts = Pose(), []
    for backward in (False, True, False):
        parts.append(Part(path=bend(math.pi / 3, 0.7, pose, backward=backward), backward=backward))
        pose = move(pose, (-1 if backward else 1) * math.pi / 3 * 0.7, math.pi / 3)
    return Route(tuple(parts))


def straight(length: float, *, backward: bool = False) -> Route:
    """Along x, or with the rear ahead against it."""
    x = np.linspace(0.0, -length if backward else length, 21)
    return Route((Part(path=path_from_points(x, 0 * x), backward=backward),))
