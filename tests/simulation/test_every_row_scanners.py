"""Each fault of a laser scanner is noticed in time, by the right name, and what must follow follows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from every_row import Scene, assert_follows, assert_noticed, cases, play
from rig import CALIBRATE, Run, run, write_mission
from scenes_of_scanners import SCANNER_SCENES

from artemis.values import Mode, Severity


@pytest.mark.sampled(4)
@cases(SCANNER_SCENES)
def test_fault_is_noticed_in_time_and_what_must_follow_follows(tmp_path: Path, id: str, scene: Scene) -> None:
    done = play(tmp_path, id, scene)
    assert_follows(done, scene, assert_noticed(done, id, scene))


WAIT = {"wait": {"seconds": 3.0}}


def driven(folder: Path, *after: dict[str, Any], **keys: Any) -> Run:  # noqa: ANN401 (of a mission)
    return run(write_mission(folder, [WAIT, *after], robot="artemis_lms100.yaml", **keys))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("id", ["LAS-01", "LAS-02", "LAS-06"])
def test_what_a_mission_does_not_need_may_fail(tmp_path: Path, id: str) -> None:
    done = driven(tmp_path, obstacles="off", simulation={"faults": [{"at_s": 3.5, "inject": id}]})
    assert done.status == 0
    assert id in done.fault_ids
    assert {fault.severity for fault in done.faults} == {Severity.WARN}


def test_what_one_step_needs_stops_the_robot(tmp_path: Path) -> None:
    step = {"follow": {"path": "line.csv", "follower": {"speed_m_s": 0.2}, "obstacles": {"mode": "stop"}}}
    done = driven(
        tmp_path, CALIBRATE, step, obstacles="off", simulation={"faults": [{"at_s": 3.5, "inject": "LAS-06"}]}
    )
    assert done.status == 1
    assert max(fault.severity for fault in done.faults if fault.id == "LAS-06") is Severity.CONTROLLED_STOP


def test_a_scanner_that_is_needed_and_never_comes_ends_the_run_before_it_moves(tmp_path: Path) -> None:
    faults = [{"at_s": 0.0, "inject": "LAS-01"}]
    done = driven(tmp_path, simulation={"faults": faults})
    assert done.status == 1
    assert Mode.READY not in done.modes
    assert done.fault_ids == ["LAS-01"]
    assert "Connection refused" in done.faults[0].text


@pytest.mark.slow
def test_a_scanner_that_comes_back_is_gone_on_with(tmp_path: Path) -> None:
    faults = [{"at_s": 2.501, "inject": "LAS-01", "duration_s": 0.4}]
    done = driven(tmp_path, obstacles="off", simulation={"faults": faults})
    assert (done.status, done.fault_ids) == (0, ["LAS-01"])
    lost = [seen.time for seen in done.seen if seen.tick.snapshot.verdict.faults]
    assert 2.5 <= min(lost) < 2.53
    assert max(lost) < 4.5
    after = [
        seen.tick.snapshot.sensed.scans
        for seen in done.seen
        if max(lost) < seen.time < done.ticks[-1].snapshot.time - 0.2
    ]
    assert all(after), "it measures again"
