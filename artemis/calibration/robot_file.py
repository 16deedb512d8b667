"""What a fit changes in a robot file."""

from __future__ import annotations

from math import degrees

from artemis.axles import AbsoluteEncoder, HardStop, HomeSwitch, Potentiometers
from artemis.calibration.kinematics import Kinematics
from artemis.motion.steering_fit import moved
from artemis.vehicle import RobotFile
from artemis.yaml_file import Data

DIGITS = 7
"""Of the numbers that are written."""


def changes(robot: RobotFile, machine: Kinematics) -> dict[tuple[str, ...], Data]:
    """New values of a robot file by their keys; only what differs.

    Args:
        robot: The file's content, which the runs were counted with.
        machine: What was fitted.

    A wheel that counts `zero` when it is straight has its potentiometers' zero there: the voltages that they show at
    that angle; an absolute encoder likewise. A hard stop or a switch is so much nearer or farther. What a hand sets
    straight is set anew at each start: nothing is written of it.
    """
    found: dict[tuple[str, ...], Data] = {}

    def put(keys: tuple[str, ...], old: float, new: float) -> None:
        if _rounded(new) != _rounded(old):
            found[keys] = _rounded(new)

    lengths = {"left": machine.distance_left, "right": machine.distance_right, "middle": machine.distance_left}
    zeros = {"left": machine.zero_left, "right": machine.zero_right, "middle": machine.zero_left}
    scales = {"left": machine.scale_left, "right": machine.scale_right, "middle": machine.scale_left}
    for side in robot.sides("traction"):
        old = robot.metres_per_count(side)
        put(("calibration", "traction", f"{side}_m_per_count"), old, old * lengths[side])
    for side in robot.sides("steering"):
        wheel = robot.angle_source(side)
        if isinstance(wheel, HardStop | HomeSwitch | AbsoluteEncoder):
            zero = moved(wheel, zeros[side])
            put(("calibration", "steering", side, zero.key), zero.before, zero.after)
        elif isinstance(wheel, Potentiometers):
            pairs = zip(wheel.zero_v, wheel.slope_deg_per_v, strict=True)
            volts = [_rounded(zero + degrees(zeros[side]) / slope) for zero, slope in pairs]
            if volts != [_rounded(zero) for zero in wheel.zero_v]:
                found["calibration", "steering", side, "zero_v"] = list(volts)
        put(("calibration", "steering", side, "scale"), wheel.scale, wheel.scale * scales[side])
    geometry = robot.geometry
    put(("geometry", "wheelbase_m"), geometry.wheelbase_m, machine.wheelbase)
    put(("geometry", "track_m"), geometry.track_m, machine.track)
    put(("geometry", "scrub_radius_m"), geometry.scrub_radius_m, machine.scrub_radius)
    return found


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
