"""What a recording has on the battery: its voltage, and what the robot file says was taken meanwhile."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from artemis.battery import Battery
from artemis.errors import RecordingError
from artemis.motion.arrays import Array
from artemis.motion.charge import EVERY, forces_of, taken
from artemis.recording.mcap_reader import Recording
from artemis.recording.schemas import TickRecord
from artemis.vehicle import RobotFile

GAP = 1.0
"""A voltage that was not measured for so long [s] begins a new stretch: what was taken meanwhile nobody knows."""
LEAST = 24
"""Means of voltage in a stretch, at least: two minutes."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BatteryLog:
    """A stretch of a run in means over `EVERY`, all shape (n,); power as the robot file says it."""

    name: str
    seconds: Array
    volts: Array
    """Mean [V]."""
    idle: Array
    """Charge that `idle_w` took [As]."""
    drive: Array
    """That the driven wheels took [As]."""
    metres: Array
    """Driven."""
    idle_joules: Array
    """Energy while the robot drove [J]."""
    drive_joules: Array


def battery_logs(recording: Recording, name: str) -> list[BatteryLog]:
    """All stretches of a run that are long enough.

    Raises:
        RecordingError: damaged, or there is none.
    """
    robot = recording.robot
    battery = robot.battery
    if battery is None:
        raise RecordingError(f"{recording.path}: recorded of a robot whose file describes no battery")
    logs = [_log(rows, name) for rows in _stretches(recording.ticks(), robot, battery) if len(rows) >= LEAST]
    if not logs:
        raise RecordingError(f"{recording.path}: its supply voltage was not measured for two minutes on end")
    return logs


def _stretches(ticks: Iterable[TickRecord], robot: RobotFile, battery: Battery) -> list[list[list[float]]]:
    """Rows of sums over `EVERY`, in the order of the columns of `BatteryLog`."""
    forces = forces_of(robot, battery)
    found: list[list[list[float]]] = [[]]
    sums, last, driven = [0.0] * 7, None, 0.0
    for tick in ticks:
        sensed = tick.snapshot.sensed
        if sensed.urgent or sensed.battery_v is None:
            continue
        dt = 0.0 if last is None else sensed.time - last
        rolled = max(tick.snapshot.odometry.driven - driven, 0.0)
        if last is None or dt > GAP:
            found.append([])
            sums, dt, rolled = [0.0] * 7, 0.0, 0.0
        last, driven = sensed.time, tick.snapshot.odometry.driven
        volts, watts = max(sensed.battery_v, 1.0), taken(sensed.drives, forces)
        moving = 1.0 if rolled > 0.0 else 0.0
        new = (
            dt,
            volts * dt,
            battery.idle_w * dt / volts,
            watts * dt / volts,
            rolled,
            moving * battery.idle_w * dt,
            moving * watts * dt,
        )
        sums = [before + more for before, more in zip(sums, new, strict=True)]
        if sums[0] >= EVERY:
            found[-1].append(sums)
            sums = [0.0] * 7
    return found


def _log(rows: list[list[float]], name: str) -> BatteryLog:
    seconds, volts, idle, drive, metres, idle_joules, drive_joules = np.array(rows).T
    return BatteryLog(
        name=name,
        seconds=seconds,
        volts=volts / seconds,
        idle=idle,
        drive=drive,
        metres=metres,
        idle_joules=idle_joules,
        drive_joules=drive_joules,
    )
