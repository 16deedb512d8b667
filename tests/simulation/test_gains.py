"""Other regulator gains are tried in a run, and whatever ends it, the drives have the robot file's again."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rig import CALIBRATE, Rig, Run, Seen, follow, write_mission

from artemis.commands.gains_trial import Findings, Trial, findings
from artemis.mission.schema import NewGains
from artemis.recording.mcap_reader import Recording
from artemis.report.responses import read_traces
from artemis.sim.epos import SimEpos
from artemis.sim.epos_failures import Speech
from artemis.values import DriveState, JobKind, Mode, Request

LEFT, DRIVEN = "steer-left", "traction-left"
OBJECTS = ((0x60F6, 1), (0x60F6, 2), (0x60F9, 1), (0x60F9, 2), (0x60FB, 1), (0x60FB, 2), (0x60FB, 3))
FILE = (500, 150, 1000, 100, 150, 10, 200)
NEW = (500, 150, 1000, 100, 600, 10, 200)
TURN: dict[str, Any] = {"calibrate": {"turn": {}}}
Act = Callable[[Rig], None]


def gains_of(drive: SimEpos) -> tuple[int, ...]:
    found = [drive.read(index, sub) for index, sub in OBJECTS]
    assert all(isinstance(number, int) for number in found)
    return tuple(int(number) for number in found)


def trying(*position: int, drive: str = LEFT) -> dict[str, Any]:
    return {"calibrate": {"gains": {drive: {"position": list(position)}}}}


def rig(folder: Path, *steps: dict[str, Any], **keys: Any) -> Rig:  # noqa: ANN401 (as in a mission)
    return Rig(write_mission(folder, steps, **keys))


def turning_anew(seen: Seen) -> bool:
    """The wheels turn with the new gains."""
    return seen.phase == "turning" and seen.tick.step == 2


def found_in(run: Run) -> Findings:
    """What the command makes of it."""
    assert run.outcome is not None
    new = NewGains(position=(600, 10, 200))
    return findings(
        Recording(run.outcome.run.path), Trial(drives=(LEFT,), role="steering", side="left", step=5.0, new=new)
    )


def assert_restored(run: Run) -> None:
    assert gains_of(run.world.drive(LEFT)) == FILE
    assert {node.state for node in run.world.nodes} == {DriveState.SWITCH_ON_DISABLED}


def test_a_trial_shows_both_responses_and_leaves_the_drives_as_they_were(tmp_path: Path) -> None:
    kept: list[tuple[int, ...]] = []
    trial = rig(tmp_path, TURN, trying(600, 10, 200), TURN, tick_hz=200)
    trial.when(turning_anew, lambda: kept.append(gains_of(trial.drive(LEFT))))
    run = trial.run()
    assert (run.status, run.fault_ids, kept) == (0, [], [NEW])
    assert_restored(run)
    assert run.outcome is not None
    traces = read_traces(Recording(run.outcome.run.path), [LEFT], [0, 2])
    now, new = (traces[LEFT, step].response() for step in (0, 2))
    assert now.step == pytest.approx(5.0)
    assert new.step == pytest.approx(5.0)
    assert now.overshoot == pytest.approx(0.0, abs=1e-3)
    assert new.overshoot is not None
    assert new.overshoot > 0.05
    assert now.ramp == pytest.approx(5.0 / 33.0, abs=0.011)
    assert run.recompute().difference is None


def test_gains_are_written_while_every_drive_is_off(tmp_path: Path) -> None:
    run = rig(tmp_path, trying(600, 10, 200), TURN).run()
    written = [
        {drive.state for drive in seen.tick.snapshot.sensed.drives}
        for seen in run.seen
        if any(job.kind is JobKind.WRITE_GAINS for job in seen.tick.wish.jobs)
    ]
    assert written == [{DriveState.SWITCH_ON_DISABLED}] * 2  # and again at the end
    assert run.modes == [Mode.INIT, Mode.READY, Mode.CALIBRATE, Mode.READY, Mode.CALIBRATE, Mode.READY, Mode.END]


def test_a_turn_is_no_faster_than_the_gate_and_drives_nothing(tmp_path: Path) -> None:
    run = rig(tmp_path, {"calibrate": {"turn": {"side": "right", "angle_deg": 20.0}}}).run()
    turning = [seen for seen in run.seen if seen.phase.startswith("turning")]
    angles = [seen.tick.set_points.steering_right for seen in turning]
    assert max(angles) == pytest.approx(20.0 * 3.14159265 / 180.0)
    assert angles[-1] == 0.0
    rate = 33.0 * 3.14159265 / 180.0
    assert max(abs(b - a) for a, b in itertools.pairwise(angles)) <= 1.001 * rate * 0.02
    assert {seen.tick.snapshot.sensed.drives[0].state for seen in turning[2:]} == {DriveState.SWITCH_ON_DISABLED}
    assert {seen.tick.set_points.speed for seen in turning} == {0.0}


def test_a_driven_wheel_is_tried_on_a_path(tmp_path: Path) -> None:
    gains = {"calibrate": {"gains": {DRIVEN: {"velocity": [1200, 900]}}}}
    back = {"follow": {**follow()["follow"], "from_end": True}}
    run = rig(tmp_path, CALIBRATE, follow(), back, gains, follow(), tick_hz=200).run()
    assert (run.status, run.fault_ids) == (0, [])
    assert run.outcome is not None
    traces = read_traces(Recording(run.outcome.run.path), [DRIVEN], [1, 4])
    now, new = (traces[DRIVEN, step].response() for step in (1, 4))
    assert now.overshoot == pytest.approx(0.0, abs=0.02)
    assert new.overshoot is not None
    assert new.overshoot > 0.05
    assert now.settled_5 is not None
    assert new.settled_5 is not None
    assert new.settled_5 > now.settled_5 + 0.2
    assert gains_of(run.world.drive(DRIVEN)) == (400, 120, 1200, 180, 150, 10, 200)


@pytest.mark.parametrize(
    ("act", "mode"),
    [
        (lambda rig: rig.request(Request.END)(), Mode.END),
        (lambda rig: rig.request(Request.QUICKSTOP)(), Mode.QUICKSTOP),
        (lambda rig: rig.emergency(LEFT, 0x8611)(), Mode.FAULT),
        (lambda rig: rig.emergency(DRIVEN, 0x2310)(), Mode.FAULT),
    ],
    ids=["end", "quick stop", "the drive's fault", "another's fault"],
)
def test_whatever_breaks_a_trial_off_the_old_gains_come_back(tmp_path: Path, act: Act, mode: Mode) -> None:
    trial = rig(tmp_path, TURN, trying(600, 10, 200), TURN)
    run = trial.when(turning_anew, lambda: act(trial), after=0.105).run()
    assert mode in run.modes
    assert run.status == 1
    assert_restored(run)
    found = found_in(run)
    assert (found.unrestored, found.stopped) == ({}, mode is not Mode.END)
    assert found.responses["now"][0].settled_2 is not None


def test_an_end_that_overtakes_the_writing_leaves_the_old_gains(tmp_path: Path) -> None:
    def is_written(seen: Seen) -> bool:
        return any(job.kind is JobKind.WRITE_GAINS for job in seen.tick.wish.jobs)

    trial = rig(tmp_path, TURN, trying(600, 10, 200), TURN)
    run = trial.when(is_written, lambda: trial.request(Request.END)(), after=0.001).run()
    assert_restored(run)


def test_a_drive_that_stands_still_without_p_is_a_fault_and_gets_its_gains_back(tmp_path: Path) -> None:
    run = rig(tmp_path, TURN, trying(0, 10, 200), TURN).run()
    assert {"DRV-25", "STE-01"} & set(run.fault_ids)
    assert run.status == 1
    assert_restored(run)


def test_a_drive_that_takes_no_gains_back_is_told_with_what_it_has(tmp_path: Path) -> None:
    trial = rig(tmp_path, TURN, trying(600, 10, 200), TURN)
    heard: list[Callable[[], None]] = []
    run = trial.when(turning_anew, lambda: heard.append(trial.drive(LEFT).failures.impede(Speech.SDO))).run()
    assert run.status == 1
    told = [fault.text for fault in run.faults if "on trial" in fault.text]
    assert len(told) == 1
    assert "position 600,10,200" in told[0]
    assert "robot file" in told[0]
    assert gains_of(run.world.drive(LEFT)) == NEW  # until its power goes
    found = found_in(run)
    assert "no answer" in found.unrestored[LEFT]
    assert list(found.responses) == ["now", "new"]
    heard[0]()
    again = Rig(write_mission(tmp_path / "again", [CALIBRATE]), world=run.world, start=run.world.time)
    assert again.run().status == 0
    assert gains_of(run.world.drive(LEFT)) == FILE


@pytest.mark.parametrize("id", ["COM-07", "COM-10"])
def test_a_drive_that_refuses_the_gains_is_not_enabled_with_them(tmp_path: Path, id: str) -> None:
    fault = {"at_s": 1.0, "inject": id, "node": LEFT, "index": 0x60FB, "sub": 1}
    run = rig(tmp_path, TURN, trying(600, 10, 200), TURN, simulation={"faults": [fault]}).run()
    assert run.status == 1
    assert id in run.fault_ids
    assert not any(turning_anew(seen) for seen in run.seen)
    assert gains_of(run.world.drive(LEFT)) == FILE


def test_after_a_fault_the_robot_file_s_gains_are_in_force(tmp_path: Path) -> None:
    operator = [{"at_s": 12.0, "do": "acknowledge"}, {"at_s": 13.0, "do": "arm"}]
    kept: list[tuple[int, ...]] = []
    trial = rig(tmp_path, TURN, trying(600, 10, 200), TURN, simulation={"operator": operator})
    trial.when(turning_anew, trial.emergency(LEFT, 0x8611), after=0.105)
    trial.when(lambda seen: seen.time > 13.0 and turning_anew(seen), lambda: kept.append(gains_of(trial.drive(LEFT))))
    run = trial.run()
    assert (run.status, kept) == (0, [FILE])
