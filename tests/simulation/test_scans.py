"""A laser scanner beside the drives: its scans are sensed once each, recorded, read back and replayed."""

from __future__ import annotations

from pathlib import Path

import pytest
from fake_scanner import PROBLEM, TURN, FakeScanner
from rig import CALIBRATE, TICK, Run, follow, run, write_mission

from artemis.recording.mcap_reader import Recording

pytestmark = pytest.mark.short_alignment

STEPS = [CALIBRATE, follow(0.4)]


def driven_with(scanner: FakeScanner, folder: Path) -> Run:
    seen = run(write_mission(folder, STEPS), sensors=lambda: [scanner])
    assert seen.status == 0
    return seen


def test_a_run_with_a_scanner_is_recorded_and_replays_bit_for_bit(tmp_path: Path) -> None:
    scanner = FakeScanner()
    seen = driven_with(scanner, tmp_path)
    sensed = [(tick.snapshot.time, scan) for tick in seen.ticks for scan in tick.snapshot.sensed.scans]
    assert len(sensed) > 200
    assert [scan for _, scan in sensed] == scanner.made[: len(sensed)], "each once, in their order"
    assert all(scan.time + TURN - 1e-9 < time < scan.time + TURN + TICK + 1e-9 for time, scan in sensed), "at once"
    assert seen.outcome is not None
    read = [scan for tick in Recording(seen.outcome.run.path).ticks() for scan in tick.snapshot.sensed.scans]
    assert read == [scan for _, scan in sensed]
    replayed = seen.recompute()
    assert (replayed.ticks, replayed.difference) == (len(seen.ticks), None)


@pytest.mark.slow
def test_a_scanner_ends_with_the_run_and_changes_nothing_else(tmp_path: Path) -> None:
    scanner = FakeScanner()
    with_one, without = driven_with(scanner, tmp_path / "with"), run(write_mission(tmp_path / "without", STEPS))
    assert (scanner.work, scanner.closed) == ("ended", 1)
    assert [tick.set_points for tick in with_one.ticks] == [tick.set_points for tick in without.ticks]
    assert [frame for _, frame in with_one.bus.sent] == [frame for _, frame in without.bus.sent]


def test_what_a_scanner_reports_is_sensed_at_once_and_one_time(tmp_path: Path) -> None:
    seen = driven_with(FakeScanner(dazzle=100), tmp_path)
    ticks = [tick for tick in seen.ticks if any(fault.device == "front" for fault in tick.snapshot.sensed.faults)]
    (sensed,) = [tick.snapshot.sensed for tick in ticks]
    assert [(fault.id, fault.device) for fault in sensed.faults] == [PROBLEM[:2]]
    assert sensed.urgent
    assert PROBLEM[2] in sensed.faults[0].text
