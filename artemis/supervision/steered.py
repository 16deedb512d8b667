"""What a steered wheel does, against its set-point and its own sensors."""

from __future__ import annotations

from math import degrees, nan

from artemis.axles import AbsoluteEncoder, Potentiometers
from artemis.drive_states import DriveState
from artemis.motion.potentiometers import encoder_angle, is_at_a_rail, wheel_angles
from artemis.supervision.measures import Reading
from artemis.values import DriveFeedback, JobKind, JobResult
from artemis.vehicle import RobotFile

_NEVER = nan, nan
SLIPPED = 0.02
"""Smaller differences [rad] of the sensor of the wheel's angle and the motor's encoder are no reading."""


class SteeredWheelMonitor:
    """Remembers whether its drive knows the wheel's angle, and when its potentiometers changed last."""

    def __init__(self, robot: RobotFile, side: str, blind: bool) -> None:
        """`blind`: the calibration of the potentiometers means nothing."""
        self._name, drive = robot.drive_at("steering", side)
        self._output_current_ma = drive.motor.output_current_ma
        source = robot.angle_source(side)
        self._calibration = source if isinstance(source, Potentiometers) else None
        self._encoder = source if isinstance(source, AbsoluteEncoder) else None
        self._disagreement_deg = robot.calibration.steering.disagreement_deg
        self._blind = blind
        self._changes: list[tuple[float, float]] = []
        """What each potentiometer said when it changed last [V], and the wheel's angle then [rad]; once aligned."""

    @property
    def is_aligned(self) -> bool:
        """Whether the drive was told where the wheel stands."""
        return bool(self._changes)

    def learn(self, result: JobResult) -> None:
        """How a job of any drive ended."""
        if result.drive != self._name:
            return
        if result.kind is JobKind.REFERENCE and result.ok:
            self._changes = [_NEVER, _NEVER]
        elif result.kind is JobKind.CONFIGURE:
            self._changes = []

    def read(self, drive: DriveFeedback, target: float, turns: bool) -> list[Reading]:
        """Readings of this tick; `target`: its set-point [rad], which it `turns` to if it is switched on."""
        readings: list[Reading] = []
        error = abs(target - drive.position)
        if error > 0.02 and turns and drive.state is DriveState.OPERATION_ENABLE:
            readings.append(("STE-01", self._name, error, f"{degrees(error):.1f} degrees"))
        load = abs(drive.current) * 1000.0 / self._output_current_ma
        if load > 0.5:
            readings.append(("STE-02", self._name, load, f"{drive.current:+.2f} A"))
        if self._encoder is not None:
            away = abs(encoder_angle(drive.angle_sensor, self._encoder) - drive.position)
            return [*readings, self._slipped(away)] if away > SLIPPED and self._changes else readings
        if self._calibration is None:
            return readings
        if is_at_a_rail(drive.potentiometers, self._calibration.supply_v):
            readings.append(("STE-04", self._name, 1.0, "{:.2f} V and {:.2f} V".format(*drive.potentiometers)))
            return readings
        if not self._blind:
            self._potentiometers(drive, self._calibration, readings)
        if self._changes:
            self._frozen(drive, readings)
        return readings

    def _potentiometers(self, drive: DriveFeedback, calibration: Potentiometers, readings: list[Reading]) -> None:
        first, second = wheel_angles(drive.potentiometers, calibration)
        apart = degrees(abs(first - second)) / self._disagreement_deg
        if apart > 0.5:
            words = f"{degrees(first):.1f} and {degrees(second):.1f} degrees"
            readings.append(("STE-03", self._name, apart, words))
        away = abs((first + second) / 2.0 - drive.position)
        if away > SLIPPED and self._changes:
            readings.append(self._slipped(away))

    def _slipped(self, away: float) -> Reading:
        """The angle measured at the wheel is `away` [rad] from the one that the motor's encoder counts."""
        return "STE-05", self._name, away, f"{degrees(away):.1f} degrees"

    def _frozen(self, drive: DriveFeedback, readings: list[Reading]) -> None:
        position = drive.position
        for number, volt in enumerate(drive.potentiometers):
            seen, angle = self._changes[number]
            if volt != seen:
                self._changes[number] = volt, position
            elif (turned := abs(position - angle)) > 0.05:
                words = f"{volt:.2f} V over {degrees(turned):.0f} degrees"
                readings.append(("STE-07", self._name, turned, words))
