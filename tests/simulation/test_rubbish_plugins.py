"""Whatever a plugin answers, the robot stops in order: rubbish from an input, a follower that ends at full speed."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import pytest
from msgspec.structs import replace
from rig import CALIBRATE, STICK, TELEOP, Rig, Run, driven, follow, standing, stick, straight, write_mission

from artemis.config import Config
from artemis.drive_states import DriveState
from artemis.motion.path import Path as DrivenPath
from artemis.plugins.contracts import Following
from artemis.values import DriveCommand, Mode, OperatorInput, Request, Snapshot, Tracking

pytestmark = pytest.mark.short_alignment

LENGTH = 3.0
FILES = {"line.csv": straight(LENGTH), "stick.csv": stick((0.0, 0.0, 0.0, 0), (1.0, 0.0, 0.0, 0))}
SPEED = 0.5
RUBBISH_AT = 7.2
"""Run time at which an input goes mad, the robot driving by it [s]."""


# ---------------------------------------------------------------------------------------------- inputs


class MadInput:
    """An input that drives, and answers rubbish from a time on."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, spoil: Callable[[OperatorInput], Any]) -> None:
        self._spoil = spoil

    def read(self, now: float) -> OperatorInput:
        drives = now > 4.2
        speed = SPEED if drives else 0.0
        answer = OperatorInput(source="stick", speed=speed, enabled=drives, neutral=not drives, age=0.0)
        if now > RUBBISH_AT:
            answer = self._spoil(answer)
        return answer

    def close(self) -> None: ...


def having(**rubbish: object) -> Callable[[OperatorInput], OperatorInput]:
    return lambda answer: replace(answer, **rubbish)


RUBBISH: dict[str, Callable[[OperatorInput], Any]] = {
    "a string": lambda answer: "rubbish",
    "nothing": lambda answer: None,
    "the type": lambda answer: OperatorInput,
    "speed None": having(speed=None),
    "speed a string": having(speed="0.5"),
    "speed infinite": having(speed=math.inf),
    "speed too large for a float": having(speed=10**400),
    "steering NaN": having(steering=math.nan),
    "age NaN": having(age=math.nan),
    "age of a clock that is ahead": having(age=-1000.0),
    "name of another input": having(source="wheel"),
    "axes NaN": having(axes=(0.0, math.nan)),
    "axes None": having(axes=None),
    "axes of strings": having(axes=("a",)),
    "raw axes None": having(raw=None),
    "requests None": having(requests=None),
    "requests of strings": having(requests=("quick stop",)),
}


@pytest.mark.sampled(3)
@pytest.mark.sampled(3)
@pytest.mark.parametrize("spoil", RUBBISH.values(), ids=RUBBISH)
def test_rubbish_from_an_input_stops_the_robot_in_order(tmp_path: Path, spoil: Callable[[OperatorInput], Any]) -> None:
    seen = Rig(write_mission(tmp_path, [TELEOP], FILES, inputs=STICK), input=MadInput(spoil)).run()
    assert seen.status == 1
    assert seen.fault_ids in (["PLG-06"], ["INP-06"])  # no sample at all; one whose numbers are out of range
    assert seen.faults[0].device == "stick"
    mad = seen.first(lambda s: s.time > RUBBISH_AT).now
    assert seen.truth_at(mad).speed == pytest.approx(SPEED, rel=0.05)
    assert 0.3 < seen.stands_from() - mad < SPEED / 1.0 + 0.3  # a controlled stop
    assert_ended_in_order(seen)


def assert_ended_in_order(seen: Run) -> None:
    assert seen.ticks[-1].wish.finished
    assert standing(seen.world.truth)
    assert seen.world.truth.states == (DriveState.SWITCH_ON_DISABLED,) * 4


# ---------------------------------------------------------------------------------------------- followers


class Ahead:
    """A follower that drives straight ahead. What it says of its distance is up to `cross_track` and `stops`."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, cross_track: Callable[[float], float] = lambda arc: 0.0, *, stops: bool = True) -> None:
        self._cross_track, self._stops = cross_track, stops

    def start(self, path: DrivenPath, snapshot: Snapshot) -> None:
        self._length = path.length

    def step(self, snapshot: Snapshot) -> Following:
        arc = min(snapshot.odometry.distance, self._length)
        finished = arc >= self._length - 0.01
        speed = 0.0 if finished and self._stops else SPEED
        tracking = Tracking(arc_length=arc, length=self._length, cross_track=self._cross_track(arc))
        return Following(command=DriveCommand(speed=speed), tracking=tracking, finished=finished)


def test_a_follower_that_is_finished_but_commands_a_speed_ends_its_step_at_rest(tmp_path: Path) -> None:
    wait = {"wait": {"seconds": 0.5}}
    seen = Rig(write_mission(tmp_path, [CALIBRATE, follow(), wait], FILES), follower=Ahead(stops=False)).run()
    assert (seen.status, seen.fault_ids, seen.is_done) == (0, [], True)
    done = seen.first(lambda s: s.mode is Mode.READY and s.phase == "waiting").now
    assert all(standing(truth) for truth in seen.truth_from(done))
    assert LENGTH - 0.01 < seen.world.pose.x < LENGTH + SPEED**2 / 2 + 0.1
    assert_ended_in_order(seen)


def lost_between(*parts: tuple[float, float]) -> Ahead:
    """Says to be 0.8 m beside the path in these parts of it [m]."""
    return Ahead(lambda arc: 0.8 if any(begin < arc < end for begin, end in parts) else 0.0)


def recovering_rig(folder: Path, follower: Ahead) -> Rig:
    """Somebody acknowledges and arms after the first stop, then leaves."""
    operator = [{"at_s": 15.4, "do": "acknowledge"}]
    mission = write_mission(folder, [CALIBRATE, follow()], FILES, simulation={"operator": operator})
    rig = Rig(mission, follower=follower)
    rig.when(lambda s: s.mode is Mode.QUICKSTOP, rig.request(Request.ACKNOWLEDGE), after=2.0, name="acknowledge")
    return rig.when(lambda s: s.mode is Mode.QUICKSTOP, rig.request(Request.ARM), after=2.1, name="arm")


def test_after_being_lost_and_armed_again_the_step_goes_on(tmp_path: Path) -> None:
    seen = recovering_rig(tmp_path, lost_between((1.2, 2.0))).run()
    assert (seen.status, seen.fault_ids) == (0, ["PTH-06"])  # armed again, it may begin beside its path
    assert seen.modes.count(Mode.QUICKSTOP) == 1
    assert driven(seen.in_mode(Mode.FOLLOW)[-1]) == pytest.approx(LENGTH, abs=0.02)


def test_after_being_armed_again_a_robot_that_found_its_path_may_not_lose_it_again(tmp_path: Path) -> None:
    seen = recovering_rig(tmp_path, lost_between((1.2, 1.5), (2.7, 2.9))).run()
    assert seen.modes.count(Mode.QUICKSTOP) == 2
    begun = [b.now for a, b in zip(seen.seen, seen.seen[1:], strict=False) if a.mode is not b.mode is Mode.QUICKSTOP]
    assert [seen.truth_at(time).pose.x for time in begun] == pytest.approx([1.2, 2.7], abs=0.03)
    assert set(seen.fault_ids) == {"PTH-06"}
