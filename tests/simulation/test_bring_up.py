"""From power-up to enabled and aligned: what must be true before a drive gets torque."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest
from disturbance import random_disturbance
from rig import (
    CALIBRATE,
    DRIVES,
    EMERGENCY,
    HEARTBEAT,
    NODE,
    SDO_REQUEST,
    TRACTION,
    Rig,
    Run,
    WatchedWorld,
    controlword,
    degrees,
    follow,
    run,
    standing,
    write_mission,
)

from artemis.devices.can_bus import Frame
from artemis.drive_states import DriveState
from artemis.mission.loading import load_mission
from artemis.sim.epos_settings import SimSettings
from artemis.sim.world import PlantParameters
from artemis.values import Mode

pytestmark = pytest.mark.short_alignment

ENABLE = 0x000F
CONSUMER = 0x1016
WAIT = {"wait": {"seconds": 0.1}}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run that is brought up and ends."""
    return run(write_mission(tmp_path_factory.mktemp("plain"), [WAIT]))


def aligned(seen: Run) -> tuple[float, float]:
    """True wheel angles [degrees] when the bring-up was done."""
    now = seen.first(lambda s: s.mode is Mode.READY).now
    return degrees(next(t for t in seen.world.history if t.time >= now).wheel_angles)


@pytest.mark.parametrize("tick_hz", [50, 200])
def test_odometry_stands_while_the_wheels_are_told_their_angles(tmp_path: Path, tick_hz: int) -> None:
    seen = run(write_mission(tmp_path, [WAIT], tick_hz=tick_hz))
    assert max(abs(tick.snapshot.odometry.speed) for tick in seen.ticks) < 0.05


def sdo_write(frame: Frame, node: int, index: int, sub: int) -> int | None:
    """Value of a download request of one object."""
    if frame.id != SDO_REQUEST + node or frame.data[0] >> 5 != 1:
        return None
    if frame.data[1:4] != index.to_bytes(2, "little") + bytes((sub,)):
        return None
    return int.from_bytes(frame.data[4:8], "little")


# ---------------------------------------------------------------------------------------------- alignment


def test_crooked_wheels_are_straight_after_init_though_their_encoders_started_at_zero(plain: Run) -> None:
    begin = degrees(plain.world.history[0].wheel_angles)
    assert begin == pytest.approx((7.0, -4.0))
    assert all(abs(angle) < 0.5 for angle in aligned(plain))


@pytest.mark.parametrize("zeros", [(0.8, -0.4), (-2.0, 1.5)])
def test_a_hidden_steering_zero_turns_the_true_wheels_by_exactly_that_error(
    tmp_path: Path, plain: Run, zeros: tuple[float, float]
) -> None:
    true = PlantParameters(steering_zero_left_deg=zeros[0], steering_zero_right_deg=zeros[1])
    seen = run(write_mission(tmp_path, [WAIT]), true_robot=true)
    honest, shifted = aligned(plain), aligned(seen)
    assert [b - a for a, b in zip(honest, shifted, strict=True)] == pytest.approx(zeros, abs=0.1)


@pytest.mark.parametrize("starts", [(0.0, 0.0), (-25.0, 20.0), (40.0, 48.0)])
def test_wheels_are_straightened_from_wherever_they_stand(tmp_path: Path, starts: tuple[float, float]) -> None:
    true = PlantParameters(start_steering_left_deg=starts[0], start_steering_right_deg=starts[1])
    seen = run(write_mission(tmp_path, [WAIT]), true_robot=true)
    assert seen.status == 0
    assert all(abs(angle) < 0.5 for angle in aligned(seen))


# ---------------------------------------------------------------------------------------------- the watchdog


def test_every_drive_is_told_to_watch_the_host_and_it_is_read_back(plain: Run) -> None:
    sent = [frame for _, frame in plain.bus.sent]
    for node in NODE.values():
        written = [place for place, frame in enumerate(sent) if (sdo_write(frame, node, CONSUMER, 1) or 0) & 0xFFFF]
        assert written
        request = SDO_REQUEST + node
        following = next(frame for frame in sent[written[0] + 1 :] if frame.id == request)
        assert following.data[:4] == b"\x40\x16\x10\x01"


def test_the_watchdog_is_proven_on_all_four_drives_before_the_first_enable(plain: Run) -> None:
    first_enable = min(time for time, frame in plain.bus.sent if controlword(frame) == ENABLE)
    beats = [time for time, frame in plain.bus.sent if frame.id == HEARTBEAT + 127]
    gap, begin = max((b - a, a) for a, b in itertools.pairwise(t for t in beats if t < first_enable))
    assert gap >= 0.2
    armed = [
        min(time for time, frame in plain.bus.sent if (sdo_write(frame, node, CONSUMER, 1) or 0) & 0xFFFF)
        for node in NODE.values()
    ]
    assert max(armed) < begin
    for node in NODE.values():
        losses = [f for f in plain.bus.heard if f.id == EMERGENCY + node and f.data[:2] == b"\x30\x81"]
        resets = [f for f in plain.bus.heard if f.id == EMERGENCY + node and f.data[:2] == b"\x00\x00"]
        assert len(losses) == 1
        assert begin + 0.2 <= losses[0].time < first_enable
        assert losses[0].time < resets[-1].time < first_enable


def test_no_drive_is_enabled_that_does_not_report_the_missing_heartbeat(tmp_path: Path) -> None:
    rig = Rig(write_mission(tmp_path, [WAIT]))
    rig.when(lambda s: s.phase == "proving the watchdog", lambda: rig.drive("steer-left").poke(CONSUMER, 1, 0))
    seen = rig.run()
    assert (seen.status, seen.fault_ids[0]) == (1, "COM-30")
    assert "steer-left" in seen.faults[0].text
    assert all(controlword(frame) != ENABLE for _, frame in seen.bus.sent)


# ---------------------------------------------------------------------------------------------- four drives at once


@pytest.mark.parametrize("lost", [{0x081}, {0x081, 0x082, 0x083, 0x084}])
def test_a_drive_whose_report_was_lost_proves_its_watchdog_by_its_error_history(tmp_path: Path, lost: set[int]) -> None:
    def lose(frame: Frame, now: float) -> tuple[Frame | None, float]:
        return (None if frame.id in lost else frame), 0.0

    seen = Rig(write_mission(tmp_path, [WAIT]), disturb=lose).run()
    assert (seen.status, seen.fault_ids) == (0, [])


def test_the_four_drives_are_brought_up_side_by_side(tmp_path: Path) -> None:
    seen = run(write_mission(tmp_path, [WAIT]), settings=SimSettings(answer_time_s=0.005))
    spans = {}
    for name, node in NODE.items():
        arming = next(t for t, f in seen.bus.sent if f.id == SDO_REQUEST + node and f.data[1:3] == b"\x02\x64")
        started = next(t for t, f in seen.bus.sent if f.id == 0 and f.data == bytes((1, node)))
        spans[name] = arming, started
    latest_begin, earliest_end = max(a for a, _ in spans.values()), min(b for _, b in spans.values())
    lengths = [end - begin for begin, end in spans.values()]
    assert earliest_end - latest_begin > 0.9 * max(lengths)
    requests = [
        f.id for t, f in seen.bus.sent if f.id > SDO_REQUEST and latest_begin < t < earliest_end and f.id < 0x680
    ]
    neighbours = [a != b for a, b in itertools.pairwise(requests)]
    assert sum(neighbours) > 0.9 * len(neighbours)


# ---------------------------------------------------------------------------------------------- trouble on the way


@pytest.mark.parametrize("seed", range(1, 4))
def test_bring_up_works_while_one_frame_in_a_hundred_is_lost(tmp_path: Path, seed: int) -> None:
    """SDO transfers are repeated. Lost heartbeats and process data are nothing while the drives are off.

    (Two heartbeats of a drive in a row, as with seed 0, are COM-28 once they are on.)
    """
    rig = Rig(write_mission(tmp_path, [WAIT]), disturb=random_disturbance(seed, loss=0.01))
    rig.when(lambda s: s.mode is Mode.READY, lambda: setattr(rig.bus, "disturb", None))
    seen = rig.run()
    assert (seen.status, seen.fault_ids) == (0, [])


def test_a_drive_that_is_missing_is_named_and_nothing_is_enabled(tmp_path: Path) -> None:
    rig = Rig(write_mission(tmp_path, [WAIT]))
    rig.at(0.1, lambda: rig.drive("traction-right").power_off())
    seen = rig.run()
    assert (seen.status, seen.fault_ids[0]) == (1, "COM-08")
    assert "traction-right" in seen.faults[0].text
    assert all(controlword(frame) != ENABLE for _, frame in seen.bus.sent)


# ---------------------------------------------------------------------------------------------- drives found running


def left_running(world: WatchedWorld, rpm: int) -> None:
    """What a run leaves behind that was killed and had no watchdog: drives that turn and listen to nobody."""
    for _ in range(50):
        step(world, 0.002)
    for name in DRIVES:
        drive = world.drive(name)
        drive.poke(0x6060, 0, 3 if name in TRACTION else -1)
        for word in (0x06, 0x0F):
            drive.poke(0x6040, 0, word)
            for _ in range(30):
                step(world, 0.002)
    for name, sign in zip(TRACTION, (1, -1), strict=True):
        drive = world.drive(name)
        drive.poke(0x60FF, 0, sign * rpm)
        drive.poke(0x6040, 0, 0x0F)
    for _ in range(500):
        step(world, 0.002)


def step(world: WatchedWorld, dt: float) -> None:
    world.advance(world.time + dt)
    for node in world.nodes:
        node.advance(world.time)
        node.outbox.clear()


def test_drives_found_moving_and_enabled_are_stopped_first_and_brought_up_from_scratch(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, [CALIBRATE, follow()])
    loaded = load_mission(mission)
    world = WatchedWorld(loaded.robot, PlantParameters())
    left_running(world, rpm=500)
    assert {node.state for node in world.nodes} == {DriveState.OPERATION_ENABLE}
    speed = world.speed
    assert speed > 0.1
    begin = world.time
    rig = Rig(mission, world=world, start=begin)
    seen = rig.run()
    stops = [t for t, f in seen.bus.sent if controlword(f) == 0x0B and f.id - SDO_REQUEST in (1, 2)]
    first_setting = min(t for t, f in seen.bus.sent if f.id == SDO_REQUEST + 1 and f.data[1:3] == b"\x02\x64")
    assert begin + 0.3 <= min(stops) < begin + 0.35  # after 300 ms of listening
    still = max(t.time for t in world.history if t.time < first_setting and not standing(t))
    assert still < first_setting
    assert all(frame.id != 0x201 for t, frame in seen.bus.sent if t < first_setting)
    assert seen.status == 0
    assert len({f.id for f in seen.bus.heard if f.id - EMERGENCY in NODE.values() and f.data[:2] == b"\x30\x81"}) == 4


def test_a_host_that_starts_right_after_another_was_killed_stops_the_robot_and_drives_again(tmp_path: Path) -> None:
    first = Rig(write_mission(tmp_path, [CALIBRATE, follow()]))
    first.while_following(first.kill, name="killed")
    died = first.run_until_killed()
    world, killed = died.world, died.acts["killed"]
    assert not standing(world.truth)
    second = Rig(died.mission, world=world, start=killed + 0.02)
    seen = second.run()
    assert seen.status == 0
    enabled = min(time for time, frame in seen.bus.sent if controlword(frame) == ENABLE)
    quiet = [truth for truth in world.history if killed + 0.5 < truth.time < enabled]
    assert quiet
    assert all(standing(truth) for truth in quiet)


def test_the_drives_states_before_any_frame_of_ours_do_not_matter_to_the_outcome(tmp_path: Path) -> None:
    """Drives of a run before that ended normally, without a power cycle: the same as fresh ones."""
    mission = write_mission(tmp_path, [CALIBRATE, follow()])
    first = run(mission)
    end = first.world.time
    again = Rig(mission, world=first.world, start=end + 1.0).run()
    assert (again.status, again.fault_ids) == (0, [])
    assert again.world.pose.x - first.seen[-1].pose.x == pytest.approx(1.2, abs=0.02)
