"""What an EPOS4 makes of causes outside of it is noticed in time and stops the robot; so is what keeps it off."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from every_row import Scene, assert_follows, assert_noticed, once, play
from rig import TICK
from scenes_of_families import MACHINES
from watched import DRIVES, TRACTION

from artemis.drive_states import Goal
from artemis.states.alignment import LATE
from artemis.supervision.catalogue import ROWS
from artemis.values import Severity

EPOS4 = MACHINES["epos4"]
WARNING = 0xFF01
LEFT = TRACTION[0]

CAUSES = {
    "DRV-29": Scene(node=LEFT, coasts=[LEFT]),
    "DRV-06": Scene(node=LEFT, options={"ambient_c": 110.0}, coasts=[LEFT]),
    "COM-12": Scene(node="steer-left", seen=["DRV-38"], effect=0.06),
    "EST-01": Scene(coasts=TRACTION),
    "PWR-02": Scene(
        options={"within_s": 0.0},
        seen=["DRV-04"],
        device=LEFT,
        severity=Severity.CONTROLLED_STOP,
        coasts=TRACTION,
    ),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("id", CAUSES)
def test_cause_of_an_error_is_noticed_in_time_and_stops_the_robot(tmp_path: Path, id: str) -> None:
    scene = EPOS4.on(CAUSES[id])
    run = play(tmp_path, id, scene)
    assert_follows(run, scene, assert_noticed(run, id, scene))


_ASKED = once(lambda seen: seen.tick.wish.steering is Goal.ENABLED, LATE + 3 * TICK)
"""Its inputs are asked for so long after it was to be enabled."""
AT_START = {
    "DRV-29": EPOS4.on(Scene(of="bring-up", node="steer-left", effect=_ASKED)),
    "EST-01": EPOS4.on(Scene(of="bring-up", effect=_ASKED)),
    "EST-03": EPOS4.on(Scene(of="bring-up", options={"opens": "sto"}, seen=["EST-01"], effect=_ASKED)),
}


@pytest.mark.parametrize("id", AT_START)
def test_safe_torque_off_that_is_open_at_the_start_is_named(tmp_path: Path, id: str) -> None:
    """Such a drive has no error: it stays in Switch On Disabled, and only its inputs say why."""
    scene = AT_START[id]
    run = play(tmp_path, id, scene)
    assert_follows(run, scene, assert_noticed(run, id, scene))
    assert set(run.fault_ids) == {*(scene.seen or [id])}


def test_all_drives_with_open_inputs_are_named(tmp_path: Path) -> None:
    others = {"at_s": 0.0, "inject": "DRV-29", "node": "traction-right"}
    run = play(tmp_path, "DRV-29", replace(AT_START["DRV-29"], along=[others]))
    assert [(fault.id, fault.device) for fault in run.faults] == [("DRV-29", "traction-right")]
    assert "(its STO inputs are open: they read 0x00; open at steer-left, too)" in run.faults[0].text


def test_drive_that_does_not_enable_for_another_reason_is_told_as_before(tmp_path: Path) -> None:
    scene = EPOS4.on(Scene(of="bring-up", node="steer-left"))
    assert play(tmp_path, "COM-03", scene).fault_ids[:1] == ["COM-03"]


def test_set_points_that_one_drive_alone_misses_are_not_said_to_be_the_computer_s(tmp_path: Path) -> None:
    """Nor is the bus said to be silent by what the computer finds at once after it stalled."""
    alone = play(tmp_path / "alone", "COM-12", EPOS4.on(CAUSES["COM-12"]))
    assert [(fault.id, fault.device) for fault in alone.faults] == [("DRV-38", "steer-left")]
    assert alone.faults[0].text == "steer-left: set-points came too late (EMCY 0x8250)"
    assert ROWS["DRV-38"].advice.startswith("one drive alone: its cable, its plug; several, or late ticks")
    stalled = play(tmp_path / "stalled", "SYS-01", EPOS4.on(Scene(options={"seconds": 0.1})))
    assert {(fault.id, fault.device) for fault in stalled.faults} == {
        ("SYS-01", ""),
        ("COM-31", ""),
        *(("DRV-38", name) for name in DRIVES),
    }


def test_an_overload_is_a_warning_that_the_drive_goes_on_with(tmp_path: Path) -> None:
    run = play(tmp_path, "DRV-28", EPOS4.of_code("DRV-28", WARNING, LEFT))
    assert "DRV-28" in run.fault_ids
