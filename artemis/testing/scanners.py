"""What every scanner must do, as tests: see `artemis.testing.contracts`."""

from __future__ import annotations

import asyncio
from itertools import pairwise

from artemis import clock
from artemis.mounting import Mounting
from artemis.plugins.contracts import Scanner
from artemis.plugins.guard import LATE
from artemis.plugins.registry import SCANNERS
from artemis.plugins.scanning import is_whole_scan
from artemis.scan import Scan
from artemis.testing.contracts import NAME, ROBOT, PluginContract, quickest

_PLACE = Mounting(plugin=NAME, x_m=0.5, y_m=0.0, heading_deg=0.0, height_m=0.3, least_range_m=0.1)


class ScannerContract(PluginContract):
    """A scanner: inherit, set `plugin`, and `options` if it has any.

    It runs on virtual time: for one that asks a device, override `given` with a stand-in for that. It is made on a
    running loop.
    """

    group = SCANNERS
    robot = ROBOT.model_copy(update={"scanners": {NAME: _PLACE}})
    duration: float = 10.0
    """So long it runs [s], of run time: nothing waits for it."""

    def scans(self) -> list[tuple[float, Scan]]:
        """What a new one gives, with the run times [s]; it is cancelled and closed afterwards."""
        return clock.run(self._scans(), simulated=True)

    async def _scans(self) -> list[tuple[float, Scan]]:
        loop, given = asyncio.get_running_loop(), list[tuple[float, Scan]]()
        begun = loop.time()
        scanner: Scanner = self.make()

        def give(scan: Scan) -> None:
            assert is_whole_scan(scan), f"gave {scan!r:.200}: no whole Scan (PLG-06)"
            given.append((loop.time() - begun, scan))

        running = asyncio.ensure_future(scanner.run(lambda: loop.time() - begun, give))
        done, _ = await asyncio.wait([running], timeout=self.duration)
        if done:
            await running
            raise AssertionError(f"run() ended after {loop.time() - begun:.1f} s: it measures until it is cancelled")
        running.cancel()
        _, left = await asyncio.wait([running], timeout=1.0)
        assert not left, "run() continues after it was cancelled"
        scanner.close()
        scanner.close()
        return given

    def test_scans_are_whole_and_have_its_name(self) -> None:
        """There are some; each has the right types in it, and the scanner's name in the robot file."""
        scans = self.scans()
        assert scans, f"no scan within {self.duration:.0f} s (LAS-01)"
        for given, scan in scans:
            assert scan.source == NAME, f"at {given:.2f} the source was {scan.source!r}, not context.name (PLG-06)"

    def test_scans_are_of_the_past_and_in_their_order(self) -> None:
        """Their first beam was measured at run time, at most 0.15 s before they are given (LAS-07)."""
        before = -1.0
        for given, scan in self.scans():
            last = scan.time + scan.beam_time * len(scan.millimetres)
            assert before < scan.time <= given, f"at {given:.3f} s came a scan of {scan.time:.3f}, after {before:.3f}"
            assert given - last < 0.15, f"at {given:.3f} s came a scan whose last beam was measured at {last:.3f}"
            before = scan.time

    def test_scans_are_counted(self) -> None:
        """One that stays the same is taken for a frozen scanner (LAS-02)."""
        counters = [scan.counter for _, scan in self.scans()]
        assert all(later > earlier for earlier, later in pairwise(counters)), "counter must grow"

    def test_closes_before_it_runs(self) -> None:
        """Where a run fails before it begins."""

        async def main() -> None:
            scanner: Scanner = self.make()
            scanner.close()

        clock.run(main(), simulated=True)

    def test_gives_without_holding_the_ticks_up(self) -> None:
        """It runs in the thread of the ticks: a second of it takes no longer than a few of them may."""
        took = quickest(lambda _: self.scans(), range(3)) / self.duration
        assert took < 10 * LATE, f"a second of it takes {took * 1000:.0f} ms of computing"
