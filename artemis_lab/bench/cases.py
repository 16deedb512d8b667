"""What the followers are measured in: one column of the table each."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from artemis.vehicle import RobotFile
from artemis_lab.bench.plant import Conditions, bicycle

RATE = 38.0
"""Steering rate of the virtual wheel in all cases that name none [deg/s]."""
IDEAL = Conditions()
NOISE = Conditions(position_noise=0.005, heading_noise=math.radians(0.25), steering_zero=math.radians(1.0))
CLEAN, NOISY = "clean", "noise"


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """Conditions, and the robot in them. Its file says what it can: followers know the rate, and not the rest."""

    conditions: Conditions = IDEAL
    steering_rate_deg_s: float | None = RATE
    """Of the virtual wheel; None: the robot as its file says, each wheel within its own rate."""

    def robot(self, robot: RobotFile) -> RobotFile:
        """The robot of this case."""
        return robot if self.steering_rate_deg_s is None else bicycle(robot, self.steering_rate_deg_s)


CASES: dict[str, Case] = {
    CLEAN: Case(),
    NOISY: Case(conditions=NOISE),
    "33 deg/s": Case(steering_rate_deg_s=33.0),
    "33 deg/s, noise": Case(conditions=NOISE, steering_rate_deg_s=33.0),
    "29 deg/s": Case(steering_rate_deg_s=29.0),
    "29 deg/s, noise": Case(conditions=NOISE, steering_rate_deg_s=29.0),
    "each wheel": Case(steering_rate_deg_s=None),
    "delay 0 ms": Case(conditions=Conditions(delay=0.0)),
    "delay 66 ms": Case(conditions=Conditions(delay=2.0)),
    "delay 100 ms": Case(conditions=Conditions(delay=3.0)),
    "wheels +1 %": Case(conditions=Conditions(wheel_scale=1.01)),
    "slip 3 %": Case(conditions=Conditions(slip=0.03)),
    "backward": Case(conditions=Conditions(backward=True)),
}
"""By the names of their columns. `clean` has the delay of one period, 33 ms, as all others that name none."""


def random_case(seed: int) -> Case:
    """A start from rest up to 1 m off and 60 degrees askew, 29 to 38 deg/s, 0 to 100 ms of delay, half with noise."""
    dice = np.random.default_rng([seed, 1])
    noise = NOISE if dice.uniform() < 0.5 else IDEAL
    return Case(
        conditions=Conditions(
            delay=dice.uniform(0.0, 3.0),
            position_noise=noise.position_noise,
            heading_noise=noise.heading_noise,
            steering_zero=noise.steering_zero,
            start_speed=0.0,
            start_offset=dice.uniform(-1.0, 1.0),
            start_heading=math.radians(dice.uniform(-60.0, 60.0)),
        ),
        steering_rate_deg_s=dice.uniform(29.0, 38.0),
    )
