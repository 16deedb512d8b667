"""A drive that does not hear, or that nobody could stop yet: it is reached another way, or stops by our silence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rig import (
    BRAKING,
    CALIBRATE,
    HEARTBEAT,
    NODE,
    SDO_REQUEST,
    SET_POINTS,
    STOP_FRAMES,
    Rig,
    Run,
    follow,
    standing,
    straight,
    write_mission,
)

from artemis.devices.can_bus import Frame
from artemis.drive_states import DriveState
from artemis.values import Mode, Request

pytestmark = pytest.mark.short_alignment

SPEED, LEFT = 0.6, "traction-left"
STEPS, FILES = [CALIBRATE, follow(SPEED)], {"line.csv": straight(4.0)}
BY_SDO, BY_SILENCE = 0.16, 0.5
"""Longest times until an unresponsive drive begins to brake: 0.1 s to be found, a few answers; three tries of 50 ms
and a watchdog of 200 ms [s]."""
WATCH = 0x1016
Drops = Callable[[Frame], bool]


class DeafRig(Rig):
    """A robot that follows a line. From `stop_answering` on, `drops` says which frames nobody hears."""

    def __init__(self, folder: Path, drops: Drops, **simulation: Any) -> None:  # noqa: ANN401 (keys of a mission)
        operator = [{"at_s": 7.9, "do": "acknowledge"}]
        mission = write_mission(folder, STEPS, FILES, simulation={"operator": operator, **simulation})
        super().__init__(mission, disturb=self._disturb)
        self._drops, self._deaf = drops, False

    def _disturb(self, frame: Frame, _now: float) -> tuple[Frame | None, float]:
        return (None if self._deaf and self._drops(frame) else frame), 0.0

    def stop_answering(self, act: Callable[[], None] = lambda: None) -> None:
        """From now on; then do something else."""
        self._deaf = True
        act()

    def leave(self, nmt: bytes) -> None:
        """An NMT command that is not ours puts the left drive into another state."""
        self.drive(LEFT).receive(Frame(0, nmt + bytes([NODE[LEFT]])), self.bus.loop.time())


def process_data(frame: Frame) -> bool:
    return frame.id in (SET_POINTS + NODE[LEFT], STOP_FRAMES + NODE[LEFT])


def all_but_heartbeats(frame: Frame) -> bool:
    return process_data(frame) or frame.id == SDO_REQUEST + NODE[LEFT]


def status_is_asked(frame: Frame) -> bool:
    return frame.id == SDO_REQUEST + NODE[LEFT] and frame.data[1:3] == b"\x41\x60"


def assert_stopped(seen: Run, since: float, within: float) -> None:
    """Both driven wheels turned then, and stand once the slower of them has begun to brake."""
    assert not standing(seen.truth_at(since))
    assert seen.stands_from() <= since + within + SPEED / BRAKING + 0.1


# ---------------------------------------------------------------------------------------------- process data


@pytest.mark.sampled(2)
@pytest.mark.parametrize("request_", [Request.QUICKSTOP, Request.END])
@pytest.mark.parametrize(("drops", "within"), [(process_data, BY_SDO), (all_but_heartbeats, BY_SILENCE)])
def test_a_drive_that_hears_no_stop_frame_is_stopped_all_the_same(
    tmp_path: Path, request_: Request, drops: Drops, within: float
) -> None:
    rig = DeafRig(tmp_path, drops)
    rig.while_following(lambda: rig.stop_answering(rig.request(request_)), name="stop")
    seen = rig.run()
    assert_stopped(seen, seen.acts["stop"], within)


def test_both_driven_wheels_stop_where_one_trips_and_the_other_hears_nothing(tmp_path: Path) -> None:
    rig = DeafRig(tmp_path, process_data)
    rig.while_following(lambda: rig.stop_answering(rig.emergency("traction-right", 0x8611)), name="trip")
    seen = rig.run()
    assert seen.fault_ids[0] == "DRV-25"
    assert_stopped(seen, seen.acts["trip"], BY_SDO)


def test_a_stop_that_is_pressed_again_and_again_reaches_an_unresponsive_drive_as_soon(tmp_path: Path) -> None:
    rig = DeafRig(tmp_path, all_but_heartbeats)

    def press() -> None:
        rig.stop_answering(rig.request(Request.QUICKSTOP))
        if rig.bus.loop.time() < rig._done["stop"] + 3.0:
            rig.bus.loop.call_later(0.033, press)

    rig.while_following(press, name="stop")
    seen = rig.run()
    assert_stopped(seen, seen.acts["stop"], BY_SILENCE)


def test_a_steering_drive_that_hears_no_process_data_is_switched_off_once_the_robot_stands(tmp_path: Path) -> None:
    steer = NODE["steer-left"]
    rig = DeafRig(tmp_path, lambda frame: frame.id in (SET_POINTS + steer, STOP_FRAMES + steer))
    rig.while_following(lambda: rig.stop_answering(rig.request(Request.QUICKSTOP)), name="stop")
    states: dict[float, DriveState] = {}

    def look(after: float) -> Callable[[], None]:
        return lambda: states.update({after: rig.drive("steer-left").state})

    for after in (0.3, 2.0):
        rig.when(lambda s: "stop" in rig._done, look(after), after=after, name=f"look {after}")
    rig.run()
    assert states == {0.3: DriveState.OPERATION_ENABLE, 2.0: DriveState.SWITCH_ON_DISABLED}


# ---------------------------------------------------------------------------------------------- NMT states


@pytest.mark.sampled(2)
@pytest.mark.sampled(3)
@pytest.mark.parametrize("delay", [0.0, 0.1, 0.2, 0.3, 0.5])
@pytest.mark.parametrize("nmt", [b"\x02", b"\x80"], ids=["stopped", "pre-operational"])
def test_the_ordered_end_gives_a_runaway_drive_no_heartbeat_back(tmp_path: Path, nmt: bytes, delay: float) -> None:
    rig = DeafRig(tmp_path, lambda frame: False)
    rig.while_following(lambda: rig.leave(nmt), name="left")
    rig.when(lambda s: "left" in rig._done, rig.request(Request.END), after=delay, name="end")
    seen = rig.run()
    assert seen.status == 1
    assert_stopped(seen, seen.acts["left"], BY_SILENCE + 0.15)


def test_a_drive_that_could_not_be_switched_off_still_watches_when_the_run_is_over(tmp_path: Path) -> None:
    rig = DeafRig(tmp_path, lambda frame: process_data(frame) or status_is_asked(frame))
    rig.while_following(lambda: rig.stop_answering(rig.request(Request.END)), name="end")
    seen = rig.run()
    assert "COM-34" in seen.fault_ids
    drive = seen.world.drive(LEFT)
    assert drive.read(WATCH, 1) != 0
    assert drive.state is not DriveState.OPERATION_ENABLE
    assert_stopped(seen, seen.acts["end"], BY_SILENCE)


# ---------------------------------------------------------------------------------------------- before the bring-up


def unready(folder: Path, *acts: tuple[float, str], **simulation: Any) -> Rig:  # noqa: ANN401 (keys of a mission)
    operator = [{"at_s": time, "do": act} for time, act in (*acts, (7.2, "acknowledge"))]
    return Rig(write_mission(folder, [{"wait": {"seconds": 0.1}}], simulation={"operator": operator, **simulation}))


TURNING = {"at_s": 0.02, "inject": "SYS-10", "node": LEFT}


@pytest.mark.parametrize("silent", [1.5, 4.0])
def test_a_drive_found_turning_is_never_called_stopped_before_it_is(tmp_path: Path, silent: float) -> None:
    mute = {"at_s": 0.02, "inject": "COM-08", "node": LEFT, "duration_s": silent}
    seen = unready(tmp_path, (0.1, "quickstop"), faults=[TURNING, mute]).run()
    assert ("COM-08", LEFT) in {(fault.id, fault.device) for fault in seen.faults}
    turning = [s for s in seen.seen if 0.1 < s.time and not s.standing]
    assert turning[-1].time < silent + 1.0
    assert not any("stopped" in s.phase or "arm" in s.phase for s in turning)
    assert {node.state for node in seen.world.nodes} == {DriveState.SWITCH_ON_DISABLED}


@pytest.mark.parametrize("act", ["", "quickstop", "end"])
def test_a_second_artemis_sends_nothing_and_ends(tmp_path: Path, act: str) -> None:
    acts = ((0.03, act),) if act else ()
    seen = unready(tmp_path, *acts, faults=[TURNING, {"at_s": 0.1, "inject": "COM-18"}]).run()
    assert (seen.status, seen.fault_ids) == (1, ["COM-18"])
    assert seen.seen[-1].time < 0.5
    assert {frame.id for _, frame in seen.bus.sent} == {HEARTBEAT + 127}, "the other one's"


def test_where_a_second_artemis_begins_the_first_one_stops_and_releases_its_drives(tmp_path: Path) -> None:
    rig = DeafRig(tmp_path, lambda frame: False, faults=[{"at_s": 5.4, "inject": "COM-18"}])
    seen = rig.run()
    assert seen.modes[-3:] == [Mode.FOLLOW, Mode.FAULT, Mode.END]
    assert standing(seen.world.truth)
    assert {node.read(WATCH, 1) for node in seen.world.nodes} == {0}
