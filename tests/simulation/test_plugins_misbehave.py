"""Followers and inputs that fail while the robot drives: it comes to rest, and the fault says whose it is."""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from msgspec.structs import replace
from rig import CALIBRATE, STICK, TELEOP, TICK, Rig, Run, follow, standing, stick, straight, write_mission

from artemis.app import Parts, run_mission
from artemis.config import Config
from artemis.devices.drive import Drives
from artemis.drive_states import DriveState
from artemis.errors import DeviceLost
from artemis.mission.actions import PluginUse
from artemis.mission.loading import load_mission
from artemis.motion.path import Path as DrivenPath
from artemis.plugins.contracts import Following, PluginContext
from artemis.plugins.inputs.scripted import ScriptedConfig, ScriptedInput
from artemis.recording.journal import read_journal
from artemis.recording.mcap_reader import Recording
from artemis.values import DriveCommand, Mode, OperatorInput, Severity, Snapshot, Tracking

pytestmark = pytest.mark.short_alignment

SPEED = 0.4
DECELERATION = 1.0
"""Of a controlled stop, in the robot file [m/s²]."""
STEPS = [CALIBRATE, follow(SPEED)]
FILES = {"line.csv": straight(3.0)}
FAIL_AT = 0.8


class Straight:
    """A follower that drives straight ahead and after some metres does what `fail` says."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, fail: Callable[[Following], Any], fail_at: float = FAIL_AT) -> None:
        self._fail, self._fail_at = fail, fail_at

    def start(self, path: DrivenPath, snapshot: Snapshot) -> None:
        self._length = path.length

    def step(self, snapshot: Snapshot) -> Following:
        x = snapshot.odometry.pose.x
        tracking = Tracking(arc_length=x, length=self._length, cross_track=snapshot.odometry.pose.y)
        following = Following(command=DriveCommand(speed=SPEED), tracking=tracking, finished=x > self._length)
        return following if x < self._fail_at else self._fail(following)


def raising(_: Following) -> Following:
    raise ZeroDivisionError("a follower's own mistake")


def commanding(speed: float, steering: float) -> Callable[[Following], Following]:
    return lambda following: Following(
        command=DriveCommand(speed=speed, steering=steering), tracking=following.tracking
    )


def run_failing(folder: Path, fail: Callable[[Following], Any]) -> Run:
    return Rig(write_mission(folder, STEPS, FILES), follower=Straight(fail)).run()


def assert_controlled_stop(seen: Run, id: str) -> None:
    """S2: the gate's ramp, drives enabled until the robot stands, then the run ends as failed."""
    fault = seen.faults[0]
    assert (seen.status, fault.id, fault.severity) == (1, id, Severity.CONTROLLED_STOP)
    assert Mode.FAULT not in seen.modes
    begin = seen.first(lambda s: s.tick.wish.fault is not None)
    end = seen.stands_from()
    assert SPEED / DECELERATION - 0.05 < end - begin.now < SPEED / DECELERATION + 0.25
    moving = [truth for truth in seen.truth_from(begin.now) if truth.time <= end]
    assert {state for truth in moving for state in truth.states} == {DriveState.OPERATION_ENABLE}
    speeds = [s.tick.set_points.speed for s in seen.in_mode(Mode.QUICKSTOP)]
    assert all(0 <= b <= a for a, b in itertools.pairwise(speeds))
    assert standing(seen.world.truth)


@pytest.mark.slow
def test_a_follower_without_a_mistake_drives_the_path(tmp_path: Path) -> None:
    seen = run_failing(tmp_path, lambda following: following)
    assert (seen.status, seen.fault_ids) == (0, [])


@pytest.mark.sampled(3)
@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("where", ["speed", "steering"])
def test_a_command_that_is_no_number_is_a_controlled_stop(tmp_path: Path, number: float, where: str) -> None:
    fail = commanding(number, 0.0) if where == "speed" else commanding(SPEED, number)
    seen = run_failing(tmp_path, fail)
    assert_controlled_stop(seen, "RUN-11")
    points = [s.tick.set_points for s in seen.seen]
    assert all(math.isfinite(p.speed_left + p.speed_right + p.steering_left + p.steering_right) for p in points)


def test_a_follower_that_raises_is_a_controlled_stop(tmp_path: Path) -> None:
    seen = run_failing(tmp_path, raising)
    assert_controlled_stop(seen, "PLG-02")
    assert "ZeroDivisionError" in seen.faults[0].text


def leaving(_: Following) -> Following:
    sys.exit(0)


def test_a_follower_that_ends_the_program_is_a_controlled_stop_and_a_failed_run(tmp_path: Path) -> None:
    seen = run_failing(tmp_path, leaving)
    assert_controlled_stop(seen, "PLG-02")
    assert "SystemExit(0)" in seen.faults[0].text


def test_a_follower_that_computes_with_numpy_is_driven_and_recorded(tmp_path: Path) -> None:
    def with_numpy(following: Following) -> Following:
        command = DriveCommand(speed=np.float64(SPEED), steering=np.float32(0.0))  # type: ignore[arg-type]
        tracking = replace(following.tracking, cross_track=np.float64(following.tracking.cross_track))
        return Following(command=command, tracking=tracking, finished=np.bool_(following.finished))  # type: ignore[arg-type]

    follower = Straight(with_numpy, fail_at=0.0)
    seen = Rig(write_mission(tmp_path, STEPS, FILES), follower=follower).run()
    assert (seen.status, seen.fault_ids) == (0, [])
    assert seen.outcome is not None
    assert len(list(Recording(seen.outcome.run.path).ticks())) == len(seen.ticks)


def test_a_follower_that_raises_at_its_start_never_moves_the_robot(tmp_path: Path) -> None:
    class Unwilling(Straight):
        def start(self, path: DrivenPath, snapshot: Snapshot) -> None:
            raise ValueError("not this path")

    seen = Rig(write_mission(tmp_path, STEPS, FILES), follower=Unwilling(raising)).run()
    assert (seen.status, seen.faults[0].id) == (1, "PLG-02")
    begin = seen.in_mode(Mode.FOLLOW)[0].now
    assert all(standing(truth) for truth in seen.truth_from(begin))


ODD = DriveCommand(speed=SPEED, action="run")  # type: ignore[arg-type]
TRACKED = Tracking(arc_length=1.0, length=3.0, cross_track=0.0)


@pytest.mark.parametrize("answer", [None, 7, DriveCommand(speed=0.2), Following(command=ODD, tracking=TRACKED)])
def test_a_follower_that_answers_garbage_is_a_controlled_stop(tmp_path: Path, answer: object) -> None:
    assert_controlled_stop(run_failing(tmp_path, lambda following: answer), "PLG-06")


@pytest.mark.slow
def test_a_command_beyond_every_limit_is_limited_not_obeyed(tmp_path: Path) -> None:
    seen = run_failing(tmp_path, commanding(1e9, 1e9))
    assert max(abs(s.tick.set_points.speed) for s in seen.seen) <= 0.7
    assert max(abs(s.tick.set_points.steering) for s in seen.seen) <= math.radians(60) + 1e-5


@pytest.mark.slow
def test_a_follower_that_leaves_the_path_is_stopped_at_the_limit(tmp_path: Path) -> None:
    def astray(following: Following) -> Following:
        return replace(following, command=DriveCommand(speed=SPEED, steering=0.4))

    seen = Rig(
        write_mission(tmp_path, STEPS, {"line.csv": straight(6.0)}), follower=Straight(astray, fail_at=1.5)
    ).run()
    assert (seen.status, seen.faults[0].id) == (1, "PTH-06")
    assert 0.55 < abs(seen.world.pose.y) < 0.6 + SPEED**2 / (2 * DECELERATION) + 0.05
    assert standing(seen.world.truth)


def test_a_path_that_begins_too_far_away_is_not_begun(tmp_path: Path) -> None:
    away = "x,y\n" + "".join(f"{x / 10},1.5\n" for x in range(20))
    seen = Rig(write_mission(tmp_path, STEPS, {"line.csv": away})).run()
    assert (seen.status, seen.faults[0].id) == (1, "PTH-05")
    begin = seen.in_mode(Mode.FOLLOW)[0].now
    assert all(standing(truth) for truth in seen.truth_from(begin))


# ---------------------------------------------------------------------------------------------- inputs

DRIVING = stick((0.0, 0.0, 0.0, 0), (5.9, 0.0, 0.6, 1), (9.4, 0.0, 0.6, 1))
RELEASED = stick((0.0, 0.0, 0.0, 0), (5.9, 0.0, 0.6, 1), (8.4, 0.0, 0.6, 0), (11.4, 0.0, 0.0, 0))


def teleop_mission(folder: Path, table: str, **options: object) -> Path:
    inputs = {"stick": {**STICK["stick"], **options}}
    return write_mission(folder, [CALIBRATE, TELEOP], {"stick.csv": table}, inputs=inputs)


def test_an_input_that_freezes_is_a_controlled_stop(tmp_path: Path) -> None:
    seen = Rig(teleop_mission(tmp_path, DRIVING, done_at_end=False)).run()
    fault = seen.faults[0]
    assert (seen.status, fault.id) == (1, "INP-03")
    assert "stick" in fault.text
    assert not standing(seen.truth_at(9.4))
    begin = seen.first(lambda s: s.tick.wish.fault is not None).time
    assert 0.15 <= begin - 9.4 <= 0.15 + 2 * TICK
    speeds = [s.tick.set_points.speed for s in seen.seen if s.time >= begin]
    assert all(b <= a for a, b in itertools.pairwise(speeds))  # never an increase after the loss
    assert seen.stands_from() - begin < speeds[0] / DECELERATION + 0.25


def test_releasing_the_enable_button_brings_the_robot_to_rest_on_the_ramp(tmp_path: Path) -> None:
    seen = Rig(teleop_mission(tmp_path, RELEASED)).run()
    assert (seen.status, seen.fault_ids) == (0, [])
    speed = seen.truth_at(8.4).speed
    assert speed > 0.3
    assert speed / DECELERATION - 0.1 < seen.stands_from() - 8.4 < speed / DECELERATION + 0.25
    assert Mode.QUICKSTOP not in seen.modes


class Stick:
    """An input that drives forward, and after a while does what `fail` says."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, fail: Callable[[OperatorInput], Any]) -> None:
        self._fail = fail

    def read(self, now: float) -> OperatorInput:
        if now < 5.9:
            return OperatorInput(source="stick", age=0.0)
        sample = OperatorInput(source="stick", speed=0.4, enabled=True, neutral=False, age=0.0)
        return sample if now < 8.4 else self._fail(sample)

    def close(self) -> None: ...


def test_an_input_that_raises_stops_the_robot(tmp_path: Path) -> None:
    def unplugged(_: OperatorInput) -> OperatorInput:
        raise OSError("device gone")

    seen = Rig(teleop_mission(tmp_path, DRIVING), input=Stick(unplugged)).run()
    assert (seen.status, seen.faults[0].id) == (1, "PLG-02")
    assert "device gone" in seen.faults[0].text
    assert seen.stands_from() - 8.4 < 0.4 / DECELERATION + 0.3


@pytest.mark.slow
def test_an_input_that_ends_the_program_when_it_is_closed_changes_nothing(tmp_path: Path) -> None:
    class Leaving(Stick):
        def close(self) -> None:
            sys.exit(0)

    mission = teleop_mission(tmp_path, DRIVING)
    seen = Rig(mission, input=Leaving(lambda sample: None)).run()
    assert (seen.status, seen.faults[0].id) == (1, "PLG-06")
    assert seen.outcome is not None
    warnings = [entry.text for entry in read_journal(seen.outcome.run.journal).entries if entry.kind == "warning"]
    (warning,) = warnings
    assert warning.startswith("PLG-02 stick: SystemExit(0) at test_plugins_misbehave.py:")
    assert warning.endswith(", when it was closed")


@pytest.mark.slow
def test_an_input_that_is_lost_with_a_name_that_is_no_text_stops_the_robot_and_is_told(tmp_path: Path) -> None:
    def unplugged(_: OperatorInput) -> OperatorInput:
        raise DeviceLost("stick", "/dev/input/js\udcff: gone")

    seen = Rig(teleop_mission(tmp_path, DRIVING), input=Stick(unplugged)).run()
    assert (seen.status, seen.faults[0].id) == (1, "INP-01")
    assert seen.outcome is not None
    told = [entry.text for entry in read_journal(seen.outcome.run.journal).entries if entry.kind == "fault"]
    assert any(r"/dev/input/js\udcff: gone" in text for text in told)


def test_a_number_that_is_none_from_an_input_is_a_controlled_stop(tmp_path: Path) -> None:
    seen = Rig(
        teleop_mission(tmp_path, DRIVING),
        input=Stick(lambda s: OperatorInput(source="stick", speed=math.nan, enabled=True, neutral=False, age=0.0)),
    ).run()
    assert (seen.status, seen.faults[0].id, seen.faults[0].severity) == (1, "INP-06", Severity.CONTROLLED_STOP)
    assert seen.stands_from() - 8.4 < 0.4 / DECELERATION + 0.3


@pytest.mark.slow
def test_a_stick_that_is_held_when_teleoperation_begins_moves_nothing_until_it_is_released(tmp_path: Path) -> None:
    held = (3.0, 0.0, 0.6, 1)  # while the wheels align: the run is armed with released controls only
    table = stick((0.0, 0.0, 0.0, 0), held, (10.4, 0.0, 0.0, 0), (11.4, 0.0, 0.6, 1), (13.4, 0.0, 0.0, 0))
    seen = Rig(teleop_mission(tmp_path, table)).run()
    ready = next(s.now for s in reversed(seen.in_mode(Mode.READY)) if s.time < 10.4)
    assert ready > 10.3
    assert seen.in_mode(Mode.TELEOP)[0].time >= 10.4
    assert not standing(seen.truth_at(12.9))


def test_bus_and_inputs_are_closed_where_another_input_cannot_be_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed: list[str] = []

    class Picky(ScriptedInput):
        def __init__(self, config: ScriptedConfig, context: PluginContext) -> None:
            if context.name == "second":
                raise KeyError("second")
            super().__init__(config, context)

        def close(self) -> None:
            closed.append("first")

    def make(group: str, use: PluginUse, context: PluginContext) -> Picky:
        return Picky(ScriptedConfig(file="stick.csv"), context)

    inputs = {"first": STICK["stick"], "second": STICK["stick"]}
    mission = write_mission(tmp_path, [CALIBRATE], {"stick.csv": stick((0, 0, 0, 0))}, inputs=inputs)
    monkeypatch.setattr(Drives, "close", lambda drives: closed.append("bus"))
    with pytest.raises(KeyError, match="second"):
        run_mission(load_mission(mission), mission, parts=Parts(plugins=make))
    assert closed == ["first", "bus"]
