"""What an EPOS4 reports is noticed in time and stops the robot; so is what it makes of causes outside of it."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from every_row import Scene, assert_follows, assert_noticed, name_of, once, play
from rig import TICK
from watched import DRIVES, TRACTION

from artemis.drive_states import Goal
from artemis.sim.epos4_errors import ERRORS_4
from artemis.sim.epos_errors import Reaction
from artemis.states.alignment import LATE
from artemis.values import Severity
from artemis_lab.injections.emergencies import CODES

ROBOT = "artemis_epos4.yaml"
WARNING = 0xFF01
LEFT = TRACTION[0]


def errors() -> Iterator[tuple[str, Scene]]:
    """Each code once, on one drive after the other."""
    nodes = itertools.cycle(DRIVES)
    for id, codes in CODES["epos4"].items():
        for code in codes:
            if code != WARNING:
                yield id, of_code(code, next(nodes))


def of_code(code: int, node: str) -> Scene:
    """A drive has this error."""
    off = ERRORS_4[code].reaction is Reaction.POWER_OFF
    coasts = [node] if off and node in TRACTION else []
    return Scene(of="driving on EPOS4", robot=ROBOT, node=node, options={"code": code}, coasts=coasts)


@pytest.mark.sampled(12)
@pytest.mark.parametrize(("id", "scene"), list(errors()), ids=name_of)
def test_error_of_an_epos4_is_noticed_in_time_and_stops_the_robot(tmp_path: Path, id: str, scene: Scene) -> None:
    run = play(tmp_path, id, scene)
    assert_follows(run, scene, assert_noticed(run, id, scene))


CAUSES = {
    "DRV-29": Scene(of="driving on EPOS4", robot=ROBOT, node=LEFT, coasts=[LEFT]),
    "DRV-06": Scene(of="driving on EPOS4", robot=ROBOT, node=LEFT, options={"ambient_c": 110.0}, coasts=[LEFT]),
    "COM-12": Scene(of="driving on EPOS4", robot=ROBOT, node="steer-left", seen=["DRV-38"], effect=0.06),
    "EST-01": Scene(of="driving on EPOS4", robot=ROBOT, coasts=TRACTION),
    "PWR-02": Scene(
        of="driving on EPOS4",
        robot=ROBOT,
        options={"within_s": 0.0},
        seen=["DRV-04"],
        device=LEFT,
        severity=Severity.CONTROLLED_STOP,
        coasts=TRACTION,
    ),
}


_ASKED = once(lambda seen: seen.tick.wish.steering is Goal.ENABLED, LATE + 3 * TICK)
"""Its inputs are asked for so long after it was to be enabled."""
AT_START = {
    "DRV-29": Scene(of="bring-up", robot=ROBOT, node="steer-left", effect=_ASKED),
    "EST-01": Scene(of="bring-up", robot=ROBOT, effect=_ASKED),
    "EST-03": Scene(of="bring-up", robot=ROBOT, options={"opens": "sto"}, seen=["EST-01"], effect=_ASKED),
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
    scene = Scene(of="bring-up", robot=ROBOT, node="steer-left")
    assert play(tmp_path, "COM-03", scene).fault_ids[:1] == ["COM-03"]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("id", CAUSES)
def test_cause_of_an_error_is_noticed_in_time_and_stops_the_robot(tmp_path: Path, id: str) -> None:
    scene = CAUSES[id]
    run = play(tmp_path, id, scene)
    assert_follows(run, scene, assert_noticed(run, id, scene))


def test_an_overload_is_a_warning_that_the_drive_goes_on_with(tmp_path: Path) -> None:
    run = play(tmp_path, "DRV-28", of_code(WARNING, LEFT))
    assert "DRV-28" in run.fault_ids
