"""Simulated drives with hidden loads that follow a step as in a trial, without a bus: hundreds in a minute."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from artemis.commands.gains_auto import REPETITIONS, WORTH, Answer, Identified
from artemis.commands.gains_trial import Trial
from artemis.drive_schema import Drive
from artemis.mission.loading import load_model
from artemis.motion.arrays import Array
from artemis.motion.gain_tuning import Proposal, StepRecord
from artemis.motion.step_response import StepResponse
from artemis.report.responses import trace_of
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
NAMES = {"traction": "traction-left", "steering": "steer-left"}
CURRENT_NOISE = 20.0
"""Of one measured motor current, standard deviation [mA]."""
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

    def moved(
        self, gains: tuple[int, ...], sense: float = 1.0, dice: random.Random | None = None
    ) -> tuple[StepRecord, Array]:
        """What is recorded of a step one way, and the true velocity of the motor at the same times [rad/s].

        With `dice` no time is as the others: where on the ground the wheel is (load, friction), how the motor stands in
        its play and between two counts, noise of the current.
        """
        axis = ServoAxis(self.drive, self.load if dice is None else elsewhere(self.load, dice))
        axis.tune(gains, None)
        axis.output_current = float(self.drive.motor.output_current_ma)
        begin = 0.0
        if dice is not None:
            begin = axis.position = dice.uniform(-50.0, 50.0)
            axis._place_in_play = axis._play * dice.random()
        steering = self.drive.role == "steering"
        size = (math.radians(5.0) if steering else 0.2) * self.per_unit * sense
        ramp = 5.0 / ROBOT.limits.steering_rate_wheel_deg_s if steering else 0.2 / ROBOT.limits.acceleration_m_s2
        rows = []
        per_radian = self.drive.sensor.counts_per_turn / math.tau
        first = math.floor(begin + 0.5)
        for tick in range(round((REST + WATCH) / TICK)):
            told = size * min(1.0, max(0.0, (tick * TICK - REST) / ramp))
            counts = math.floor(axis.position + 0.5) - first
            noise = 0.0 if dice is None else dice.gauss(0.0, CURRENT_NOISE)
            rows.append((tick * TICK, told, counts / per_radian, 1e-3 * round(axis.current + noise), axis.velocity))
            if steering:
                axis.regulate(Regulation.POSITION, float(first + math.floor(told * per_radian + 0.5)))
            else:
                axis.acceleration = axis.deceleration = 1e9
                axis.regulate(Regulation.VELOCITY, float(round(told * 60.0 / math.tau)))
            axis.step(TICK)
        time, told_, position, current, velocity = np.array(rows).T
        return StepRecord(time=time, told=told_, position=position, current=current), velocity * math.tau / 60.0

    def answer(self, name: str, gains: tuple[int, ...], sense: float, dice: random.Random) -> tuple[Answer, Array]:
        """The same as the command reads it from a recording; with the true velocity of the motor [rad/s]."""
        record, velocity = self.moved(gains, sense, dice)
        sign = -1.0 if self.drive.mirrored else 1.0
        trace = trace_of(name, ROBOT, record.time, record.told / self.per_unit, record.position / self.per_unit)
        trace = replace(trace, current=sign * record.current)
        return Answer(trace=trace, response=trace.response()), velocity


def elsewhere(load: TrueLoad, dice: random.Random) -> TrueLoad:
    """The load on another piece of the ground, at another temperature."""
    return load.model_copy(
        update={
            "inertia_scale": load.inertia_scale * dice.uniform(0.95, 1.05),
            "friction_scale": load.friction_scale * dice.uniform(0.85, 1.15),
        }
    )


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
    """Largest true speed of the motor in the last half second with the new gains, against the set-point's, as a share
    of the rate at which that changed in the step."""


def tuned(machine: Machine, seed: int = 0) -> Tuned:
    """Identify, propose, try three times both ways, compare: by the loop of the command, without its bus."""
    drive, dice = machine.drive, random.Random(seed)
    name = NAMES[drive.role]
    robot = ROBOT.model_copy(update={"drives": {**ROBOT.drives, name: drive}})
    trial = Trial(
        drives=(name,), role=drive.role, side=drive.side, step=5.0 if drive.role == "steering" else 0.2, new=None
    )
    found = Identified(robot, trial)
    file, resting = drive.gain_numbers, [0.0]

    def answers(gains: tuple[int, ...], repetitions: int) -> list[Answer]:
        measured = [machine.answer(name, gains, sense, dice) for _ in range(repetitions) for sense in (1.0, -1.0)]
        steering, response = drive.role == "steering", measured[0][0].response
        told = 0.0 if steering else 0.2 * machine.per_unit
        rate = (math.radians(5.0) if steering else 0.2) * machine.per_unit / response.ramp
        resting[0] = max(float(np.max(np.abs(np.abs(velocity[-100:]) - told))) for _, velocity in measured) / rate
        return [answer for answer, _ in measured]

    def measured(proposal: Proposal) -> dict[str, list[Answer]]:
        place = found.place
        new = (*file[: place.start], *proposal.gains, *file[place.stop :])
        last.clear()
        last.update({"now": answers(file, REPETITIONS), "new": answers(new, REPETITIONS)})
        return last

    last: dict[str, list[Answer]] = {}
    first = answers(file, 1)
    found.identify(first)
    better = found.best(measured)
    now = [answer.response for answer in last.get("now", first)]
    if better is None:
        return Tuned(now=now, new=[], why=found.reason)
    new = [answer.response for answer in last["new"]]
    slowest = max(each.settled_5 or math.inf for each in new)
    quick = any(each.settled_5 is None for each in now) or slowest <= WORTH * min(each.settled_5 or 0.0 for each in now)
    return Tuned(now=now, new=new, why="" if quick else found.obstacle(new), resting=resting[0])
