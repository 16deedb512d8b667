"""What a robot needs of its hardware, whatever kind that is and whatever it hangs on; and several of them as one."""

from __future__ import annotations

from collections.abc import Callable, Collection, Coroutine, Sequence
from contextlib import ExitStack
from typing import Any, Protocol

from msgspec import Struct

from artemis.scan import Scan
from artemis.values import BusHealth, DriveFeedback, Job, JobResult, Tick

Report = Callable[[str, str, str], None]
"""Takes a row of the fault table, the device and what was seen. Within one tick the same counts once."""
Work = Coroutine[Any, Any, None]


class Readings(Struct, frozen=True, kw_only=True, gc=False):
    """What devices put into the `Sensed` of one tick; for what each part means see there."""

    drives: tuple[DriveFeedback, ...] = ()
    bus: BusHealth = BusHealth()
    scans: tuple[Scan, ...] = ()
    battery_v: float | None = None


class Device(Protocol):
    """Hardware that is sensed. What goes wrong with it is reported: none of this raises for that."""

    def begin(self, start: float, wake: Callable[[], None], report: Report) -> Sequence[Work]:
        """The run begins.

        Args:
            start: Loop time of run time 0 [s].
            wake: Makes an extra tick at once, off the schedule: something was heard that cannot wait.
            report: Where problems go.

        Returns:
            Coroutines that run beside the ticks; they are cancelled when the run ends.
        """

    def sense(self, now: float) -> Readings:
        """What is new since the last tick, or what it last said, at loop time `now` [s]. It waits for nothing."""

    def close(self) -> None:
        """Give the hardware back; the run is over."""


class Actuators(Device, Protocol):
    """Hardware that moves the robot: one or more drives, of whatever family and on whatever line."""

    @property
    def drives(self) -> Collection[str]:
        """Names of its drives in the robot file, in the order of their feedback."""

    def write(self, tick: Tick) -> None:
        """Do what follows from a tick: goals and set-points; in an urgent one only what stops the robot."""

    def stop(self) -> None:
        """Last resort, when the program itself fails: stop every drive at once."""

    async def perform(self, job: Job) -> JobResult:
        """Do a job of one of its drives beside the ticks; a drive that fails is a result, not an exception."""


class DeviceGroup:
    """Several devices as one: the `Actuators` of a robot whose drives are of several kinds, or that has sensors."""

    def __init__(self, names: Sequence[str], actuators: Sequence[Actuators], sensors: Sequence[Device] = ()) -> None:
        """`names` of all drives, in the order in which `Sensed` has them. What actuators there are is all of them."""
        self.drives = tuple(names)
        self._actuators, self._devices = tuple(actuators), (*actuators, *sensors)
        self._of = {name: device for device in actuators for name in device.drives}
        found = [name for device in actuators for name in device.drives]
        self._places = [found.index(name) for name in names]

    def begin(self, start: float, wake: Callable[[], None], report: Report) -> list[Work]:
        """As of a `Device`."""
        return [work for device in self._devices for work in device.begin(start, wake, report)]

    def sense(self, now: float) -> Readings:
        """As of a `Device`; what several buses go through is summed up."""
        readings = [device.sense(now) for device in self._devices]
        drives = [drive for part in readings for drive in part.drives]
        buses = [part.bus for part in readings]
        return Readings(
            drives=tuple([drives[place] for place in self._places]),
            scans=sum((part.scans for part in readings), ()),
            battery_v=next((part.battery_v for part in readings if part.battery_v is not None), None),
            bus=BusHealth(
                foreign=sum((bus.foreign for bus in buses), ()),
                refused=max(bus.refused for bus in buses),
                error_frames=sum(bus.error_frames for bus in buses),
                blocked=sum((bus.blocked for bus in buses), ()),
            ),
        )

    def write(self, tick: Tick) -> None:
        """As of `Actuators`."""
        for device in self._actuators:
            device.write(tick)

    def stop(self) -> None:
        """As of `Actuators`; the others too, if one raises."""
        with ExitStack() as stops:
            for device in reversed(self._actuators):
                stops.callback(device.stop)

    async def perform(self, job: Job) -> JobResult:
        """As of `Actuators`."""
        return await self._of[job.drive].perform(job)

    def close(self) -> None:
        """As of a `Device`; the others too, if one raises."""
        with ExitStack() as ends:
            for device in reversed(self._devices):
                ends.callback(device.close)
