"""A drive reports an error while the robot follows a path: everything stops, and the operator reads what and where."""

from __future__ import annotations

from pathlib import Path

import pytest
from rig import (
    BRAKING,
    CALIBRATE,
    DRIVES,
    NODE,
    STEERING,
    STOP_FRAMES,
    TICK,
    TRACTION,
    Rig,
    Run,
    controlword,
    follow,
    standing,
    write_mission,
)

from artemis.drive_states import DriveState
from artemis.families import EPOS1
from artemis.sim.epos_errors import ERRORS, Reaction
from artemis.values import JobKind, Mode, Severity

pytestmark = pytest.mark.short_alignment

QUICK_STOP = 0x0B
ONE_OF_EACH = [0x2310, 0x8150, 0x8611]
"""Errors after which a drive switches off, goes on, and stops by itself; `test_every_row_drives` has them all."""
NEEDS_MORE_THAN_A_RESET = {0x8120, 0xFF04}
"""NMT Reset Communication, and Reset Node (EPOS firmware specification 2010, 12.2)."""


def run_with_emergency(folder: Path, name: str, code: int) -> Run:
    rig = Rig(write_mission(folder, [CALIBRATE, follow(0.3)]))
    return rig.while_following(rig.emergency(name, code), name="emergency").run()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("code", ONE_OF_EACH, ids=lambda code: f"0x{code:04X}")
@pytest.mark.parametrize("name", ["traction-right", "steer-left"])
def test_an_emergency_while_following_stops_everything_and_says_why(tmp_path: Path, name: str, code: int) -> None:
    seen = run_with_emergency(tmp_path, name, code)
    at = seen.acts["emergency"]
    assert_fault_names(seen, name, code)
    fault = seen.first(lambda s: s.mode is Mode.FAULT)
    assert fault.now - at <= TICK + 0.001
    assert_traction_is_stopped_and_steering_held(seen, at, faulty=name)
    assert_history_was_read(seen, name, code)
    assert standing(seen.world.truth)
    coasts = name in TRACTION and ERRORS[code].reaction is Reaction.POWER_OFF
    assert seen.stands_from() - at < (3.0 if coasts else 0.3 / BRAKING + 0.15)
    assert seen.status == 1
    assert [node.state for node in seen.world.nodes if node.name != name] == [DriveState.SWITCH_ON_DISABLED] * 3


def assert_fault_names(seen: Run, name: str, code: int) -> None:
    """The first fault is the drive's own."""
    fault = seen.faults[0]
    assert fault.id == EPOS1.errors[code]
    assert (fault.device, fault.severity, fault.to_fault) == (name, Severity.QUICK_STOP, True)
    assert fault.text.startswith(f"{name}: ")
    assert f"0x{code:04X}" in fault.text


def assert_traction_is_stopped_and_steering_held(seen: Run, at: float, faulty: str) -> None:
    healthy = [drive for drive in TRACTION if drive != faulty]
    for drive in healthy:
        word, frame = next(
            (controlword(f), f)
            for t, f in seen.bus.sent
            if t >= at and controlword(f) is not None and f.id & 0x7F == NODE[drive]
        )
        assert (word, frame.id) == (QUICK_STOP, STOP_FRAMES + NODE[drive])
    moving = [truth for truth in seen.truth_from(at) if not standing(truth)]
    assert moving
    for drive in STEERING:
        if drive != faulty:
            place = DRIVES.index(drive)
            assert {truth.states[place] for truth in moving} == {DriveState.OPERATION_ENABLE}


def assert_history_was_read(seen: Run, name: str, code: int) -> None:
    results = {
        result.drive: result
        for tick in seen.ticks
        for result in tick.snapshot.sensed.results
        if result.kind is JobKind.READ_HISTORY
    }
    assert set(results) == set(DRIVES)
    assert results[name].values[0] == code


def test_every_code_of_the_first_generation_has_its_row() -> None:
    assert set(ERRORS) <= set(EPOS1.errors)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("code", sorted(set(ERRORS) - NEEDS_MORE_THAN_A_RESET)[::5], ids=lambda code: f"0x{code:04X}")
def test_the_run_leaves_the_faulty_drive_without_a_fault_but_with_its_history(tmp_path: Path, code: int) -> None:
    seen = run_with_emergency(tmp_path, "steer-right", code)
    drive = seen.world.drive("steer-right")
    assert drive.state is DriveState.SWITCH_ON_DISABLED
    assert drive.read(0x1003, 1) == code


def test_two_drives_that_fail_at_once_are_both_named(tmp_path: Path) -> None:
    rig = Rig(write_mission(tmp_path, [CALIBRATE, follow(0.3)]))

    def both() -> None:
        rig.emergency("traction-left", 0x2310)()
        rig.emergency("steer-right", 0x8611)()

    seen = rig.while_following(both).run()
    assert {(fault.id, fault.device) for fault in seen.faults[:2]} == {
        ("DRV-02", "traction-left"),
        ("DRV-25", "steer-right"),
    }


@pytest.mark.sampled(2)
@pytest.mark.parametrize("tick_hz", [50, 200])
def test_a_fault_at_the_very_time_of_a_tick_is_named_by_its_emergency(tmp_path: Path, tick_hz: int) -> None:
    faults = {"faults": [{"at_s": 6.2, "inject": "DRV-25", "node": "steer-left"}]}
    seen = Rig(write_mission(tmp_path, [{"wait": {"seconds": 10}}], tick_hz=tick_hz, simulation=faults)).run()
    assert seen.fault_ids == ["DRV-25"]


@pytest.mark.parametrize("code", sorted(NEEDS_MORE_THAN_A_RESET), ids=lambda code: f"0x{code:04X}")
def test_a_drive_found_in_a_fault_that_needs_an_nmt_reset_is_brought_up(tmp_path: Path, code: int) -> None:
    rig = Rig(write_mission(tmp_path, [{"wait": {"seconds": 0.1}}]))

    def fail() -> None:
        rig.drive("steer-left").emergency(code, rig.bus.loop.time(), heard=False)

    seen = rig.at(0.1, fail).run()
    assert (seen.status, seen.fault_ids) == (0, [])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("code", sorted(NEEDS_MORE_THAN_A_RESET), ids=lambda code: f"0x{code:04X}")
def test_a_fault_that_needs_an_nmt_reset_is_acknowledged_once_though_its_emergency_was_lost(
    tmp_path: Path, code: int
) -> None:
    faults = {"faults": [{"at_s": 6.2, "inject": EPOS1.errors[code], "node": "steer-left", "heard": False}]}
    acts = {"operator": [{"at_s": 10.2, "do": "acknowledge"}, {"at_s": 16.2, "do": "arm"}]}
    seen = Rig(write_mission(tmp_path, [{"wait": {"seconds": 15.0}}], simulation={**faults, **acts})).run()
    assert (seen.status, seen.fault_ids) == (0, ["COM-01"])
