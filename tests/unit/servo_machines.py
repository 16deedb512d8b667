"""Simulated drives with hidden loads that follow a step as in a trial, without a bus: hundreds in a minute."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from artemis.mission.loading import load_model
from artemis.motion.gain_tuning import StepRecord
from artemis.motion.spline import Array
from artemis.sim.axis import Regulation
from artemis.sim.servo import ServoAxis, TrueLoad
from artemis.vehicle import Drive, RobotFile

ROBOT = load_model(Path(__file__).parents[2] / "missions" / "robots" / "artemis.yaml", RobotFile)
DRIVES = {"traction": ROBOT.drives["traction-left"], "steering": ROBOT.drives["steer-left"]}
TICK = 0.005
REST, WATCH = 0.1, 2.4
"""Before the step, and from its beginning on [s]."""


@dataclass(frozen=True, slots=True)
class Machine:
    """One drive and what it truly moves."""

    drive: Drive
    load: TrueLoad

    @property
    def per_unit(self) -> float:
        """Radians of the motor per metre of a driven wheel, per radian of a steered one."""
        if self.drive.role == "steering":
            return self.drive.gear_ratio
        return math.tau / (self.drive.sensor.counts_per_turn * ROBOT.metres_per_count(self.drive.side))

    def moved(self, gains: tuple[int, ...], sense: float = 1.0) -> tuple[StepRecord, Array]:
        """What is recorded of a step one way, and the true velocity of the motor at the same times [rad/s]."""
        axis = ServoAxis(self.drive, self.load)
        axis.tune(gains, None)
        axis.output_current = float(self.drive.motor.output_current_ma)
        steering = self.drive.role == "steering"
        size = (math.radians(5.0) if steering else 0.2) * self.per_unit * sense
        ramp = 5.0 / ROBOT.limits.steering_rate_wheel_deg_s if steering else 0.2 / ROBOT.limits.acceleration_m_s2
        rows = []
        per_radian = self.drive.sensor.counts_per_turn / math.tau
        for tick in range(round((REST + WATCH) / TICK)):
            told = size * min(1.0, max(0.0, (tick * TICK - REST) / ramp))
            counts = math.floor(axis.position + 0.5)
            rows.append((tick * TICK, told, counts / per_radian, 1e-3 * round(axis.current), axis.velocity))
            if steering:
                axis.regulate(Regulation.POSITION, float(math.floor(told * per_radian + 0.5)))
            else:
                axis.acceleration = axis.deceleration = 1e9
                axis.regulate(Regulation.VELOCITY, float(round(told * 60.0 / math.tau)))
            axis.step(TICK)
        time, told_, position, current, velocity = np.array(rows).T
        return StepRecord(time=time, told=told_, position=position, current=current), velocity * math.tau / 60.0


def machine(seed: int, role: str) -> Machine:
    """One with a load that is not the nominal one."""
    dice = random.Random(f"{role} {seed}")
    steering = role == "steering"
    return Machine(
        DRIVES[role],
        TrueLoad(
            inertia_scale=math.exp(dice.uniform(0.0, math.log(8.0)) if steering else dice.uniform(-0.7, 1.1)),
            friction_scale=dice.uniform(0.4, 2.0),
            play_deg=dice.uniform(0.0, 0.2) if steering else dice.uniform(0.0, 0.4),
            rotor_share=dice.uniform(0.5, 0.9) if steering else dice.uniform(0.3, 0.7),
            delay_ms=dice.uniform(0.0, 1.5) if steering else dice.uniform(0.0, 8.0),
        ),
    )
