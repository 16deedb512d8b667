"""The vehicle as traction and steering nodes on one bus: feedback in, goals and set-points out."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from artemis.devices.bus_gateway import BusGateway
from artemis.devices.can_bus import Frame, FrameBus
from artemis.devices.canopen import EMERGENCY, HEARTBEAT, SDO_ANSWER, SYNC_FRAME, TXPDO, heartbeat_frame
from artemis.devices.epos import EposDrive
from artemis.devices.epos_jobs import EposJobs, fault_of
from artemis.devices.epos_state import Controlword, controlword
from artemis.drive_states import Nmt
from artemis.errors import DeviceError, DeviceLost, ProtocolError
from artemis.values import DriveFeedback, Job, JobResult, Tick
from artemis.vehicle import RobotFile

_QUICK_STOP = Controlword.QUICK_STOP


class Drives:
    """All drives of a robot."""

    def __init__(self, robot: RobotFile, bus: FrameBus) -> None:
        self.wire = BusGateway(robot, bus)
        self.nodes = [EposDrive(name, robot, self.wire.send) for name in robot.drives]
        self._jobs = {node.name: EposJobs(node) for node in self.nodes}
        self._heartbeat = heartbeat_frame(robot.host_node_id, Nmt.OPERATIONAL)
        self._handlers: dict[int, tuple[EposDrive, Callable[[Frame], None]]] = {}
        for node in self.nodes:
            self._handlers[TXPDO[0] + node.node_id] = node, node.on_status
            self._handlers[TXPDO[1] + node.node_id] = node, node.on_details
            self._handlers[EMERGENCY + node.node_id] = node, node.on_emergency
            self._handlers[HEARTBEAT + node.node_id] = node, node.on_heartbeat
            self._handlers[SDO_ANSWER + node.node_id] = node, node.sdo.receive

    def receive(self) -> bool:
        """Hand every waiting frame to its node; whether one of them was a drive's emergency (not "errors gone").

        Raises:
            DeviceLost: the adapter is gone.
        """
        urgent = False
        for frame in self.wire.receive():
            known = self._handlers.get(frame.id)
            if known is not None and not frame.rtr:
                node, handler = known
                try:
                    handler(frame)
                except ProtocolError:
                    node.tally.malformed += 1
                urgent = urgent or (EMERGENCY < frame.id < EMERGENCY + 0x80 and frame.data[:2] != b"\0\0")
        return urgent

    def feedback(self, now: float) -> tuple[DriveFeedback, ...]:
        """What each drive last said, at loop time `now` [s]."""
        return tuple([node.feedback(now) for node in self.nodes])

    def write(self, tick: Tick) -> None:
        """Goals and set-points of a tick; last of all the heartbeat that keeps the drives running.

        An urgent tick sends stop frames only.

        Raises:
            DeviceLost: the adapter is gone.
        """
        wish, urgent, send = tick.wish, tick.snapshot.sensed.urgent, self.wire.send
        self.wire.begin(tick.mode)
        if wish.exchange:
            words = []
            for node in self.nodes:  # stops first, both sides together
                goal = wish.traction if node.is_traction else wish.steering
                words.append(word := controlword(node.state, goal, node.last_controlword))
                if word == _QUICK_STOP != node.last_controlword:
                    send(node.stop_frame(word))
            if not urgent:
                for node, word in zip(self.nodes, words, strict=True):
                    send(node.set_point_frame(word, node.own_set_point(tick.set_points)))
                send(SYNC_FRAME)
        if wish.heartbeat and not urgent:
            send(self._heartbeat)

    def stop(self) -> None:
        """Last resort, when the program itself fails: quick stop for every drive, at once."""
        for node in self.nodes:
            with suppress(DeviceLost):  # the others may still be reached; without us the drives stop by themselves
                self.wire.send(node.stop_frame())

    async def perform(self, job: Job) -> JobResult:
        """Do a job beside the ticks; a device that fails is a result, not an exception."""
        try:
            values = await self._jobs[job.drive].perform(job)
        except DeviceError as error:
            fault = fault_of(error)
            return JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=False, detail=error.problem, fault=fault)
        return JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=True, values=values)
