"""The process data of one drive: SI at the wheel outside, drive units on the wire, in the layout of its family."""

from __future__ import annotations

from math import inf
from operator import attrgetter

from artemis.devices.bus_gateway import BusGateway
from artemis.devices.can_bus import Frame
from artemis.devices.canopen import RXPDO, emergency_from_data, is_boot_up, nmt_from_heartbeat
from artemis.devices.epos_objects import JITTER, PERIOD, UNREADABLE, PdoPlaces, Units, wrapped
from artemis.devices.epos_state import Controlword
from artemis.devices.tally import NOTHING, Tally
from artemis.drive_states import DriveState, Nmt
from artemis.values import DriveFeedback
from artemis.vehicle import RobotFile


class EposDrive:
    """A drive as the robot file describes it, on the bus behind `wire`, with SYNC every `period` [s]."""

    def __init__(self, name: str, robot: RobotFile, wire: BusGateway, period: float = PERIOD) -> None:
        self.name, self.robot, self.drive, self.period = name, robot, robot.drives[name], period
        self.node_id = self.drive.node_id
        self.is_traction = self.drive.role == "traction"
        self.own_set_point = attrgetter(self.drive.set_point)
        """Its part of all set-points: rolling speed [m/s] or wheel angle [rad]."""
        self.sdo = wire.objects(name, self.node_id)
        self.send = wire.send
        self.units, self.family = Units(robot, self.drive), self.drive.tables
        self._pdos = PdoPlaces(robot, self.drive)
        self._counts: int | None = None
        self._position = self._velocity = self._current = 0.0
        self._statusword = self._mode = self._jumps = self._stray = self._frames = 0
        self.state = DriveState.UNKNOWN
        """By the newest statusword."""
        self._volts, self._angle_sensor = (0.0, 0.0), 0
        self.status_time: float | None = None
        self._details_time: float | None = None
        self.temperature = 0.0, -inf  # of its power stage [°C], and until when that counts
        self._nmt: Nmt | None = None
        self._heard: float | None = None
        self.tally = Tally()
        self.boots = self.last_controlword = 0  # boot-up frames heard so far; what was last sent

    def on_status(self, frame: Frame) -> None:
        """TxPDO 1: statusword and position. What is older than the last one, or no motion could reach, is dropped."""
        values = self._pdos.status.unpack(frame.data)
        statusword, counts = values[0], values[1]
        last = self.status_time
        elapsed = inf if last is None else frame.time - last
        if elapsed < 0.0:
            self.tally.disordered += 1
            return
        self._frames += 1
        self._mode = values[2] if self._pdos.early_mode else self._mode
        if statusword != self._statusword or last is None:
            self._statusword, self.state = statusword, self.family.state(statusword)
        rolled = 0 if self._counts is None else wrapped(counts - self._counts)
        if last is None:
            rolled = min(rolled, counts, key=abs)  # not heard since it was configured: it counted on, or from zero
        moved = rolled / self.units.counts
        if abs(moved) > self.units.fastest * (elapsed + JITTER):  # no motor passes that, even where the bus delays
            self._jumps += 1
            return
        if elapsed > 0.0 and not self.is_traction:
            self._velocity = moved / elapsed
        self._position += moved
        self._counts, self.status_time, self._jumps = counts, frame.time, 0

    def on_details(self, frame: Frame) -> None:
        """TxPDO 2: velocity (traction) or what measures the angle (steering), and what else the family's layout has."""
        if self._details_time is not None and frame.time < self._details_time:
            self.tally.disordered += 1
            return
        values, at = self._pdos.details.unpack(frame.data), self._pdos
        if at.analog >= 0:
            self._volts = (values[at.analog] / at.per_volt, values[at.analog + 1] / at.per_volt)
        self._angle_sensor = values[at.angle_sensor] if at.angle_sensor >= 0 else 0
        self._velocity = values[at.velocity] / self.units.velocity if at.velocity >= 0 else self._velocity
        self._current = values[at.current] / at.per_ampere if at.current >= 0 else self._current
        self._mode = values[at.mode] if at.mode >= 0 else self._mode
        self._details_time = frame.time

    def on_emergency(self, frame: Frame) -> None:
        """EMCY: kept until the next tick takes it."""
        self.tally.emergencies.append(emergency_from_data(frame.data).code if len(frame.data) == 8 else UNREADABLE)

    def on_heartbeat(self, frame: Frame) -> None:
        """Heartbeat or boot-up."""
        before, self._nmt = self._nmt, nmt_from_heartbeat(frame.data)
        booted = is_boot_up(before, self._nmt, inf if self._heard is None else frame.time - self._heard)
        self.boots += booted
        self.tally.boots += booted
        self._heard = frame.time

    def feedback(self, now: float) -> DriveFeedback:
        """What the drive last said, with its age; takes the tally with it."""
        status, details = self.status_time, self._details_time
        frames, self._frames = self._frames, 0
        stray, self._stray = self.sdo.late_answers - self._stray, self.sdo.late_answers
        feedback = DriveFeedback(
            name=self.name,
            state=self.state,
            statusword=self._statusword,
            position=self._position,
            velocity=self._velocity,
            current=self._current,
            mode=self._mode,
            potentiometers=self._volts,
            angle_sensor=self._angle_sensor,
            age=None if status is None or details is None else now - min(status, details),
            nmt=self._nmt,
            heartbeat_age=None if self._heard is None else now - self._heard,
            frames=frames,
            temperature_c=self.temperature[0] if now < self.temperature[1] else None,
        )
        if self.tally == NOTHING and not self._jumps and not stray:
            return feedback  # one call with more than 15 keywords would take four times as long
        tally, self.tally = self.tally, Tally()
        return tally.added_to(feedback, self._jumps, stray)

    def set_point_frame(self, controlword: int, value: float) -> Frame:
        """RxPDO 1: controlword and set-point (m/s, or wheel angle in rad), taken over at SYNC."""
        self.last_controlword = controlword
        if self.is_traction:
            raw = round(value * self.units.velocity)
        else:
            raw = wrapped((self._counts or 0) + round((value - self._position) * self.units.counts))
        return Frame(RXPDO[0] + self.node_id, self._pdos.set_point.pack(controlword, raw))

    def stop_frame(self, controlword: int = Controlword.QUICK_STOP) -> Frame:
        """RxPDO 2: controlword alone, acts at once."""
        self.last_controlword = controlword
        return Frame(RXPDO[1] + self.node_id, self._pdos.stop.pack(controlword))

    def restart(self) -> None:
        """The drive's counter may begin anew, at zero."""
        self.status_time, self._details_time, self._jumps = None, None, 0

    def rebase(self, position: float, counts: int) -> None:
        """`counts` stands for `position` from now on."""
        self._position, self._counts = position, counts
