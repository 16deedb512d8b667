"""The supply voltage as a drive measures it: who measures, how often it is read, and what a missing answer is."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import ValidationError

from artemis.clock import run
from artemis.config import Inconsistent
from artemis.devices.can_bus import Frame
from artemis.devices.supply import EVERY, VALID, SupplyMeter
from artemis.errors import DeviceTimeout
from artemis.families.epos1 import ANALOG
from artemis.vehicle import RobotFile, SupplySource

ROBOTS = Path(__file__).parents[2] / "missions" / "robots"
BATTERY = yaml.safe_load((ROBOTS / "artemis_battery.yaml").read_text())


def robot(name: str = "artemis_battery", **measured: Any) -> RobotFile:  # noqa: ANN401 (as a file writes them)
    data = yaml.safe_load((ROBOTS / f"{name}.yaml").read_text())
    if measured:
        data["battery"]["measured"] = measured
    return RobotFile.model_validate(data)


def test_an_epos4_measures_its_supply_and_an_epos_by_a_divider() -> None:
    told = robot("artemis_epos4").supply_source
    assert told is not None
    assert (told.drive, str(told.object), told.volts_per_unit) == ("traction-left", "0x2200:1", 0.1)
    assert robot("artemis").supply_source is None
    second = robot(drive="traction-right", input=2, divider=8.0).supply_source
    assert second == SupplySource("traction-right", ANALOG[1], 8.0 / 1000.0)
    assert robot().supply_source == SupplySource("traction-left", ANALOG[0], 6.0 / 1000.0)


def test_a_described_battery_that_nobody_measures_is_no_error() -> None:
    data = yaml.safe_load((ROBOTS / "artemis_battery.yaml").read_text())
    del data["battery"]["measured"]
    assert RobotFile.model_validate(data).supply_source is None


@pytest.mark.parametrize(
    ("measured", "words"),
    [
        ({"drive": "traction-lef"}, "there is no drive 'traction-lef'; nearest is 'traction-left'"),
        ({"drive": "steer-left"}, "the analog inputs of steer-left read potentiometers"),
        ({"divider": 5.0}, "a full battery would show 5.12 V; the analog input reads 0 to 5 V"),
    ],
)
def test_an_input_that_cannot_read_the_battery_is_refused(measured: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError) as refused:
        robot(**{"drive": "traction-left", "input": 1, "divider": 6.0, **measured})
    problem = refused.value.errors()[0]["ctx"]["error"]
    assert isinstance(problem, Inconsistent)
    assert words in str(problem)


def test_a_drive_without_analog_inputs_reads_no_battery() -> None:
    data = yaml.safe_load((ROBOTS / "artemis_battery.yaml").read_text())
    drive = data["drives"]["traction-left"]
    drive |= {"family": "cia402", "hardware_version": 1}
    drive["cia402"] = {
        "vendor_id": 1,
        "operating_mode": 3,
        "velocity_units_per_rpm": 1.0,
        "acceleration_units_per_rpm_s": 1.0,
    }
    del drive["gains"]
    with pytest.raises(ValidationError, match="no analog input of traction-left is known"):
        RobotFile.model_validate(data)


class Objects:
    """A drive that answers at once with what the test says."""

    late_answers = 0

    def __init__(self, answer: Callable[[], bytes]) -> None:
        self.answer, self.asked = answer, 0
        self.takes = 0.0

    async def read(self, index: int, subindex: int, size: int = 0) -> bytes:
        assert (index, subindex, size) == (0x2200, 1, 2)
        self.asked += 1
        await asyncio.sleep(self.takes)
        return self.answer()

    async def write(self, index: int, subindex: int, data: bytes, patience: float | None = None) -> None:
        raise AssertionError("it only reads")

    def receive(self, frame: Frame) -> None:
        raise AssertionError("it has no bus")


class Watch:
    """A meter that runs for a while, on virtual time."""

    def __init__(self, answer: Callable[[], bytes]) -> None:
        self.objects, self.judged = Objects(answer), True
        source = robot("artemis_epos4").supply_source
        assert source is not None
        self.meter = SupplyMeter(source, self.objects, lambda: self.judged)
        self.reports: list[tuple[str, str, str]] = []
        self.seen: list[float | None] = []

    def through(self, *judged: bool) -> Watch:
        """One while after the other, the drives in use or not; what was sensed at its end."""
        run(self._through(judged), simulated=True)
        return self

    async def _through(self, judged: tuple[bool, ...]) -> None:
        (work,) = self.meter.begin(0.0, lambda: None, lambda *told: self.reports.append(told))
        task = asyncio.ensure_future(work)
        for self.judged in judged:
            await asyncio.sleep(5.5 * EVERY)
            self.seen.append(self.meter.sense(asyncio.get_running_loop().time()).battery_v)
        task.cancel()
        self.meter.close()


def test_it_is_read_ten_times_a_second_while_the_drives_are_in_use() -> None:
    watch = Watch(lambda: (248).to_bytes(2, "little")).through(False, True, True, False)
    assert watch.seen == [None, pytest.approx(24.8), pytest.approx(24.8), None]
    assert watch.objects.asked == pytest.approx(11, abs=1)
    assert watch.reports == []


def test_a_reading_ends_to_count_while_the_drive_does_a_job_that_takes_long() -> None:
    async def main() -> list[tuple[float, float | None]]:
        watch = Watch(lambda: (248).to_bytes(2, "little"))
        (work,) = watch.meter.begin(0.0, lambda: None, lambda *told: None)
        reading, loop, seen = asyncio.ensure_future(work), asyncio.get_running_loop(), []
        await asyncio.sleep(2.5 * EVERY)
        watch.objects.takes = 3.0  # it stores its parameters meanwhile
        for _ in range(160):
            await asyncio.sleep(0.02)
            seen.append((loop.time(), watch.meter.sense(loop.time()).battery_v))
        reading.cancel()
        return seen

    seen = run(main(), simulated=True)
    known = [time for time, volts in seen if volts is not None]
    gap = max(after - before for before, after in pairwise(known))
    assert gap == pytest.approx(3.0 + EVERY - VALID, abs=0.15)
    assert seen[-1][1] == pytest.approx(24.8)


def test_a_drive_that_does_not_answer_is_a_fault_and_no_voltage() -> None:
    def silent() -> bytes:
        raise DeviceTimeout("traction-left", "no answer")

    watch = Watch(silent).through(True)
    assert watch.seen == [None]
    assert set(watch.reports) == {("COM-08", "traction-left", "supply voltage: no answer")}


def test_an_answer_that_is_missed_once_the_robot_stopped_for_it_is_no_news() -> None:
    def dies() -> bytes:
        watch.judged = False
        raise DeviceTimeout("traction-left", "no answer")

    watch = Watch(dies).through(True)
    assert (watch.objects.asked, watch.reports, watch.seen) == (1, [], [None])
