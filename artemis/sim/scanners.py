"""The laser scanners of a simulated robot."""

from __future__ import annotations

import random
from dataclasses import dataclass

from artemis.sim.grid import MapGrid
from artemis.sim.laser import Laser
from artemis.sim.lms100 import Lms100
from artemis.sim.scenery import HALL, Scenery, Surroundings2D
from artemis.sim.world import World
from artemis.vehicle import RobotFile

DRIFT = 50e-6
"""The clock of a device differs by at most this share; an assumption."""


@dataclass(frozen=True, slots=True)
class SimScanner:
    """One of them: what measures, and what talks about it."""

    laser: Laser
    device: Lms100


def mount_scanners(
    robot: RobotFile, world: World, scenery: Scenery | None, grid: MapGrid | None, *, seed: int, start: float
) -> None:
    """Put those of the robot file into its world, powered on now; they see `scenery`, or a hall.

    Args:
        robot: Where they sit.
        world: Whose robot carries them.
        scenery: Around the robot.
        grid: What the scenery's map file holds.
        seed: Of all that is random.
        start: The world's time at which run time is 0 [s].
    """
    around = Surroundings2D(scenery or HALL, grid)
    for number, (name, mounting) in enumerate(robot.scanners.items()):
        dice = random.Random(seed * 1000 + number)
        laser = Laser(world, world.mounting(name, mounting), around, seed=dice.getrandbits(32), start=start)
        device = Lms100(laser.look, drift=dice.uniform(-DRIFT, DRIFT), first_us=dice.getrandbits(32))
        world.scanners[name] = SimScanner(laser, device)
