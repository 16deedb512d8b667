"""Host, bus or a drive falls silent while the robot drives: whoever is left stops it."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from disturbance import random_disturbance
from msgspec.structs import replace
from rig import (
    BRAKING,
    CALIBRATE,
    DRIVES,
    HEARTBEAT,
    NODE,
    TICK,
    Rig,
    Run,
    follow,
    run,
    standing,
    write_mission,
)

from artemis.devices.can_bus import Frame
from artemis.drive_states import DriveState
from artemis.sim.bus import Disturb
from artemis.values import Mode

pytestmark = pytest.mark.short_alignment

SPEED = 0.4
WATCH = 0.2
DRIVE_CYCLE = 0.001
CLOSE = 0.002
"""How closely the world is watched after the loss [s]."""
STEPS = [CALIBRATE, follow(SPEED)]
REACTING = (DriveState.FAULT_REACTION_ENABLED, DriveState.FAULT_REACTION_DISABLED, DriveState.FAULT)


def host_beats(seen: Run) -> list[float]:
    """When heartbeats of the host left."""
    return [time for time, frame in seen.bus.sent if frame.id == HEARTBEAT + 127]


def lose(rig: Rig, how: str) -> None:
    """From now on the bus is dead or off, and the world is looked at more often."""
    setattr(rig.bus, how, True)
    rig.bus._patrol = CLOSE


def assert_drives_stopped_by_themselves(seen: Run, last: float) -> None:
    """Each drive begins its quick stop 200 ms and one drive cycle after the last heartbeat."""
    resolution = 2 * CLOSE  # of the world's record
    for place in range(len(DRIVES)):
        begun = next(t.time for t in seen.truth_from(last) if t.states[place] in REACTING)
        assert WATCH <= begun - last <= WATCH + DRIVE_CYCLE + resolution
    end = seen.stands_from()
    assert end - last < WATCH + SPEED / BRAKING + 0.06
    assert standing(seen.world.truth)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("phase", [0.0, 0.004, 0.011, 0.019])
def test_when_the_host_dies_every_drive_stops_by_itself(tmp_path: Path, phase: float) -> None:
    rig = Rig(write_mission(tmp_path, STEPS))
    rig.when(
        lambda s: s.mode is Mode.FOLLOW and s.tick.snapshot.odometry.speed > 0.9 * SPEED,
        lambda: lose(rig, "dead"),
        after=phase,
        name="death",
    )
    seen = rig.run()
    assert not standing(seen.truth_from(seen.acts["death"])[0])
    assert_drives_stopped_by_themselves(seen, host_beats(seen)[-1])


def test_a_host_that_dies_while_the_wheels_are_aligned_leaves_a_standing_robot(tmp_path: Path) -> None:
    rig = Rig(write_mission(tmp_path, STEPS))
    rig.when(lambda s: s.phase == "aligning", lambda: setattr(rig.bus, "dead", True), after=0.3)
    seen = rig.run()
    assert standing(seen.world.truth)
    assert {node.state for node in seen.world.nodes} == {DriveState.FAULT}


def test_without_the_bus_the_run_fails_and_the_drives_stop_by_themselves(tmp_path: Path) -> None:
    rig = Rig(write_mission(tmp_path, STEPS))
    rig.while_following(lambda: lose(rig, "bus_off"), name="lost")
    seen = rig.run()
    assert (seen.status, seen.fault_ids[0]) == (1, "COM-22")
    assert seen.first(lambda s: s.mode is Mode.FAULT).now - seen.acts["lost"] <= TICK
    heard = max(time for time in host_beats(seen) if time < seen.acts["lost"])
    assert_drives_stopped_by_themselves(seen, heard)


# ---------------------------------------------------------------------------------------------- one node


def muted(*identifiers: int) -> Disturb:
    """Nobody hears frames with these identifiers."""
    return lambda frame, _now: (None if frame.id in identifiers else frame, 0.0)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("identifiers", "id", "worst"),
    [((0x180,), "COM-11", 0.1), ((0x280,), "COM-11", 0.1), ((HEARTBEAT,), "COM-28", 0.37)],
    ids=["status and position", "details", "heartbeat"],
)
@pytest.mark.parametrize("name", ["traction-left", "steer-right"])
def test_a_drive_that_falls_silent_stops_the_robot(
    tmp_path: Path, name: str, identifiers: tuple[int, ...], id: str, worst: float
) -> None:
    rig = Rig(write_mission(tmp_path, STEPS))
    lost = muted(*(identifier + NODE[name] for identifier in identifiers))
    rig.while_following(lambda: setattr(rig.bus, "disturb", lost), name="muted")
    seen = rig.run()
    fault = seen.faults[0]
    assert (seen.status, fault.id, fault.device) == (1, id, name)
    assert seen.first(lambda s: s.mode is Mode.FAULT).now - seen.acts["muted"] <= worst + TICK
    assert standing(seen.world.truth)


@pytest.mark.parametrize("name", ["traction-left", "steer-right"])
def test_a_drive_without_power_stops_the_robot(tmp_path: Path, name: str) -> None:
    rig = Rig(write_mission(tmp_path, STEPS))
    rig.while_following(lambda: rig.drive(name).power_off(), name="off")
    seen = rig.run()
    assert (seen.status, seen.faults[0].id, seen.faults[0].device) == (1, "COM-11", name)
    assert standing(seen.world.truth)


@pytest.mark.parametrize("name", DRIVES)
def test_a_drive_that_restarts_while_driving_is_found_out_by_its_boot_up(tmp_path: Path, name: str) -> None:
    rig = Rig(write_mission(tmp_path, STEPS))
    rig.while_following(lambda: rig.drive(name).power_on(rig.bus.loop.time()), name="reboot")
    seen = rig.run()
    booted = next(f.time for f in seen.bus.heard if f.id == HEARTBEAT + NODE[name] and f.data == b"\x00" and f.time > 1)
    assert ("COM-26", name) in {(fault.id, fault.device) for fault in seen.faults}
    assert seen.faults[0].device == name
    assert seen.first(lambda s: s.mode is Mode.FAULT).now <= booted + TICK
    assert seen.status == 1
    assert standing(seen.world.truth)


# ---------------------------------------------------------------------------------------------- a bad bus


def twice(rig_of: Callable[[], Rig]) -> Disturb:
    """Every process-data and heartbeat frame of a drive reaches the host twice (ISO 11898-1: last bit disturbed)."""

    def disturb(frame: Frame, now: float) -> tuple[Frame | None, float]:
        bus = rig_of().bus
        if 0x180 < frame.id < 0x200 or 0x280 < frame.id < 0x300 or HEARTBEAT < frame.id < HEARTBEAT + 0x7F:
            bus._inbox.append(replace(frame, time=now))
        return frame, 0.0

    return disturb


def commands(seen: Run) -> list[tuple[float, ...]]:
    return [
        (s.time, s.tick.set_points.speed, s.tick.set_points.steering, s.tick.snapshot.odometry.pose.x)
        for s in seen.in_mode(Mode.FOLLOW)
    ]


def test_frames_that_arrive_twice_change_nothing(tmp_path: Path) -> None:
    plain = run(write_mission(tmp_path / "plain", STEPS))
    rig: Rig = Rig(write_mission(tmp_path / "doubled", STEPS), disturb=None)
    rig.while_following(lambda: setattr(rig.bus, "disturb", twice(lambda: rig)), distance=0.1)
    seen = rig.run()
    assert len(seen.bus.heard) > 1.2 * len(plain.bus.heard)
    assert (seen.status, seen.fault_ids) == (0, [])
    ours, theirs = commands(plain), commands(seen)
    assert len(ours) == len(theirs)
    for mine, other in zip(ours, theirs, strict=True):
        assert other == pytest.approx(mine, abs=1e-4)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(1, 5))
def test_a_path_is_finished_while_one_frame_in_a_hundred_is_lost(tmp_path: Path, seed: int) -> None:
    rig = Rig(write_mission(tmp_path, STEPS), disturb=random_disturbance(seed, loss=0.01), longest=120.0)
    seen = rig.run()
    assert standing(seen.world.truth)
    if seen.status == 0:
        assert seen.world.pose.x == pytest.approx(1.2, abs=0.05)
    else:  # two 100 ms heartbeats in a row are lost in some runs: COM-28, not with these seeds
        pytest.fail(f"{seen.faults}")


@pytest.mark.parametrize("seed", range(2))
def test_frames_that_are_late_by_some_milliseconds_do_no_harm(tmp_path: Path, seed: int) -> None:
    seen = run(write_mission(tmp_path, STEPS), disturb=random_disturbance(seed, delay=0.003), longest=120.0)
    assert (seen.status, seen.fault_ids) == (0, [])
    assert math.hypot(seen.world.pose.x - 1.2, seen.world.pose.y) < 0.05
