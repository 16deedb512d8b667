"""However a run ends in order: drives off, without a fault, no longer waiting for a heartbeat that will not come."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from rig import (
    CALIBRATE,
    DRIVES,
    HEARTBEAT,
    STICK,
    TELEOP,
    Rig,
    Run,
    Seen,
    Steps,
    follow,
    run,
    standing,
    stick,
    write_mission,
)

from artemis.drive_states import DriveState, Nmt
from artemis.values import Mode, Request

pytestmark = pytest.mark.short_alignment

CONSUMER = 0x1016
WAIT = {"wait": {"seconds": 1.0}}
STEPS: Steps = [WAIT, CALIBRATE, follow(0.4)]
DRIVE_ON = stick((0.0, 0.0, 0.0, 0), (5.9, 0.0, 0.6, 1), (26.4, 0.0, 0.6, 1))


def assert_ended_in_order(seen: Run) -> None:
    assert seen.ticks[-1].wish.finished
    for node in seen.world.nodes:
        assert (node.name, node.nmt) == (node.name, Nmt.PRE_OPERATIONAL)
        assert (node.name, node.state) == (node.name, DriveState.SWITCH_ON_DISABLED)
        assert (node.name, node.read(CONSUMER, 1)) == (node.name, 0)
    assert standing(seen.world.truth)
    assert_nothing_happens_afterwards(seen)


def assert_nothing_happens_afterwards(seen: Run) -> None:
    """A second without a host: nobody complains, nothing moves."""
    world = seen.world
    for node in world.nodes:
        node.outbox.clear()
    for _ in range(500):
        world.advance(world.time + 0.002)
        for node in world.nodes:
            node.advance(world.time)
            assert all(frame.id > HEARTBEAT for _, frame in node.outbox), (node.name, node.outbox)
            node.outbox.clear()
    assert {node.state for node in world.nodes} == {DriveState.SWITCH_ON_DISABLED}
    assert standing(world.truth)


def test_a_finished_mission_ends_in_order(tmp_path: Path) -> None:
    seen = run(write_mission(tmp_path, STEPS))
    assert seen.status == 0
    assert_ended_in_order(seen)


def test_the_last_frame_of_a_run_is_our_heartbeat_or_the_order_to_rest(tmp_path: Path) -> None:
    """No drive is left to notice that we are gone: each was disarmed before our last heartbeat."""
    seen = run(write_mission(tmp_path, [WAIT]))
    sent = [frame for _, frame in seen.bus.sent]
    last_beat = max(place for place, frame in enumerate(sent) if frame.id == HEARTBEAT + 127)
    disarming = [place for place, f in enumerate(sent) if f.data[:4] == b"\x23\x16\x10\x01" and not any(f.data[4:])]
    assert len(set(sent[place].id for place in disarming)) == len(DRIVES)
    assert max(disarming) < last_beat


def in_phase(phase: str) -> Callable[[Seen], bool]:
    return lambda seen: seen.phase == phase


def in_mode(mode: Mode) -> Callable[[Seen], bool]:
    return lambda seen: seen.mode is mode


MOMENTS = {
    "listening": (in_phase("listening"), 0.05),
    "securing": (in_phase("secure"), 0.003),
    "configuring": (in_phase("configure"), 0.003),
    "before the heartbeat is withheld": (in_phase("first contact"), 0.003),
    "while the heartbeat is withheld": (lambda s: s.tick.wish.exchange and not s.tick.wish.heartbeat, 0.05),
    "while the lost heartbeat is reset": (lambda s: s.tick.wish.steering.value == "fault reset", 0.003),
    "reading potentiometers": (in_phase("reading potentiometers"), 0.5),
    "aligning": (in_phase("aligning"), 0.3),
    "ready": (in_phase("waiting"), 0.3),
    "calibrating": (in_mode(Mode.CALIBRATE), 2.3),
    "following": (in_mode(Mode.FOLLOW), 1.5),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("moment", MOMENTS)
def test_an_end_request_ends_in_order_at_every_moment(tmp_path: Path, moment: str) -> None:
    condition, after = MOMENTS[moment]
    rig = Rig(write_mission(tmp_path, STEPS))
    seen = rig.when(condition, rig.request(Request.END), after=after, name="end").run()
    assert seen.seen[-1].now - seen.acts["end"] < 2.0
    assert_ended_in_order(seen)
    assert seen.status == 1
    assert seen.fault_ids == []


def test_an_end_request_while_driving_by_hand_ends_in_order(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, [CALIBRATE, TELEOP], {"stick.csv": DRIVE_ON}, inputs=STICK)
    rig = Rig(mission)
    seen = rig.at(7.4, rig.request(Request.END)).run()
    assert not standing(seen.truth_at(7.4))
    assert_ended_in_order(seen)


def test_an_end_request_in_a_quick_stop_ends_in_order(tmp_path: Path) -> None:
    acts = [{"at_s": 5.4, "do": "quickstop"}, {"at_s": 7.4, "do": "end"}]
    seen = run(write_mission(tmp_path, STEPS[1:], simulation={"operator": acts}))
    assert seen.modes[-2:] == [Mode.QUICKSTOP, Mode.END]
    assert_ended_in_order(seen)


def test_an_end_request_in_a_fault_ends_in_order(tmp_path: Path) -> None:
    rig = Rig(write_mission(tmp_path, STEPS[1:], simulation={"operator": [{"at_s": 10.4, "do": "end"}]}))
    seen = rig.while_following(rig.emergency("traction-left", 0x8611)).run()
    assert seen.modes[-2:] == [Mode.FAULT, Mode.END]
    assert seen.seen[-1].time > 10.4
    assert_ended_in_order(seen)


def test_a_quick_stop_that_nobody_attends_ends_in_order(tmp_path: Path) -> None:
    rig = Rig(write_mission(tmp_path, STEPS))
    seen = rig.while_following(rig.request(Request.QUICKSTOP)).run()
    assert seen.status == 1
    assert_ended_in_order(seen)


@pytest.mark.parametrize("name", DRIVES)
def test_a_fault_that_nobody_attends_ends_in_order(tmp_path: Path, name: str) -> None:
    rig = Rig(write_mission(tmp_path, STEPS))
    seen = rig.while_following(rig.emergency(name, 0x8611)).run()
    assert seen.status == 1
    assert_ended_in_order(seen)
