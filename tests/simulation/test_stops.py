"""Quick stop, re-arm, and the way back from a fault: the robot moves again only when it is told to, in three acts."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import pytest
from rig import (
    BRAKING,
    CALIBRATE,
    NODE,
    STEERING,
    STOP_FRAMES,
    TRACTION,
    Rig,
    Run,
    controlword,
    driven,
    follow,
    standing,
    stick,
    straight,
    target_velocity,
    write_mission,
)

from artemis.drive_states import DriveState
from artemis.values import Mode, Request

pytestmark = pytest.mark.short_alignment

SPEED = 0.4
LENGTH = 2.0
ENABLE, QUICK_STOP = 0x0F, 0x0B
STEPS = [CALIBRATE, follow(SPEED)]
FILES = {"line.csv": straight(LENGTH)}
UNFIT = (Mode.INIT, Mode.QUICKSTOP, Mode.FAULT)


def attended_rig(folder: Path, *acts: tuple[float, str], end: float = 36.4) -> Rig:
    """A mission with a scripted operator, who is there until `end` [s]."""
    operator = [{"at_s": time, "do": act} for time, act in acts]
    operator.append({"at_s": end, "do": "acknowledge"})
    return Rig(write_mission(folder, STEPS, FILES, simulation={"operator": operator}))


def moved(seen: Run, begin: float, end: float) -> bool:
    """Whether a driven wheel truly turned between two times."""
    truths = [truth for truth in seen.world.history if begin <= truth.time <= end]
    assert truths
    return not all(standing(truth) for truth in truths)


def assert_path_was_finished(seen: Run) -> None:
    """To its end, from where it was left, without going back."""
    assert (seen.status, seen.is_done) == (0, True)
    assert driven(seen.in_mode(Mode.FOLLOW)[-1]) == pytest.approx(LENGTH, abs=0.03)
    start = seen.first(lambda s: s.tick.wish.reset_pose).pose
    end = seen.world.pose
    assert math.hypot(end.x - start.x, end.y - start.y) == pytest.approx(LENGTH, abs=0.04)
    arcs = [driven(s) for s in seen.in_mode(Mode.FOLLOW)]
    assert all(b > a - 0.005 for a, b in itertools.pairwise(arcs))


# ---------------------------------------------------------------------------------------------- a stop request


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A quick stop with no operator to arm again."""
    rig = Rig(write_mission(tmp_path_factory.mktemp("stopped"), STEPS, FILES))
    return rig.while_following(rig.request(Request.QUICKSTOP), distance=0.6, name="stop").run()


def test_the_first_stop_frames_leave_in_the_instant_of_the_request(stopped: Run) -> None:
    at = stopped.acts["stop"]
    assert stopped.first(lambda s: s.now >= at).tick.snapshot.sensed.urgent  # between two scheduled ticks
    first = [(time, frame.id, controlword(frame)) for time, frame in stopped.bus.sent if time >= at][:2]
    assert first == [(at, STOP_FRAMES + NODE[name], QUICK_STOP) for name in TRACTION]


def test_after_a_stop_request_the_robot_stands_within_its_braking_distance(stopped: Run) -> None:
    at = stopped.acts["stop"]
    before = max((t for t in stopped.world.history if t.time <= at), key=lambda t: t.time)
    assert before.speed == pytest.approx(SPEED, rel=0.05)
    assert stopped.stands_from() - at < SPEED / BRAKING + 0.03
    distance = math.hypot(stopped.world.pose.x - before.pose.x, stopped.world.pose.y - before.pose.y)
    assert distance < SPEED**2 / (2 * BRAKING) + 0.02


def test_the_wheels_hold_their_angle_until_the_robot_stands(stopped: Run) -> None:
    at = stopped.acts["stop"]
    moving = [truth for truth in stopped.truth_from(at) if not standing(truth)]
    assert {state for truth in moving for state in truth.states[2:]} == {DriveState.OPERATION_ENABLE}
    assert all(abs(angle) < math.radians(1.0) for truth in moving for angle in truth.wheel_angles)


def test_a_quick_stop_that_nobody_attends_ends_the_run_as_failed(stopped: Run) -> None:
    assert (stopped.status, stopped.fault_ids) == (1, [])
    assert stopped.modes[-2:] == [Mode.QUICKSTOP, Mode.END]


def test_after_a_quick_stop_the_robot_does_not_move_by_itself_and_an_arm_finishes_the_path(tmp_path: Path) -> None:
    seen = attended_rig(tmp_path, (6.4, "quickstop"), (12.4, "arm"), end=12.4).run()
    assert driven(seen.in_mode(Mode.FOLLOW)[0]) < 0.01
    assert seen.modes.count(Mode.FOLLOW) == 2
    assert moved(seen, 6.3, 6.5)
    assert not moved(seen, 6.9, 12.4)
    assert moved(seen, 12.4, 13.4)
    assert_path_was_finished(seen)


def test_while_it_waits_for_the_arm_the_drives_are_off(tmp_path: Path) -> None:
    seen = attended_rig(tmp_path, (6.4, "quickstop"), (12.4, "arm"), end=12.4).run()
    waiting = [truth for truth in seen.world.history if 7.0 < truth.time < 12.4]
    assert {state for truth in waiting for state in truth.states} == {DriveState.SWITCH_ON_DISABLED}


def test_an_acknowledgment_after_a_quick_stop_moves_nothing(tmp_path: Path) -> None:
    acts = ((6.4, "quickstop"), (7.4, "acknowledge"), (8.4, "acknowledge"), (12.4, "arm"))
    seen = attended_rig(tmp_path, *acts, end=12.4).run()
    assert not moved(seen, 6.9, 12.4)
    assert all(controlword(frame) != ENABLE for time, frame in seen.bus.sent if 6.9 < time < 12.4)
    assert_path_was_finished(seen)


def test_an_arm_while_the_robot_still_brakes_is_not_kept_for_later(tmp_path: Path) -> None:
    seen = attended_rig(tmp_path, (6.4, "quickstop"), (6.45, "arm"), end=10.4).run()
    assert seen.status == 1
    assert not moved(seen, 6.9, seen.world.time)


def test_a_stop_request_before_anything_is_aligned_leads_through_the_whole_bring_up_again(tmp_path: Path) -> None:
    seen = attended_rig(tmp_path, (0.95, "quickstop"), (2.45, "arm"), end=2.45).run()
    assert seen.modes[:4] == [Mode.INIT, Mode.QUICKSTOP, Mode.INIT, Mode.READY]
    assert_path_was_finished(seen)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("mode", [Mode.READY, Mode.CALIBRATE, Mode.FOLLOW])
@pytest.mark.parametrize("delay", [0.003, 0.5])
def test_a_stop_request_is_obeyed_in_every_mode(tmp_path: Path, mode: Mode, delay: float) -> None:
    rig = Rig(write_mission(tmp_path, [{"wait": {"seconds": 1.0}}, *STEPS], FILES))
    rig.when(lambda s: s.mode is mode, rig.request(Request.QUICKSTOP), after=delay, name="stop")
    assert_stopped(rig.run())


PHASES = ["listening", "secure", "configure", "reading potentiometers", "enabling", "aligning"]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("phase", PHASES)
def test_a_stop_request_is_obeyed_in_every_phase_of_the_bring_up(tmp_path: Path, phase: str) -> None:
    rig = Rig(write_mission(tmp_path, STEPS, FILES))
    rig.when(lambda s: s.phase == phase, rig.request(Request.QUICKSTOP), after=0.003, name="stop")
    assert_stopped(rig.run())


def test_a_stop_request_while_the_watchdog_is_being_proven_ends_without_motion(tmp_path: Path) -> None:
    """The drives report the heartbeat that was withheld from them: that is a fault now."""
    rig = Rig(write_mission(tmp_path, STEPS, FILES))
    quickstop = rig.request(Request.QUICKSTOP)
    rig.when(lambda s: not s.tick.wish.heartbeat and s.tick.wish.exchange, quickstop, after=0.003, name="stop")
    seen = rig.run()
    assert seen.first(lambda s: s.now >= seen.acts["stop"]).mode is Mode.QUICKSTOP
    assert seen.status == 1
    assert all(controlword(frame) != ENABLE for _, frame in seen.bus.sent)


def assert_stopped(seen: Run) -> None:
    at = seen.acts["stop"]
    assert seen.first(lambda s: s.now >= at).mode is Mode.QUICKSTOP
    assert (seen.status, seen.fault_ids) == (1, [])
    assert all(standing(truth) for truth in seen.truth_from(at + 0.5))
    assert {node.state for node in seen.world.nodes} == {DriveState.SWITCH_ON_DISABLED}


# ---------------------------------------------------------------------------------------------- back from a fault


def faulty_run(folder: Path, *acts: tuple[float, str], end: float) -> Run:
    """A following error of a steering drive after 0.6 m."""
    rig = attended_rig(folder, *acts, end=end)
    return rig.while_following(rig.emergency("steer-left", 0x8611), distance=0.6, name="emergency").run()


@pytest.fixture(scope="module")
def recovered(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A fault, acknowledged at 13 s and armed at 18 s."""
    acts = ((9.4, "acknowledge"), (14.4, "arm"))
    return faulty_run(tmp_path_factory.mktemp("recovered"), *acts, end=14.4)


def test_after_fault_acknowledgment_and_arm_the_path_is_finished_from_where_it_stopped(recovered: Run) -> None:
    assert recovered.fault_ids == ["DRV-25"]
    assert recovered.acts["emergency"] < 8.9
    later = recovered.modes[recovered.modes.index(Mode.FAULT) :]
    assert later == [Mode.FAULT, Mode.INIT, Mode.READY, Mode.FOLLOW, Mode.READY, Mode.END]
    assert_path_was_finished(recovered)


def test_after_an_acknowledgment_the_drives_are_brought_up_from_scratch_and_stay_off(recovered: Run) -> None:
    written = [time for time, frame in recovered.bus.sent if frame.id == 0x601 and frame.data[:3] == b"\x2b\x40\x60"]
    assert any(time > 9.4 for time in written)  # secured again over SDO
    watching = max(time for time, frame in recovered.bus.sent if frame.data[:4] == b"\x23\x16\x10\x01" and time < 14.4)
    losses = [f for f in recovered.bus.heard if f.id & 0x780 == 0x080 and f.data[:2] == b"\x30\x81"]
    again = {f.id for f in losses if 9.4 < watching < f.time < 14.4}
    assert again == {0x080 + node for node in NODE.values()}  # the watchdog was proven again
    assert all(controlword(frame) != ENABLE for time, frame in recovered.bus.sent if 9.4 <= time < 14.4)


def test_nothing_moves_between_the_fault_and_the_arm(recovered: Run) -> None:
    assert not moved(recovered, recovered.acts["emergency"] + 1.0, 14.4)
    assert moved(recovered, 14.4, 22.4)


def test_an_acknowledgment_alone_never_leads_to_motion(tmp_path: Path) -> None:
    seen = faulty_run(
        tmp_path, (9.4, "acknowledge"), (11.4, "acknowledge"), (16.4, "acknowledge"), (20.4, "end"), end=20.4
    )
    assert seen.status == 1
    assert not moved(seen, seen.acts["emergency"] + 1.0, seen.world.time)
    assert Mode.READY not in seen.modes[seen.modes.index(Mode.FAULT) :]


def test_an_arm_without_an_acknowledgment_does_nothing_in_a_fault(tmp_path: Path) -> None:
    seen = faulty_run(tmp_path, (9.4, "arm"), (10.4, "arm"), (12.4, "end"), end=12.4)
    assert seen.modes[-2:] == [Mode.FAULT, Mode.END]
    assert not moved(seen, seen.acts["emergency"] + 1.0, seen.world.time)


def test_a_second_fault_after_the_recovery_stops_the_robot_again(tmp_path: Path) -> None:
    rig = attended_rig(tmp_path, (9.4, "acknowledge"), (14.4, "arm"), end=14.4)
    rig.while_following(rig.emergency("steer-left", 0x8611), distance=0.6)
    rig.while_following(rig.emergency("traction-left", 0x2310), distance=1.4)
    seen = rig.run()
    assert (seen.status, seen.fault_ids) == (1, ["DRV-25", "DRV-02"])
    assert seen.modes.count(Mode.FAULT) == 2


# ---------------------------------------------------------------------------------------------- invariants of frames


def test_no_velocity_is_commanded_in_init_quickstop_and_fault(stopped: Run, recovered: Run) -> None:
    frames = 0
    for seen in (stopped, recovered):
        for now in seen.in_mode(*UNFIT):
            for frame in now.sent:
                velocity = target_velocity(frame)
                frames += velocity is not None
                assert not velocity, (now.time, now.mode, now.phase, frame)
    assert frames > 100


def test_a_steering_angle_is_commanded_in_init_only_for_alignment(recovered: Run) -> None:
    for now in recovered.in_mode(Mode.INIT):
        enabled = [f for f in now.sent if controlword(f) == ENABLE and f.id & 0x7F in (NODE[name] for name in STEERING)]
        assert not enabled or now.phase in ("enabling", "aligning", "aligned", "reference", "clear target"), now.phase


def test_a_host_that_was_held_up_at_full_speed_brakes_no_harder_than_the_batteries_take(tmp_path: Path) -> None:
    held_up = {"at_s": 9.031, "inject": "SYS-07", "seconds": 0.147}
    simulation = {"faults": [held_up], "true_robot": {"slip": 0.018}}
    files = {"stick.csv": stick((0.0, 0.0, 0.0, 0), (5.5, 0.0, -1.0, 0), (6.7, 0.0, -1.0, 1), (14.0, 0.0, 0.0, 0))}
    steps = [{"teleop": {"input": "stick", "until": {"seconds": 8.0}}}]
    inputs = {"stick": {"plugin": "scripted", "file": "stick.csv", "max_speed_m_s": 0.67}}
    seen = Rig(write_mission(tmp_path, steps, files, inputs=inputs, simulation=simulation)).run()
    assert seen.fault_ids == ["SYS-01", "COM-31"]


@pytest.mark.parametrize("seconds", [0.16, 0.18])
def test_wheels_that_were_blocked_and_come_free_are_still_braked_by_their_drives(
    stopped: Run, tmp_path: Path, seconds: float
) -> None:
    at = stopped.acts["stop"]
    blocked = [{"at_s": at - 0.07, "inject": "PTH-07", "duration_s": seconds}]
    rig = Rig(write_mission(tmp_path, STEPS, FILES, simulation={"faults": blocked}))
    seen = rig.at(at, rig.request(Request.QUICKSTOP)).run()
    off = seen.first(lambda s: s.now > at and s.tick.wish.phase == "switching off")
    assert not moved(seen, off.now, math.inf)
