"""The vehicle as traction and steering nodes on one CAN bus: feedback in, goals and set-points out."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from artemis.devices.bus_gateway import BusGateway
from artemis.devices.can_bus import FrameBus
from artemis.devices.canopen import EMERGENCY, HEARTBEAT, SDO_ANSWER, SYNC_FRAME, TXPDO, heartbeat_frame
from artemis.devices.device import Readings, Report, Work
from artemis.devices.epos import EposDrive
from artemis.devices.epos_jobs import EposJobs
from artemis.devices.epos_objects import PERIOD
from artemis.devices.epos_state import Controlword, controlword
from artemis.devices.temperature import temperature_readers
from artemis.drive_states import Nmt
from artemis.errors import DeviceLost
from artemis.values import Job, JobResult, Tick
from artemis.vehicle import RobotFile

_QUICK_STOP = Controlword.QUICK_STOP


class Drives:
    """The drives of a robot on a CAN bus: its `Actuators`. Heartbeat, SYNC every `period` [s], PDOs: nobody else's."""

    def __init__(self, robot: RobotFile, bus: FrameBus, period: float = PERIOD) -> None:
        self.drives = tuple(robot.drives)
        self.wire = BusGateway(robot, bus)
        self.nodes = [EposDrive(name, robot, self.wire, period) for name in robot.drives]
        self._jobs = {node.name: EposJobs(node) for node in self.nodes}
        self._heartbeat = heartbeat_frame(robot.host_node_id, Nmt.OPERATIONAL)
        for node in self.nodes:
            self.wire.handlers[TXPDO[0] + node.node_id] = node, node.on_status
            self.wire.handlers[TXPDO[1] + node.node_id] = node, node.on_details
            self.wire.handlers[EMERGENCY + node.node_id] = node, node.on_emergency
            self.wire.handlers[HEARTBEAT + node.node_id] = node, node.on_heartbeat
            self.wire.handlers[SDO_ANSWER + node.node_id] = node, node.sdo.receive

    def begin(self, start: float, wake: Callable[[], None], report: Report) -> list[Work]:
        """Listen between ticks: answers go to their jobs."""
        self.wire.listen(wake, report)
        return temperature_readers(self.nodes, self.wire)

    def sense(self, now: float) -> Readings:
        """What each drive last said, and how the bus was, at loop time `now` [s]."""
        self.wire.look()
        return Readings(drives=tuple([node.feedback(now) for node in self.nodes]), bus=self.wire.health())

    def write(self, tick: Tick) -> None:
        """Goals and set-points of a tick; last of all the heartbeat that keeps the drives running.

        An urgent tick sends stop frames only.
        """
        try:
            self._write(tick)
        except DeviceLost as error:
            self.wire.lose(error)

    def _write(self, tick: Tick) -> None:
        wish, urgent, send = tick.wish, tick.snapshot.sensed.urgent, self.wire.send
        self.wire.begin(tick.mode, judged=wish.exchange and wish.supervised)
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

    def close(self) -> None:
        """Close the bus."""
        self.wire.close()

    def stop(self) -> None:
        """Last resort, when the program itself fails: quick stop for every drive, at once."""
        for node in self.nodes:
            with suppress(DeviceLost):  # the others may still be reached; without us the drives stop by themselves
                self.wire.send(node.stop_frame())

    async def perform(self, job: Job) -> JobResult:
        """Do a job beside the ticks; a device that fails is a result, not an exception."""
        return await self._jobs[job.drive].result(job)
