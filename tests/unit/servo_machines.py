"""Simulated drives with hidden loads that follow a step as in a trial, without a bus: hundreds in a minute."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from artemis.drive_schema import Drive
from artemis.mission.loading import load_model
from artemis.motion.gain_tuning import (
    ControlLoop,
    MovedLoad,
    StepRecord,
    followed,
    identified,
    in_order,
    loop_of,
    obstacle,
    proposals,
)
from artemis.motion.spline import Array
from artemis.motion.step_response import SWING, StepResponse, compared, quickness, reversals, slope, step_response
from artemis.sim.axis import Regulation
from artemis.sim.servo import ServoAxis, TrueLoad
from artemis.vehicle import RobotFile

ROBOTS = {
    family: load_model(Path(__file__).parents[2] / "missions" / "robots" / name, RobotFile)
    for family, name in (("epos1", "artemis.yaml"), ("epos4", "artemis_epos4.yaml"))
}
ROBOT = ROBOTS["epos1"]
"""The two differ in their drives alone."""
DRIVES = {"traction": ROBOT.drives["traction-left"], "steering": ROBOT.drives["steer-left"]}
DRIVES_4 = {"traction": ROBOTS["epos4"].drives["traction-left"], "steering": ROBOTS["epos4"].drives["steer-left"]}
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


def machine(seed: int, role: str, drives: Mapping[str, Drive] = DRIVES) -> Machine:
    """One with a load that is not the nominal one."""
    dice = random.Random(f"{role} {seed}")
    steering = role == "steering"
    return Machine(
        drives[role],
        TrueLoad(
            inertia_scale=math.exp(dice.uniform(0.0, math.log(8.0)) if steering else dice.uniform(-0.7, 1.1)),
            friction_scale=dice.uniform(0.4, 2.0),
            play_deg=dice.uniform(0.0, 0.2) if steering else dice.uniform(0.0, 0.4),
            rotor_share=dice.uniform(0.5, 0.9) if steering else dice.uniform(0.3, 0.7),
            delay_ms=dice.uniform(0.0, 1.5) if steering else dice.uniform(0.0, 8.0),
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuned:
    """What became of a machine."""

    now: list[StepResponse]
    new: list[StepResponse]
    """With the gains that are kept; empty: those of the robot file are kept."""
    why: str
    """It does not settle within 60 % of the time, because of this; empty: it does."""
    resting: float = 0.0
    """Largest true speed of the motor in the last half second with the new gains, against the set-point's [rad/s]."""


def tuned(machine: Machine) -> Tuned:
    """Identify, propose, try three times both ways, compare: as the command does it."""
    steering = machine.drive.role == "steering"
    file, scale = machine.drive.gain_numbers, machine.drive.tables.gain_scale
    assert scale is not None
    place = slice(4, 7) if steering else slice(2, 4)
    present = file[place]

    def response(record: StepRecord) -> StepResponse:
        value = record.position if steering else slope(record.time, record.position, 0.06)
        return step_response(record.time, record.told, value, record.current, 0.0 if steering else 0.03)

    def swings(record: StepRecord) -> int:
        shown, value = response(record), record.position if steering else slope(record.time, record.position, 0.06)
        rest = record.time - shown.begin >= shown.ramp
        return reversals((record.told - value)[rest], SWING * abs(shown.step))

    before = [machine.moved(file, sense)[0] for sense in (1.0, -1.0)]
    now = [response(record) for record in before]
    motor = machine.drive.motor
    loop = loop_of(present, scale, 1e-3 * motor.output_current_ma, 0.9 * motor.max_speed_rpm * math.tau / 60.0)
    load = identified(before[:1], loop)

    def settled(load: MovedLoad, loop: ControlLoop) -> float | None:
        position, current = followed(load, loop, before[0].time, before[0].told)
        return quickness(response(replace(before[0], position=position, current=current)))

    found = proposals([load], [10 * gain for gain in present], scale, loop, settled)
    for proposal in in_order(found, [now[0].settled_5]):
        gains = (*file[: place.start], *proposal.gains, *file[place.stop :])
        after = [machine.moved(gains, sense) for sense in (1.0, -1.0, 1.0, -1.0, 1.0, -1.0)]
        new = [response(record) for record, _ in after]
        if not compared(now, new, [swings(record) for record, _ in after]):
            slowest = max(each.settled_5 or 0.0 for each in new)
            quick = any(each.settled_5 is None or slowest <= 0.6 * each.settled_5 for each in now)
            told = 0.0 if steering else after[0][0].told[-1]
            resting = max(float(np.max(np.abs(np.abs(velocity[-100:]) - told))) for _, velocity in after)
            why = "" if quick else obstacle(new[0], slowest, loop.limit)
            return Tuned(now=now, new=new, why=why, resting=resting)
    return Tuned(now=now, new=[], why=obstacle(now[0], now[0].settled_5 or math.inf, loop.limit))
