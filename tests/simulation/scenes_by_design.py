"""What happens where a row of the fault table is no fault, by design, or is not built: what its reason says."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from unittest.mock import patch

import pytest
from every_row import SETTINGS, SETTLING, WATCH, Notice, Scene, play, ramp, targets
from rig import BRAKING, EMERGENCY, HEARTBEAT, SET_POINTS, STOP_FRAMES, TELEOP, TICK, Rig, Run, Seen, run, write_mission
from rig import stick as table
from watched import TRACTION, standing

from artemis.drive_states import DriveState
from artemis.values import JobKind, Mode

LEFT, RIGHT = TRACTION
AT = SETTINGS["driving"].at
Proof = Callable[[Path], None]
BY_DESIGN: dict[str, Proof] = {}
"""By row of the fault table."""


def shows(*ids: str) -> Callable[[Proof], Proof]:
    """This shows what happens instead of these faults."""

    def register(proof: Proof) -> Proof:
        assert not BY_DESIGN.keys() & set(ids)
        BY_DESIGN.update(dict.fromkeys(ids, proof))
        return proof

    return register


def decisions(done: Run) -> list[object]:
    """All that left the host's decision core, tick by tick."""
    return [(s.time, s.mode, s.tick.wish.command.action, s.tick.set_points) for s in done.seen]


def assert_changes_nothing(folder: Path, id: str, scene: Scene) -> Run:
    """The run is the same as one without it."""
    done, without = play(folder / "with", id, scene), play(folder / "without", id, scene, happens=False)
    assert decisions(done) == decisions(without)
    assert (done.status, done.fault_ids) == (0, [])
    return done


def first(done: Run, condition: Callable[[Seen], bool], since: float = AT) -> Seen:
    """The first tick from a run time on that fulfils it."""
    return next(seen for seen in done.seen if seen.time >= since and condition(seen))


# ---------------------------------------------------------------------------------------------- drives and bus


@shows("DRV-30")
def errors_gone_says_nothing(folder: Path) -> None:
    done = assert_changes_nothing(folder, "DRV-30", Scene(node=LEFT))
    assert [frame for frame in done.bus.heard if frame.id == EMERGENCY + 1 and frame.data == bytes(8)]
    fault = {"at_s": AT, "inject": "DRV-25", "node": LEFT}
    scene = Scene(of="stopping", at=4.3, node=LEFT, along=[fault], operator=[(5.0, "end")])
    stopped = play(folder / "stopped", "DRV-30", scene)
    assert {seen.mode for seen in stopped.seen if 3.5 < seen.time < 4.9} == {Mode.FAULT}
    assert stopped.fault_ids == ["DRV-25"]


@shows("LAS-04")
def telegrams_in_pieces_are_put_together(folder: Path) -> None:
    done = assert_changes_nothing(folder, "LAS-04", Scene(of="standing", scanner=True, options={"bytes": 100}))
    scans = [seen.tick.snapshot.sensed.scans for seen in done.seen if seen.time > SETTINGS["standing"].at]
    assert all(scans[1:-10])


@shows("COM-13")
def what_comes_twice_changes_nothing(folder: Path) -> None:
    done = assert_changes_nothing(folder, "COM-13", Scene(of="swinging"))
    twice = [seen.tick.snapshot.sensed.drives for seen in done.seen if AT + 0.1 < seen.time < AT + 1.0]
    assert {drive.frames for drives in twice for drive in drives} == {2}


@shows("COM-23")
def adapter_that_is_back_waits_for_an_acknowledgment(folder: Path) -> None:
    scene = Scene(operator=[(5.5, "acknowledge"), (6.9, "end")])
    done = play(folder, "COM-23", scene)
    back = AT + 0.5
    assert done.fault_ids[0] == "COM-22"
    assert {seen.mode for seen in done.seen if back + 1.0 < seen.time < 5.5} == {Mode.FAULT}
    assert done.modes[-3:] == [Mode.FAULT, Mode.INIT, Mode.END]
    configured = {
        result.drive
        for seen in done.seen
        if seen.time > 5.5
        for result in seen.tick.snapshot.sensed.results
        if result.kind is JobKind.CONFIGURE and result.ok
    }
    assert len(configured) == 4
    assert done.seen[-1].time > 6.9
    assert all(standing(truth) for truth in done.truth_from(AT + WATCH + 0.4 / BRAKING + SETTLING))


@shows("RUN-09")
def counter_that_wraps_changes_nothing(folder: Path) -> None:
    scene = Scene(of="swinging", at=0.0, node=LEFT, options={"before_wrap": 500})
    done = assert_changes_nothing(folder, "RUN-09", scene)
    counter = done.world.drive(LEFT).read(0x6064, 0)
    assert isinstance(counter, int)
    assert counter < 0


# ---------------------------------------------------------------------------------------------- inputs


@shows("INP-07", "INP-10")
def controls_that_do_not_rest_wait(folder: Path) -> None:
    for id in ("INP-07", "INP-10"):
        done = play(folder / id, id, Scene(at=0.0, options={"duration_s": 1.5}))
        for mode, begin, end in ((Mode.INIT, 1.0, 1.5), (Mode.READY, 3.0, 4.6)):  # to arm; then the stick is pressed
            waits = {(seen.mode, seen.phase) for seen in done.seen if begin < seen.time < end}
            assert waits == {(mode, "release the controls")}
        assert all(standing(truth) for truth in done.world.history)
        assert (done.status, done.fault_ids) == (0, [])
        assert Mode.TELEOP in done.modes


@shows("INP-09")
def released_enable_button_ramps_down_and_drives_on(folder: Path) -> None:
    done = play(folder, "INP-09", Scene(options={"duration_s": 0.7}))
    stands = AT + 0.04 + 0.4 / 1.0 + SETTLING
    asked = [target for seen in done.seen if AT + 0.04 < seen.time < AT + 0.7 for target in ramp(seen)]
    assert asked == sorted(asked, reverse=True)
    assert all(standing(truth) for truth in done.truth_from(stands) if truth.time < AT + 0.7)
    assert done.truth_at(AT + 1.1).speed > 0.1
    assert (done.status, done.fault_ids) == (0, [])


@shows("INP-11")
def stop_button_stops_at_once(folder: Path) -> None:
    done = play(folder, "INP-11", Scene())
    stop = first(done, lambda seen: seen.mode is Mode.QUICKSTOP)
    assert stop.time <= AT + 0.04
    assert not any(target for _, target in targets(done, Scene(), Notice(stop, None, Mode.TELEOP)))
    assert all(standing(truth) for truth in done.truth_from(stop.now + 0.4 / BRAKING + SETTLING))
    assert (done.status, done.fault_ids) == (1, [])


@shows("INP-12")
def only_the_input_of_the_step_drives_and_every_input_stops(folder: Path) -> None:
    def two_inputs(name: str, *faults: dict[str, object]) -> Run:
        files = {"stick.csv": table(*SETTINGS["driving"].stick), "rest.csv": table((0.0, 0.0, 0.0, 0))}
        inputs = {
            "stick": {"plugin": "scripted", "file": "stick.csv"},
            "other": {"plugin": "scripted", "file": "rest.csv"},
        }
        return run(write_mission(folder / name, [TELEOP], files, inputs=inputs, simulation={"faults": list(faults)}))

    wants = {"at_s": AT, "inject": "INP-12", "input": "other", "speed_m_s": 0.7, "steering_deg": 40.0}
    alone, together = two_inputs("alone"), two_inputs("together", wants)
    assert decisions(together) == decisions(alone)
    assert together.fault_ids == []
    stopped = two_inputs("stopped", {"at_s": AT, "inject": "INP-11", "input": "other"})
    assert first(stopped, lambda seen: seen.mode is Mode.QUICKSTOP).time <= AT + 0.04


# ---------------------------------------------------------------------------------------------- operator


MEDDLES = {"at_s": AT, "inject": "COM-17", "node": "steer-left", "times": 60}
"""Somebody else commands a drive, for 1.2 s."""


@shows("OPR-01")
def acknowledgment_of_what_is_still_there_is_refused(folder: Path) -> None:
    early = AT + 0.9
    scene = Scene(at=early, along=[MEDDLES], operator=[(5.2, "end")])
    done = play(folder, "OPR-01", scene)
    refused = first(done, lambda seen: seen.phase.startswith("cannot acknowledge yet"), early)
    assert refused.time <= early + TICK
    assert "another CANopen master commands the drives" in refused.phase
    assert {seen.mode for seen in done.seen if AT + TICK < seen.time < 5.19} == {Mode.FAULT}


@shows("OPR-02")
def stuck_button_acknowledges_once_in_two_seconds(folder: Path) -> None:
    early = AT + 0.9  # the first one is refused
    scene = Scene(at=early, options={"times": 60}, along=[MEDDLES], operator=[(7.2, "end")])
    done = play(folder, "OPR-02", scene)
    again = first(done, lambda seen: seen.mode is Mode.INIT)
    assert early + 2.0 <= again.time <= early + 2.0 + 1 / 20.0 + 2 * TICK
    assert done.modes[-3:] == [Mode.FAULT, Mode.INIT, Mode.END]


# ---------------------------------------------------------------------------------------------- process


@shows("SYS-04")
def program_that_fails_stops_every_drive_and_beats_no_more(folder: Path) -> None:
    rigs: list[Rig] = []
    with pytest.raises(ExceptionGroup) as caught:
        play(folder, "SYS-04", Scene(), prepare=rigs.append)
    assert str(caught.value.exceptions[0]) == "told to fail"
    after = [(time, frame.id) for time, frame in rigs[0].bus.sent if time > AT - 1e-6]
    stops = [STOP_FRAMES + node for node in (1, 2, 3, 4)]
    assert [id for time, id in after if time <= AT + 1e-6] == stops
    assert {id for _, id in after} == set(stops)


HEARD = 0.1
"""On virtual time signals are looked for now and then only [s]."""


@shows("SYS-05")
def told_to_end_the_robot_stops_in_order(folder: Path) -> None:
    again = {"at_s": AT + 0.1, "inject": "SYS-05"}
    for name, along in (("once", []), ("twice", [again])):
        done = play(folder / name, "SYS-05", Scene(along=along))
        assert first(done, lambda seen: seen.mode is Mode.END).time <= AT + HEARD
        assert all(standing(truth) for truth in done.truth_from(AT + HEARD + 0.4 / BRAKING + SETTLING))
        assert (done.status, done.fault_ids) == (143, [])
        assert done.world.truth.states == (DriveState.SWITCH_ON_DISABLED,) * 4
        assert [frame.id for _, frame in done.bus.sent if frame.id > HEARTBEAT][-1] == HEARTBEAT + 127


@shows("SYS-10")
def drive_found_turning_is_stopped_before_anything_else(folder: Path) -> None:
    done = play(folder, "SYS-10", Scene(of="bring-up", node=RIGHT))
    assert not standing(done.truth_at(0.29))
    assert not [frame for time, frame in done.bus.sent if time < 0.3 - 1e-6]
    configured = first(done, lambda seen: seen.phase == "configure", 0.0)
    assert all(standing(truth) for truth in done.truth_from(configured.now))
    assert not [
        frame for time, frame in done.bus.sent if SET_POINTS < frame.id < SET_POINTS + 5 and time < configured.now
    ]
    assert (done.status, done.fault_ids) == (0, [])


@shows("PWR-01", "PWR-03")
def low_supply_that_drives_bear_is_not_seen(folder: Path) -> None:
    for id in ("PWR-01", "PWR-03"):
        done = play(folder / id, id, Scene())
        assert (done.status, done.fault_ids) == (0, [])


@shows("SYS-02")
def wall_clock_that_jumps_changes_nothing(folder: Path) -> None:
    scene, runs = Scene(of="swinging"), []
    for days in (0, 365, -365):
        date = datetime(2026, 5, 4, 12, tzinfo=UTC) + timedelta(days=days)
        with patch("artemis.clock.wall_date", lambda date=date: date):
            runs.append(play(folder / str(days), "SYS-02", scene, happens=False))
    assert decisions(runs[0]) == decisions(runs[1]) == decisions(runs[2])
