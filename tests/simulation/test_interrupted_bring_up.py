"""Stop and end requests while the drives are brought up, drives found moving, and what a run leaves behind."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rig import (
    CALIBRATE,
    DRIVES,
    NODE,
    SDO_REQUEST,
    STEERING,
    TRACTION,
    Rig,
    Run,
    Seen,
    WatchedWorld,
    controlword,
    driven,
    follow,
    standing,
    straight,
    write_mission,
)

from artemis.devices.can_bus import Frame
from artemis.drive_states import DriveState, Nmt
from artemis.mission.loading import load_mission
from artemis.sim.epos_settings import SimSettings
from artemis.sim.world import PlantParameters
from artemis.values import JobKind, Mode, Request

LATER = [{"at_s": 5.0, "do": "end"}]
"""Somebody is there, and might arm."""
OFF, QUICK_STOP, ENABLE = 0x00, 0x0B, 0x0F
CONSUMER, SOFTWARE = 0x1016, 0x2003
WAIT = {"wait": {"seconds": 0.1}}
STEPS = [CALIBRATE, follow(0.4)]
SPEED = 0.38
"""Of the robot that a run left behind [m/s]: 1500 rpm of the motors."""


# ---------------------------------------------------------------------------------------------- drives found moving


def step(world: WatchedWorld, seconds: float) -> None:
    """Time passes, nobody listens."""
    for _ in range(round(seconds / 0.002)):
        world.advance(world.time + 0.002)
        for node in world.nodes:
            node.advance(world.time)
            node.outbox.clear()


def left_running(mission: Path) -> WatchedWorld:
    """A robot that drives straight ahead, as a run leaves it that was killed before the drives watched it."""
    world = WatchedWorld(
        load_mission(mission).robot, PlantParameters(start_steering_left_deg=0, start_steering_right_deg=0)
    )
    step(world, 0.1)
    for name in DRIVES:
        drive = world.drive(name)
        drive.poke(0x6060, 0, 3 if name in TRACTION else -1)
        for word in (0x06, ENABLE):
            drive.poke(0x6040, 0, word)
            step(world, 0.05)
    for name, sign in zip(TRACTION, (1, -1), strict=True):
        world.drive(name).poke(0x60FF, 0, sign * 1500)
        world.drive(name).poke(0x6040, 0, ENABLE)
    step(world, 0.5)
    assert world.speed == pytest.approx(SPEED, rel=0.05)
    return world


def found_moving(
    folder: Path,
    prepare: Callable[[Path, WatchedWorld], None] = lambda mission, world: None,
    **keys: Any,  # noqa: ANN401
) -> Rig:
    """A run that meets a moving robot; `prepare` may change robot file and drives before."""
    mission = write_mission(folder, STEPS, **keys)
    world = left_running(mission)
    prepare(mission, world)
    return Rig(mission, world=world, start=world.time)


def assert_stopped_by_quick_stop(seen: Run, begin: float) -> None:
    """Both sides together by their own ramp, power off only at rest, and nothing turns any more."""
    first = {}
    for name in TRACTION:
        sent = [
            (t, word) for t, f in seen.bus.sent if f.id & 0x7F == NODE[name] and (word := controlword(f)) is not None
        ]
        first[name], word = sent[0]
        assert word == QUICK_STOP
        off = next(time for time, word in sent if word == OFF)
        assert standing(seen.truth_at(off))
        assert not standing(seen.truth_at(first[name]))
    assert abs(first["traction-left"] - first["traction-right"]) < 0.005
    assert max(first.values()) - begin < 0.4
    assert all(standing(truth) for truth in seen.truth_from(max(first.values()) + 0.5))


def assert_at_rest(seen: Run) -> None:
    """Off, no longer watching, Pre-Operational, without a fault; and so they stay."""
    for _ in range(2):
        for node in seen.world.nodes:
            found = (node.name, node.state, node.nmt, int(node.read(CONSUMER, 1)) & 0xFFFF)
            assert found == (node.name, DriveState.SWITCH_ON_DISABLED, Nmt.PRE_OPERATIONAL, 0)
        assert standing(seen.world.truth)
        step(seen.world, 0.5)


FOUND_MOVING = [0.0, 0.1, 0.29, 0.301, 0.302, 0.31, 0.33, 0.4]
"""While listening, while securing, and when the robot stands already [s]."""


@pytest.mark.sampled(3)
@pytest.mark.parametrize("time", FOUND_MOVING)
@pytest.mark.parametrize("request_", [Request.QUICKSTOP, Request.END], ids=["stop", "end"])
def test_drives_found_moving_are_stopped_though_the_bring_up_is_interrupted(
    tmp_path: Path, request_: Request, time: float
) -> None:
    rig = found_moving(tmp_path)
    begin = rig._start
    seen = rig.at(time, rig.request(request_), name="interrupt").run()
    assert seen.first(lambda s: s.now >= seen.acts["interrupt"]).mode is not Mode.READY
    assert_stopped_by_quick_stop(seen, begin)
    assert all(controlword(frame) != ENABLE for _, frame in seen.bus.sent)
    assert (seen.status, seen.fault_ids) == (1, [])
    assert_at_rest(seen)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("time", FOUND_MOVING)
def test_drives_found_moving_are_stopped_at_once_also_when_somebody_could_arm(tmp_path: Path, time: float) -> None:
    rig = found_moving(tmp_path, simulation={"operator": [{"at_s": time + 3.0, "do": "end"}]})
    seen = rig.at(time, rig.request(Request.QUICKSTOP), name="stop").run()
    assert_stopped_by_quick_stop(seen, rig._start)
    waiting = seen.truth_at(rig._start + time + 2.9)
    assert waiting.states == (DriveState.SWITCH_ON_DISABLED,) * 4
    assert seen.modes == [Mode.INIT, Mode.QUICKSTOP, Mode.END]
    assert_at_rest(seen)


@pytest.mark.parametrize("request_", [Request.QUICKSTOP, Request.END], ids=["stop", "end"])
def test_drives_found_moving_are_stopped_though_their_configuration_is_interrupted(
    tmp_path: Path, request_: Request
) -> None:
    rig = found_moving(tmp_path)
    rig.when(lambda s: s.phase == "configure", rig.request(request_), after=0.03, name="interrupt")
    seen = rig.run()
    assert_stopped_by_quick_stop(seen, rig._start)
    assert all(controlword(frame) != ENABLE for _, frame in seen.bus.sent)
    assert (seen.status, seen.fault_ids) == (1, [])
    assert_at_rest(seen)


@pytest.mark.parametrize("request_", [Request.QUICKSTOP, Request.END], ids=["stop", "end"])
def test_the_wheels_hold_their_angle_while_a_robot_found_moving_stops(tmp_path: Path, request_: Request) -> None:
    rig = found_moving(tmp_path)
    seen = rig.at(0.1, rig.request(request_), name="interrupt").run()
    moving = [truth for truth in seen.truth_from(seen.acts["interrupt"]) if not standing(truth)]
    assert len(moving) > 10
    assert {state for truth in moving for state in truth.states[2:]} == {DriveState.OPERATION_ENABLE}


def another_serial_number(mission: Path, world: WatchedWorld) -> None:
    file = mission.parent / "artemis.yaml"
    file.write_text(file.read_text().replace("    node_id: 2\n", "    node_id: 2\n    serial_number: 4711\n"))


def old_firmware(mission: Path, world: WatchedWorld) -> None:
    world.drive("traction-right").poke(SOFTWARE, 1, 0x2031)


@pytest.mark.parametrize(("prepare", "why"), [(another_serial_number, "serial number"), (old_firmware, "firmware")])
def test_a_moving_drive_that_is_not_the_one_expected_is_stopped_all_the_same_and_named(
    tmp_path: Path, prepare: Callable[[Path, WatchedWorld], None], why: str
) -> None:
    rig = found_moving(tmp_path, prepare)
    seen = rig.run()
    assert_stopped_by_quick_stop(seen, rig._start)
    assert (seen.status, seen.faults[0].id, seen.faults[0].device) == (1, "COM-33", "traction-right")
    assert why in seen.faults[0].text
    assert all(controlword(frame) != ENABLE for _, frame in seen.bus.sent)
    assert_at_rest(seen)


# ---------------------------------------------------------------------------------------------- the end at any time


BRING_UP = sorted({*(number / 10 for number in range(41)), *(0.3 + number * 0.009 for number in range(8))})
SLOW_BRING_UP = [number / 4 for number in range(17)]


def end_at(folder: Path, time: float, settings: SimSettings | None = None) -> Run:
    rig = Rig(write_mission(folder, [WAIT, CALIBRATE]), settings=settings)
    return rig.at(time, rig.request(Request.END), name="end").run()


@pytest.mark.sampled(8)
@pytest.mark.parametrize("time", BRING_UP, ids=lambda time: f"{time * 1000:.0f} ms")
def test_an_end_request_during_the_bring_up_leaves_the_drives_at_rest(tmp_path: Path, time: float) -> None:
    seen = end_at(tmp_path, time)
    assert (seen.status, seen.fault_ids) == (1, [])
    assert seen.modes == [Mode.INIT, Mode.END]
    assert_at_rest(seen)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("time", SLOW_BRING_UP, ids=lambda time: f"{time * 1000:.0f} ms")
def test_an_end_request_leaves_drives_at_rest_that_answer_slowly(tmp_path: Path, time: float) -> None:
    seen = end_at(tmp_path, time, SimSettings(answer_time_s=0.01))
    assert (seen.status, seen.fault_ids) == (1, [])
    assert seen.modes == [Mode.INIT, Mode.END]
    assert_at_rest(seen)


# ---------------------------------------------------------------------------------------------- a drive stays armed


def test_a_drive_that_cannot_be_released_is_named_and_the_others_are_at_rest(tmp_path: Path) -> None:
    unresponsive = False

    def disturb(frame: Frame, _now: float) -> tuple[Frame | None, float]:
        return (None if unresponsive and frame.id == SDO_REQUEST + NODE["steer-right"] else frame), 0.0

    def stop_answering() -> None:
        nonlocal unresponsive
        unresponsive = True

    rig = Rig(write_mission(tmp_path, [WAIT]), disturb=disturb)
    seen = rig.when(lambda s: s.mode is Mode.END, stop_answering).run()
    assert seen.is_done
    assert (seen.status, seen.fault_ids, seen.faults[0].device) == (1, ["COM-34"], "steer-right")
    seen.world.nodes = [node for node in seen.world.nodes if node.name != "steer-right"]
    assert_at_rest(seen)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("time", [0.61, 0.733, 0.763, 0.773, 0.803])
def test_a_stop_while_the_watchdog_is_proven_is_no_fault(tmp_path: Path, time: float) -> None:
    """The drives miss the heartbeat that was withheld from them after the robot is told to stop."""
    seen = attended_by(tmp_path, (time, "quickstop"), (4.0, "arm"), steps=[WAIT]).run()
    assert any(s.phase == "proving the watchdog" for s in seen.seen if s.time < time)
    assert (seen.status, seen.fault_ids) == (0, [])


@pytest.mark.parametrize("request_", [Request.QUICKSTOP, Request.END], ids=["stop", "end"])
def test_a_stop_before_the_drives_were_heard_in_operational_is_no_fault(tmp_path: Path, request_: Request) -> None:
    """Their last heartbeat is from before they were started: the next one comes within 0.1 s."""
    rig = Rig(write_mission(tmp_path, [WAIT], robot="small_car.yaml", simulation={"operator": LATER}))
    rig.when(lambda s: s.phase == "first contact", rig.request(request_), after=0.03, name="interrupt")
    seen = rig.run()
    before = seen.first(lambda s: s.now >= seen.acts["interrupt"]).tick.snapshot.sensed.drives
    assert {drive.nmt for drive in before} != {Nmt.OPERATIONAL}
    assert seen.fault_ids == []


def test_drives_without_power_are_one_fault(tmp_path: Path) -> None:
    faults = [{"at_s": 0.0, "inject": "COM-32"}]
    seen = Rig(write_mission(tmp_path, [WAIT], simulation={"faults": faults})).run()
    assert (seen.status, seen.fault_ids) == (1, ["COM-32"])


# ---------------------------------------------------------------------------------------------- attended, unattended


def attended_by(folder: Path, *acts: tuple[float, str], steps: list[Any] | None = None) -> Rig:
    operator = [{"at_s": time, "do": act} for time, act in acts]
    files = {"line.csv": straight(2.0)}
    return Rig(write_mission(folder, steps or STEPS, files, simulation={"operator": operator}))


def test_an_acknowledgment_without_an_arm_ends_the_run_as_failed_when_nobody_is_there_any_more(tmp_path: Path) -> None:
    rig = attended_by(tmp_path, (14.0, "acknowledge"))
    seen = rig.while_following(rig.emergency("traction-left", 0x8611), name="emergency").run()
    assert seen.acts["emergency"] < 13.0
    assert seen.modes[-3:] == [Mode.FAULT, Mode.INIT, Mode.END]
    assert (seen.status, seen.fault_ids) == (1, ["DRV-25"])
    assert seen.seen[-1].time < 21.0
    assert_at_rest(seen)


# ---------------------------------------------------------------------------------------------- the odometry's origin


def once_done(rig: Rig, name: str, mode: Mode, phase: str) -> Callable[[Seen], bool]:
    """After the test's act of this name, the robot is in this mode and phase."""
    return lambda seen: name in rig._done and (seen.mode, seen.phase) == (mode, phase)


def assert_origin_is_where_the_wheels_were_aligned_first(seen: Run) -> None:
    origin = [s for s in seen.seen if s.tick.wish.reset_pose]
    assert len(origin) == 1
    assert origin[0].now == seen.first(lambda s: s.phase == "aligned").now
    estimate, true, start = seen.ticks[-1].snapshot.odometry.pose, seen.world.pose, origin[0].pose
    assert math.hypot(true.x - start.x, true.y - start.y) == pytest.approx(2.0, abs=0.03)
    assert math.hypot(estimate.x, estimate.y) == pytest.approx(2.0, abs=0.03)
    assert driven(seen.in_mode(Mode.FOLLOW)[-1]) == pytest.approx(2.0, abs=0.03)
    assert seen.status == 0


def test_the_origin_is_where_the_wheels_are_aligned_first_also_when_the_first_bring_up_failed(tmp_path: Path) -> None:
    rig = attended_by(tmp_path, (45.0, "acknowledge"))
    rig.when(lambda s: s.phase == "aligning", rig.emergency("steer-left", 0x8611), after=0.1, name="emergency")
    rig.when(lambda s: s.mode is Mode.FAULT, rig.request(Request.ACKNOWLEDGE), after=2.0, name="acknowledge")
    rearm = once_done(rig, "acknowledge", Mode.INIT, "waiting for arm")
    seen = rig.when(rearm, rig.request(Request.ARM), after=0.1, name="arm").run()
    assert seen.modes[:4] == [Mode.INIT, Mode.FAULT, Mode.INIT, Mode.READY]
    assert_origin_is_where_the_wheels_were_aligned_first(seen)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("phase", ["waiting", "following"])
@pytest.mark.parametrize("stop", [False, True], ids=["armed at once", "stopped once more"])
def test_the_origin_stays_when_the_drives_are_brought_up_again(tmp_path: Path, phase: str, stop: bool) -> None:
    rig = attended_by(tmp_path, (50.0, "acknowledge"), steps=[{"wait": {"seconds": 1.0}}, *STEPS])
    rig.when(lambda s: s.phase == phase, rig.emergency("traction-left", 0x8611), after=0.9, name="emergency")
    rig.when(lambda s: s.mode is Mode.FAULT, rig.request(Request.ACKNOWLEDGE), after=2.0, name="acknowledge")
    waits = once_done(rig, "acknowledge", Mode.INIT, "waiting for arm")
    if stop:
        rig.when(waits, rig.request(Request.QUICKSTOP), after=0.1, name="stop")
        waits = once_done(rig, "stop", Mode.QUICKSTOP, "stopped: arm to continue")
    seen = rig.when(waits, rig.request(Request.ARM), after=0.5, name="arm").run()
    assert seen.modes.count(Mode.INIT) == 2 + stop
    assert_origin_is_where_the_wheels_were_aligned_first(seen)


# ---------------------------------------------------------------------------------------------- odometry


def test_a_drive_that_was_told_its_angle_did_not_steer_also_when_that_shows_in_an_extra_tick(tmp_path: Path) -> None:
    rig = Rig(write_mission(tmp_path, [WAIT]))
    rig.when(lambda s: s.phase == "reference", rig.request(Request.QUICKSTOP), after=0.015, name="stop")
    seen = rig.run()
    extra = seen.first(lambda s: s.now >= seen.acts["stop"]).tick.snapshot
    assert extra.sensed.urgent
    told = {result.drive for result in extra.sensed.results if result.kind is JobKind.REFERENCE and result.ok}
    assert told == set(STEERING)
    steered = [s.tick.snapshot.odometry for s in seen.seen]
    assert max(o.steering for o in steered) - min(o.steering for o in steered) > 0.01
    assert max(abs(o.distance) for o in steered) < 1e-4
