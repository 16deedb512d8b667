"""Several devices are one: what a robot has whose drives hang on several lines, or that has sensors."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from core_builders import drive, snapshot

from artemis.clock import run
from artemis.devices.device import DeviceGroup, Readings, Report, Work
from artemis.values import BusHealth, Job, JobKind, JobResult, Mode, SetPoints, Tick, Wish


class FakeActuators:
    """Drives that note what is asked of them."""

    def __init__(self, log: list[str], *names: str, bus: BusHealth | None = None) -> None:
        self.drives, self.log, self.bus = names, log, bus or BusHealth()

    def begin(self, start: float, wake: Callable[[], None], report: Report) -> list[Work]:
        self.log.append(f"begin {self.drives[0]}")
        return []

    def sense(self, now: float) -> Readings:
        return Readings(drives=tuple(drive(name, age=now) for name in self.drives), bus=self.bus)

    def write(self, tick: Tick) -> None:
        self.log.append(f"write {self.drives[0]}")

    def stop(self) -> None:
        self.log.append(f"stop {self.drives[0]}")
        raise ZeroDivisionError(self.drives[0])

    async def perform(self, job: Job) -> JobResult:
        return JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=True, detail=f"done by {self.drives[0]}")

    def close(self) -> None:
        self.stop()


def group(log: list[str]) -> DeviceGroup:
    """Steering on one line, traction on two."""
    steering = FakeActuators(log, "d", "b", bus=BusHealth(foreign=(1,), refused=3, error_frames=1))
    traction = FakeActuators(log, "c", bus=BusHealth(foreign=(2, 3), refused=1, error_frames=2, blocked=("no",)))
    return DeviceGroup("abcd", [steering, traction, FakeActuators(log, "a")])


def test_drives_are_sensed_in_the_order_of_the_robot_file_and_buses_are_summed_up() -> None:
    readings = group([]).sense(0.5)
    assert [(drive.name, drive.age) for drive in readings.drives] == [("a", 0.5), ("b", 0.5), ("c", 0.5), ("d", 0.5)]
    assert readings.bus == BusHealth(foreign=(1, 2, 3), refused=3, error_frames=3, blocked=("no",))


def test_everyone_begins_and_writes() -> None:
    log: list[str] = []
    devices = group(log)
    devices.begin(0.0, lambda: None, lambda *problem: None)
    devices.write(Tick(snapshot=snapshot(), mode=Mode.READY, wish=Wish(), set_points=SetPoints()))
    assert log == ["begin d", "begin c", "begin a", "write d", "write c", "write a"]


@pytest.mark.parametrize("act", [DeviceGroup.stop, DeviceGroup.close])
def test_everyone_is_stopped_and_closed_even_if_one_fails(act: Callable[[DeviceGroup], None]) -> None:
    log: list[str] = []
    with pytest.raises(ZeroDivisionError):
        act(group(log))
    assert log == ["stop d", "stop c", "stop a"]


def test_a_job_is_done_by_whose_drive_it_is() -> None:
    async def main() -> JobResult:
        return await group([]).perform(Job(id=1, kind=JobKind.SECURE, drive="b"))

    assert run(main(), simulated=True).detail == "done by d"
