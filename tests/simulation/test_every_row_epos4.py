"""What an EPOS4 reports is noticed in time and stops the robot; so is what it makes of causes outside of it."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import pytest
from every_row import Scene, assert_follows, assert_noticed, name_of, play
from watched import DRIVES, TRACTION

from artemis.sim.epos4_errors import ERRORS_4
from artemis.sim.epos_errors import Reaction
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


@pytest.mark.sampled(3)
@pytest.mark.parametrize("id", CAUSES)
def test_cause_of_an_error_is_noticed_in_time_and_stops_the_robot(tmp_path: Path, id: str) -> None:
    scene = CAUSES[id]
    run = play(tmp_path, id, scene)
    assert_follows(run, scene, assert_noticed(run, id, scene))


def test_an_overload_is_a_warning_that_the_drive_goes_on_with(tmp_path: Path) -> None:
    run = play(tmp_path, "DRV-28", of_code(WARNING, LEFT))
    assert "DRV-28" in run.fault_ids
