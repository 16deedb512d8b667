"""Other regulator gains are tried in a run, and whatever ends it, the drives have the robot file's again."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from rig import CALIBRATE, STICK, Rig, Run, Seen, follow, stick, write_mission

from artemis.commands.gains_trial import Findings, GainsWatch, Trial, findings
from artemis.drive_states import DriveState
from artemis.mission.actions import NewGains
from artemis.recording.mcap_reader import Recording
from artemis.report.responses import read_traces
from artemis.sim.epos import SimEpos
from artemis.sim.epos_failures import Speech
from artemis.sim.regulators import Loop, Regulators, regulators_for
from artemis.values import JobKind, Mode, Request

pytestmark = pytest.mark.short_alignment

LEFT, DRIVEN = "steer-left", "traction-left"
OBJECTS = ((0x60F6, 1), (0x60F6, 2), (0x60F9, 1), (0x60F9, 2), (0x60FB, 1), (0x60FB, 2), (0x60FB, 3))
FILE = (500, 150, 1000, 100, 150, 10, 200)
NEW = (500, 150, 1000, 100, 600, 10, 200)
COUNTS_PER_DEGREE = 2000 * 946 / 360
RPM = 60.0 / 72.0 / 2.12766e-4
"""Of a traction motor, per m/s."""
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
    return seen.phase == "turning" and seen.tick.position.step == 2


def found_in(run: Run) -> tuple[GainsWatch, Findings]:
    """What the command makes of it."""
    assert run.outcome is not None
    watch = GainsWatch()
    for tick in run.ticks:
        watch.see(tick, ())
    new = NewGains(position=(600, 10, 200))
    trial = Trial(drives=(LEFT,), role="steering", side="left", step=5.0, new=new)
    return watch, findings(Recording(run.outcome.run.path), trial)


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
    assert run.modes == [Mode.INIT, Mode.READY, Mode.CALIBRATE, Mode.READY, Mode.CALIBRATE, Mode.END]


@pytest.mark.parametrize("tick_hz", [50, 200])
def test_gains_may_be_tried_first_of_all(tmp_path: Path, tick_hz: int) -> None:
    run = rig(tmp_path, trying(300, 10, 200), CALIBRATE, tick_hz=tick_hz).run()
    assert (run.status, run.fault_ids) == (0, [])


@pytest.mark.slow
@pytest.mark.sampled(3)
@pytest.mark.parametrize("tick_hz", [50, 200])
@pytest.mark.parametrize("step", [trying(300, 10, 200), TURN], ids=["gains", "turn"])
def test_wheels_that_were_left_turned_are_straightened_while_nothing_drives(
    tmp_path: Path, tick_hz: int, step: dict[str, Any]
) -> None:
    curve = stick((0.0, 0.0, 0.0, 0), (4.4, 0.0, 0.0, 0), (4.5, 0.5, 0.3, 1), (26.4, 0.5, 0.3, 1))
    drive = {"teleop": {"input": "stick", "until": {"seconds": 8.0}}}
    steps: list[dict[str, Any]] = [CALIBRATE, drive, step, {"wait": {"seconds": 0.5}}]
    run = Rig(write_mission(tmp_path, steps, {"stick.csv": curve}, inputs=STICK, tick_hz=tick_hz)).run()
    assert (run.status, run.fault_ids) == (0, [])
    tried = [seen for seen in run.seen if seen.mode is Mode.CALIBRATE and seen.tick.position.step == 2]
    assert abs(tried[0].tick.set_points.steering) > 0.1
    assert {seen.tick.set_points.speed_left for seen in tried} == {0.0}
    assert run.first(lambda seen: seen.time > tried[-1].time).tick.set_points.steering == 0.0


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


@pytest.mark.exhaustive
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
    watch, found = found_in(run)
    assert (watch.restored, watch.unrestored, watch.stopped) == ({LEFT}, {}, mode is not Mode.END)
    assert found.responses["now"][0].settled_2 is not None


def test_an_end_that_overtakes_the_writing_leaves_the_old_gains(tmp_path: Path) -> None:
    def is_written(seen: Seen) -> bool:
        return any(job.kind is JobKind.WRITE_GAINS for job in seen.tick.wish.jobs)

    trial = rig(tmp_path, TURN, trying(600, 10, 200), TURN)
    run = trial.when(is_written, lambda: trial.request(Request.END)(), after=0.001).run()
    assert_restored(run)
    watch, _ = found_in(run)
    assert (watch.restored, watch.unrestored) == ({LEFT}, {})


def test_what_a_run_says_that_was_killed_before_it_took_them_back(tmp_path: Path) -> None:
    trial = rig(tmp_path, TURN, trying(600, 10, 200), TURN)
    run = trial.when(turning_anew, trial.kill).run_until_killed()
    watch = GainsWatch()
    for tick in run.ticks:
        watch.see(tick, ())
    assert watch.restored == set()
    assert watch.unrestored == {LEFT: "the run ended before they were taken back"}


def test_a_drive_that_stands_still_without_p_is_a_fault_and_gets_its_gains_back(tmp_path: Path) -> None:
    run = rig(tmp_path, TURN, trying(0, 10, 200), TURN).run()
    assert {"DRV-25", "STE-01"} & set(run.fault_ids)
    assert run.status == 1
    assert_restored(run)


class Swinging(Loop):
    """A loop that goes to and fro about its demand, for ever."""

    amplitude, frequency = 0.0, 0.0
    _since = 0.0

    def shaped(self, demand: float, present: float, dt: float) -> float:
        self._since += dt
        return demand + self.amplitude * math.sin(2.0 * math.pi * self.frequency * self._since)


def swing(monkeypatch: pytest.MonkeyPatch, degrees: float, frequency: float) -> None:
    """Steered wheels with other gains than the robot file's swing for ever."""

    def regulators(gains: Sequence[int], nominal: Sequence[int]) -> Regulators | None:
        found = regulators_for(gains, nominal)
        if found is not None and tuple(gains[4:]) != tuple(nominal[4:]):
            found.position = Swinging(4.0, 1.0, 30.0)
            found.position.amplitude, found.position.frequency = degrees * COUNTS_PER_DEGREE, frequency
        return found

    monkeypatch.setattr("artemis.sim.epos_motion.regulators_for", regulators)


@pytest.mark.sampled(8)
@pytest.mark.parametrize(("degrees", "frequency"), [(1.8, 1.7), (1.8, 3.0), (1.0, 8.0), (0.7, 8.0)])
@pytest.mark.parametrize("tick_hz", [50, 200])
def test_a_wheel_that_swings_is_a_fault_though_no_error_lasts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, degrees: float, frequency: float, tick_hz: int
) -> None:
    swing(monkeypatch, degrees, frequency)
    run = rig(tmp_path, TURN, trying(600, 10, 200), TURN, TURN, tick_hz=tick_hz).run()
    assert [(fault.id, fault.device) for fault in run.faults] == [("CAL-01", LEFT)]
    assert "oscillates" in run.faults[0].text
    assert run.status == 1
    assert_restored(run)
    begun = run.first(lambda seen: seen.phase == "straightening").time
    assert run.first(lambda seen: seen.mode is Mode.FAULT).time - begun < 3.0
    assert run.recompute().difference is None


@pytest.mark.sampled(6)
@pytest.mark.parametrize(("speed", "frequency"), [(0.1, 3.0), (0.1, 8.0), (0.06, 8.0)])
@pytest.mark.parametrize("tick_hz", [50, 200])
def test_a_driven_wheel_that_swings_is_a_fault_though_no_error_lasts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, speed: float, frequency: float, tick_hz: int
) -> None:
    def regulators(gains: Sequence[int], nominal: Sequence[int]) -> Regulators | None:
        found = regulators_for(gains, nominal)
        if found is not None:
            found.velocity = Swinging(1.0, 1.0, 10.0)
            found.velocity.amplitude, found.velocity.frequency = speed * RPM, frequency
        return found

    monkeypatch.setattr("artemis.sim.epos_motion.regulators_for", regulators)
    gains = {"calibrate": {"gains": {DRIVEN: {"velocity": [2400, 360]}}}}
    run = rig(tmp_path, CALIBRATE, gains, follow(), tick_hz=tick_hz).run()
    assert (run.faults[0].id, run.faults[0].device) == ("CAL-01", DRIVEN)
    assert run.status == 1
    assert gains_of(run.world.drive(DRIVEN)) == (400, 120, 1200, 180, 150, 10, 200)
    begun = run.first(lambda seen: seen.mode is Mode.FOLLOW).time
    assert run.first(lambda seen: seen.mode is Mode.FAULT).time - begun < 2.0


def test_gains_that_lack_damping_are_a_fault_and_those_that_only_overshoot_are_none(tmp_path: Path) -> None:
    for name, gains, faults in (("none", (600, 10, 0), ["CAL-01"]), ("less", (600, 10, 100), [])):
        run = rig(tmp_path / name, TURN, trying(*gains), TURN).run()
        assert (run.fault_ids, run.status) == (faults, len(faults))
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
    watch, found = found_in(run)
    assert "no answer" in watch.unrestored[LEFT]
    assert watch.restored == set()
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
    operator = [{"at_s": 10.2, "do": "acknowledge"}, {"at_s": 11.2, "do": "arm"}]
    kept: list[tuple[int, ...]] = []
    trial = rig(tmp_path, TURN, trying(600, 10, 200), TURN, simulation={"operator": operator})
    trial.when(turning_anew, trial.emergency(LEFT, 0x8611), after=0.105)
    trial.when(lambda seen: seen.time > 11.2 and turning_anew(seen), lambda: kept.append(gains_of(trial.drive(LEFT))))
    run = trial.run()
    assert (run.status, kept) == (0, [FILE])
