"""A scanner's plugin at work: run again after errors, its garbage refused, and nothing of it stops the run."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, ClassVar

import pytest
from msgspec.structs import replace

from artemis import clock
from artemis.config import Config
from artemis.devices.device import Report
from artemis.errors import DeviceLost, DeviceTimeout, WrongDevice
from artemis.plugins.scanning import ScannerDevice, is_whole_scan
from artemis.scan import Scan

SCAN = Scan(source="front", time=0.0, start_angle=-1.0, increment=0.5, ranges=b"\x01\x00\x02\x00\x03\x00")
Give = Callable[[Any], None]


class Doing:
    """A scanner that does what a test says, each time it is run."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, *acts: Callable[[Give], Awaitable[None]]) -> None:
        self.acts = list(acts)
        self.runs: list[float] = []
        self.closed = 0

    async def run(self, clock: Callable[[], float], give: Callable[[Scan], None]) -> None:
        self.runs.append(clock())
        await self.acts[min(len(self.runs), len(self.acts)) - 1](give)

    def close(self) -> None:
        self.closed += 1
        if self.closed > 1:
            raise ZeroDivisionError("closed twice")


async def wait(give: Give) -> None:
    await asyncio.sleep(1e6)


def raising(error: BaseException, *scans: object) -> Callable[[Give], Awaitable[None]]:
    async def act(give: Give) -> None:
        for scan in scans:
            give(scan)
        raise error

    return act


def giving(*scans: object) -> Callable[[Give], Awaitable[None]]:
    async def act(give: Give) -> None:
        for scan in scans:
            give(scan)
        await wait(give)

    return act


def ran(scanner: Doing, seconds: float, **mounted: bool) -> tuple[tuple[Scan, ...], list[tuple[str, str, str]]]:
    """What came of it in so much time: scans, and problems."""
    problems: list[tuple[str, str, str]] = []
    report: Report = lambda id, device, seen: problems.append((id, device, seen))  # noqa: E731

    async def main() -> tuple[Scan, ...]:
        device = ScannerDevice("front", scanner, **mounted)
        (work,) = device.begin(asyncio.get_running_loop().time(), lambda: None, report)
        task = asyncio.ensure_future(work)
        await asyncio.sleep(seconds)
        scans = device.sense(seconds).scans
        assert device.sense(seconds).scans == (), "each once"
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        device.close()
        device.close()
        return scans

    return clock.run(main(), simulated=True), problems


def test_scans_pass_in_their_order() -> None:
    later = replace(SCAN, counter=1)
    assert ran(Doing(giving(SCAN, later)), 1.0)[0] == (SCAN, later)


def test_angles_of_one_that_hangs_upside_down_are_mirrored() -> None:
    (scan,), _ = ran(Doing(giving(SCAN)), 1.0, upside_down=True)
    assert (scan.start_angle, scan.increment, scan.ranges) == (1.0, -0.5, SCAN.ranges)


def test_a_lost_device_is_looked_for_again_less_and_less_often() -> None:
    scanner = Doing(raising(DeviceLost("front", "no route")))
    _, problems = ran(scanner, 40.0)
    assert scanner.runs == pytest.approx([0.0, 0.5, 1.5, 3.5, 7.5, 15.5, 23.5, 31.5, 39.5])
    assert problems[:-1] == [("LAS-01", "front", "no route")] * len(scanner.runs)


def test_after_scans_it_is_looked_for_soon() -> None:
    lost = DeviceTimeout("front", "no scan")
    scanner = Doing(raising(lost), raising(lost), raising(lost, SCAN), wait)
    ran(scanner, 40.0)
    assert scanner.runs == pytest.approx([0.0, 0.5, 1.5, 2.0])


def test_one_that_does_not_what_it_shall_is_another_row() -> None:
    _, problems = ran(Doing(raising(WrongDevice("front", "25 Hz, not 50"))), 0.1)
    assert problems[0] == ("LAS-09", "front", "25 Hz, not 50")


def test_a_plugin_that_raises_is_not_run_again() -> None:
    for error in (ZeroDivisionError("bug"), SystemExit(3)):
        scanner = Doing(raising(error))
        _, problems = ran(scanner, 40.0)
        assert scanner.runs == [0.0]
        assert (*problems[0][:2], problems[0][2].partition(" at test_")[0]) == ("PLG-02", "front", repr(error))


def test_a_plugin_that_ends_is_told() -> None:
    async def end(give: Give) -> None:
        give(SCAN)

    scans, problems = ran(Doing(end), 40.0)
    assert scans == (SCAN,)
    assert problems[0] == ("PLG-06", "front", "run() has ended")


def test_an_error_while_closing_is_told() -> None:
    scanner = Doing(wait)
    _, problems = ran(scanner, 0.1)
    assert scanner.closed == 2
    ((id, name, seen),) = problems
    assert (id, name) == ("PLG-02", "front")
    assert seen.startswith("ZeroDivisionError('closed twice') at test_scanning.py:")


WRONG = [
    None,
    "scan",
    replace(SCAN, source=3),
    replace(SCAN, time=float("nan")),
    replace(SCAN, time="now"),
    replace(SCAN, beam_time=-1.0),
    replace(SCAN, increment=0.0),
    replace(SCAN, increment=float("inf")),
    replace(SCAN, increment=3.2),
    replace(SCAN, start_angle=7.0),
    replace(SCAN, ranges=b""),
    replace(SCAN, ranges=b"odd"),
    replace(SCAN, ranges=[1, 2]),
    replace(SCAN, ranges=bytes(1 << 16)),
    replace(SCAN, intensities=b"\0\0"),
    replace(SCAN, intensities="strong"),
    replace(SCAN, counter=1.0),
    replace(SCAN, condition=0),
    replace(SCAN, garbled=-1),
]


@pytest.mark.parametrize("wrong", WRONG)
def test_garbage_is_refused(wrong: object) -> None:
    assert not is_whole_scan(wrong)
    scans, problems = ran(Doing(giving(SCAN, wrong, SCAN)), 1.0)
    assert scans == (SCAN, SCAN)
    assert problems[0][:2] == ("PLG-06", "front")


def test_a_scan_of_another_or_from_the_future_is_refused() -> None:
    scans, problems = ran(Doing(giving(replace(SCAN, source="rear"), replace(SCAN, time=0.001), SCAN)), 1.0)
    assert scans == (SCAN,)
    assert [problem[0] for problem in problems[:2]] == ["PLG-06"] * 2
