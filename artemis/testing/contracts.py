"""What every plugin must do, as tests: its author inherits them, and pytest finds them.

    class TestStick(InputContract):
        plugin = StickInput
        options = {"file": "stick.csv"}  # as a mission writes them beside `plugin:`
        files = {"stick.csv": b"..."}    # contents of the files that the options name

No robot, no bus and no mission is needed. Each failure says what is wrong and which fault would stop the robot.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from msgspec.structs import replace
from pydantic import ValidationError

from artemis.clock import stopwatch
from artemis.config import Config
from artemis.motion.angles import difference
from artemis.motion.limits import Gate, is_sane
from artemis.motion.odometry import move
from artemis.motion.path import Path, path_from_points
from artemis.plugins.answers import is_in_range, is_whole_input, plain_following
from artemis.plugins.contracts import Follower, Following, InputDevice, PluginContext
from artemis.plugins.guard import LATE
from artemis.plugins.registry import CONTRACTS, FOLLOWERS, INPUTS, breaches
from artemis.plugins.stated import is_live
from artemis.values import (
    DriveCommand,
    LocatedPose,
    Odometry,
    OperatorInput,
    Pose,
    Sensed,
    SetPoints,
    Snapshot,
    Verdict,
)
from artemis.vehicle import RobotFile
from artemis.yaml_file import load

NAME = "tried"
"""What the mission of these tests calls the plugin."""
PERIOD = 0.02
"""Time between ticks [s]."""
TRIES = 20
"""The quickest of so many calls counts: what else the computer does takes no part."""
BEYOND = 1.02
"""Commands may be so far beyond the robot's limits without a warning (RUN-12)."""
ROBOT = RobotFile.model_validate(load(FilePath(__file__).with_name("artemis.yaml")).data)


class PluginContract:
    """What holds for plugins of every group."""

    group: str
    plugin: type[Any]
    """The class to try."""
    options: Mapping[str, object] = {}
    """Its keys, as a mission writes them beside `plugin:`."""
    files: Mapping[str, bytes] = {}
    """Contents of the files that the options name."""
    robot: RobotFile = ROBOT

    def given(self) -> PluginContext:
        """What a new plugin may know. Override for a device that needs more of it."""
        return PluginContext(name=NAME, robot=self.robot, folder=FilePath(), files=self.files)

    def make(self) -> Any:  # noqa: ANN401  (a plugin of the group; another class would be found by the first test)
        """A new plugin, made as artemis makes it."""
        return self.plugin(self.plugin.Config.model_validate(dict(self.options)), self.given())

    def test_class_meets_its_contract(self) -> None:
        """It has the methods of its group, a Config, and no other contract version than this artemis."""
        problems = breaches(self.plugin, CONTRACTS[self.group])
        assert not problems, f"{self.plugin.__name__} {'; '.join(problems)}"

    def test_config_is_strict(self) -> None:
        """Unknown keys and loose types are refused: a misspelt key in a mission must not be ignored."""
        config = self.plugin.Config
        for key, value in Config.model_config.items():
            found = config.model_config.get(key)
            assert found == value, f"Config has {key}={found!r}; artemis.config.Config wants {value!r}"
        refused: list[object] = []
        try:
            config.model_validate({**self.options, "no_such_key": 1})
        except ValidationError as error:
            refused = [found["loc"] for found in error.errors()]
        assert refused == [("no_such_key",)], f"given the key no_such_key beside the options, Config refuses {refused}"


class InputContract(PluginContract):
    """An input device: inherit, set `plugin`, and `options` and `files` if it has any."""

    group = INPUTS
    duration: float = 60.0
    """So long it is read [s], of run time: nothing waits for it."""

    def move(self, device: Any) -> None:  # noqa: ANN401  (the author's own class)
        """Override: press the enable button and move an axis, and return when `device` has heard of it.

        Without it the device is taken for one that moves by itself, or not at all.
        """

    @contextmanager
    def made(self) -> Iterator[InputDevice]:
        """A device, closed afterwards."""
        device: InputDevice = self.make()
        try:
            yield device
        finally:
            device.close()

    def samples(self) -> Iterator[tuple[float, OperatorInput]]:
        """What a new device says tick by tick, moved after the first second, with the run times [s]."""
        with self.made() as device:
            for tick in range(round(self.duration / PERIOD)):
                if tick == round(1.0 / PERIOD):
                    self.move(device)
                now = tick * PERIOD
                sample = device.read(now)
                assert is_whole_input(sample), f"read({now:.2f}) gave {sample!r}: no whole OperatorInput (PLG-06)"
                yield now, sample

    def test_samples_are_whole(self) -> None:
        """Every answer is an OperatorInput with the right types in it, and carries its name in the mission."""
        for now, sample in self.samples():
            assert sample.source == NAME, f"read({now:.2f}) has the source {sample.source!r}, not context.name (PLG-06)"

    def test_samples_are_in_range(self) -> None:
        """Numbers are finite, axes within -1 and 1, no age is negative, and the wish is within the robot's limits."""
        limits = self.robot.limits
        for now, sample in self.samples():
            seen = f"read({now:.2f}) gave {sample}"
            assert is_in_range(sample), (
                f"{seen}: a number not finite, an axis beyond 1, a negative age, or too many requests (INP-06)"
            )
            assert abs(sample.speed) <= BEYOND * limits.speed_m_s, f"{seen}: faster than the robot (RUN-12)"
            assert abs(sample.steering) <= BEYOND * math.radians(limits.steering_deg), (
                f"{seen}: steered further than the robot can (RUN-12)"
            )

    def test_begins_at_rest(self) -> None:
        """The first sample wants nothing: controls rest, or nobody knows of them yet (age None)."""
        _, first = next(self.samples())
        assert not first.enabled, f"the first sample is enabled: {first}"
        assert first.neutral or first.age is None, f"the first sample is neither neutral nor without age: {first}"

    def test_neutral_means_released(self) -> None:
        """A neutral sample is not enabled and wishes no speed."""
        for now, sample in self.samples():
            released = not sample.enabled and sample.speed == 0
            assert released or not sample.neutral, f"read({now:.2f}) gave a neutral sample that drives: {sample}"

    def test_age_is_time_since_the_sample(self) -> None:
        """It is None until a sample came, then never again, and never grows faster than time."""
        before: float | None = None
        for now, sample in self.samples():
            seen = f"read({now:.2f}) gave age {sample.age}"
            if sample.age is None:
                assert before is None, f"{seen} after {before}: None means that there never was a sample"
                continue
            grown = 0.0 if before is None else sample.age - before
            assert grown <= PERIOD + 1e-6, f"{seen} after {before}: it grew faster than time"
            before = sample.age

    def test_movement_arrives(self) -> None:
        """When the device was moved the next sample is another, and new. Only where `move` is overridden."""
        if type(self).move is InputContract.move:
            return
        with self.made() as device:
            before = device.read(0.0)
            self.move(device)
            after = device.read(PERIOD)
        assert replace(after, age=before.age) != before, f"the device was moved, and the sample is still {before}"
        assert after.age is not None, "the device was moved, and no sample has ever come (INP-01)"
        assert after.age <= PERIOD, f"the device was moved just now, and its sample is {after.age:.3f} s old (INP-03)"

    def test_read_does_not_wait(self) -> None:
        """It runs inside the tick."""
        with self.made() as device:
            took = quickest(device.read, [tick * PERIOD for tick in range(TRIES)])
        assert took <= LATE, f"read() takes {took * 1000:.0f} ms, {LATE * 1000:.0f} are allowed (PLG-03)"

    def test_same_reads_give_same_samples(self) -> None:
        """Time comes from `now` alone. Not asked of a `live` device, which reports when it likes."""
        if is_live(self.plugin):
            return
        with self.made() as one, self.made() as other:
            for tick in range(round(self.duration / PERIOD)):
                first, second = one.read(tick * PERIOD), other.read(tick * PERIOD)
                assert first == second, (
                    f"read({tick * PERIOD:.2f}) gave {first} and, of a second device read at the same times, {second}: "
                    "does it use another time than `now`, or randomness without a seed?"
                )

    def test_close_is_harmless(self) -> None:
        """Before the first read, after it, and twice."""
        for reads in (0, 1):
            device = self.make()
            for tick in range(reads):
                device.read(tick * PERIOD)
            device.close()
            device.close()


@dataclass(frozen=True, slots=True)
class TrialDrive:
    """A drive along a path: what the follower was shown, what it answered, and where the robot came to rest."""

    path: Path
    steps: list[tuple[Snapshot, Following]]
    end: Pose


class FollowerContract(PluginContract):
    """A follower: inherit, set `plugin`, and `options` and `files` if it has any.

    It drives a robot whose pose is known exactly, which obeys one tick late and within the gate's limits.
    """

    group = FOLLOWERS
    nearness: float = 0.2
    """So near to its path it stays [m]."""
    patience: float = 300.0
    """So long it may take for ten metres [s], of run time."""

    def drive(self, path: Path, begin: Pose | None = None, follower: Follower | None = None) -> TrialDrive:
        """Drive along `path` to the end; `begin`: where the robot stands first, its start if left out."""
        car = TrialCar(self.robot, begin or _start_of(path))
        follower = follower or self.make()
        follower.start(path, car.snapshot())
        steps: list[tuple[Snapshot, Following]] = []
        while not (steps and steps[-1][1].finished and car.stands):
            assert len(steps) * PERIOD < self.patience, f"not finished after {self.patience:.0f} s (PTH-08)"
            snapshot = car.snapshot()
            answer = follower.step(snapshot)
            assert plain_following(answer), f"step() gave {answer!r}: no whole Following (PLG-06)"
            assert is_sane(answer.command), f"not finite: {answer.command} (RUN-11)"
            steps.append((snapshot, answer))
            car.obey(answer.command)
        return TrialDrive(path, steps, car.pose)

    def test_follows_a_straight(self) -> None:
        """From its start."""
        self._assert_near(self.drive(_straight(4.0)))

    def test_follows_a_circle(self) -> None:
        """Of 1 m radius, to the left, once around."""
        self._assert_near(self.drive(_circle(1.0)))

    def test_comes_onto_its_path(self) -> None:
        """From 0.3 m to the left of it, and 0.3 rad askew: within 5 m of 6, without swinging out again."""
        drive = self.drive(_straight(6.0), Pose(y=0.3, heading=0.3))
        for pose in (snapshot.pose.pose for snapshot, _ in drive.steps):
            assert pose.x < 5.0 or abs(pose.y) <= self.nearness, f"{pose.y:+.2f} m from the path after {pose.x:.2f} m"

    def test_commands_are_possible(self) -> None:
        """They are within the robot's limits: the gate would hold them back, and warn."""
        limits = self.robot.limits
        for _, answer in self.drive(_straight(6.0), Pose(y=-0.5, heading=-0.9)).steps:
            command = answer.command
            assert abs(command.speed) <= BEYOND * limits.speed_m_s, f"faster than the robot: {command} (RUN-12)"
            assert abs(command.steering) <= BEYOND * math.radians(limits.steering_deg), (
                f"steered further than the robot can: {command} (RUN-12)"
            )

    def test_finishes_at_the_end(self) -> None:
        """Once, with speed 0, and the robot comes to rest there."""
        drive = self.drive(_straight(3.0))
        first = next(index for index, (_, answer) in enumerate(drive.steps) if answer.finished)
        for _, answer in drive.steps[first:]:
            assert answer.finished, "finished, and then no longer"
            assert answer.command.speed == 0, f"finished, and asks for {answer.command.speed:g} m/s"
        assert abs(drive.end.x - 3.0) <= self.nearness, f"came to rest at {drive.end.x:.2f} m of a path of 3 m (PTH-08)"

    def test_tracking_is_true(self) -> None:
        """Arc length, length, cross-track and heading error are those of the pose: the robot is judged by them."""
        for path, begin in ((_straight(4.0), Pose(y=0.3, heading=-0.3)), (_circle(1.0), None)):
            near = 0.0
            for snapshot, answer in self.drive(path, begin).steps:
                pose, told = snapshot.pose.pose, answer.tracking
                true = path.project(pose.x, pose.y, near=near)
                near = true.arc_length
                for what, found, expected, within in (
                    ("length [m]", told.length, path.length, 0.01),
                    ("arc_length [m]", told.arc_length, true.arc_length, 0.1),
                    ("cross_track [m], left positive", told.cross_track, true.cross_track, 0.02),
                    ("heading_error [rad]", told.heading_error, difference(pose.heading, true.heading), 0.05),
                ):
                    assert abs(found - expected) <= within, (
                        f"tracking.{what}: {found:.3f}, true is {expected:.3f}, at {snapshot.time:.2f} s"
                    )

    def test_same_snapshots_give_same_commands(self) -> None:
        """Nothing but the snapshots counts: a run must replay."""
        self._assert_repeats(self.drive(_circle(1.0)), self.make(), "a second follower")

    def test_start_begins_anew(self) -> None:
        """The same follower, started again on the same path, knows nothing of the first time."""
        follower: Follower = self.make()
        self._assert_repeats(self.drive(_circle(1.0), follower=follower), follower, "the same follower, started again,")

    def test_step_does_not_wait(self) -> None:
        """It runs inside the tick."""
        follower: Follower = self.make()
        drive = self.drive(_straight(2.0), follower=follower)
        snapshots = [snapshot for snapshot, _ in drive.steps]
        follower.start(drive.path, snapshots[0])
        took = quickest(follower.step, snapshots[:TRIES])
        assert took <= LATE, f"step() takes {took * 1000:.0f} ms, {LATE * 1000:.0f} are allowed (PTH-09)"

    def _assert_near(self, drive: TrialDrive) -> None:
        near = 0.0
        for snapshot, _ in drive.steps:
            pose = snapshot.pose.pose
            true = drive.path.project(pose.x, pose.y, near=near)
            near, away = true.arc_length, abs(true.cross_track)
            assert away <= self.nearness, f"{away:.2f} m from the path at {near:.2f} m of it; {self.nearness} are fine"

    def _assert_repeats(self, drive: TrialDrive, follower: Follower, who: str) -> None:
        follower.start(drive.path, drive.steps[0][0])
        for snapshot, first in drive.steps:
            again = follower.step(snapshot)
            assert again == first, f"step() at {snapshot.time:.2f} s gave {first}; {who} gave {again}"


class TrialCar:
    """A robot that does what leaves the gate, one tick later; the pose of its rear axle is exact."""

    def __init__(self, robot: RobotFile, pose: Pose) -> None:
        self.pose = pose
        self._gate, self._wheelbase = Gate(robot, PERIOD), robot.geometry.wheelbase_m
        self._wanted = self._done = SetPoints()
        self._tick, self._distance = 0, 0.0

    @property
    def stands(self) -> bool:
        """It has come to rest, and nothing else is on its way."""
        return self._done.speed == 0 and self._wanted.speed == 0

    def snapshot(self) -> Snapshot:
        """What the plugin sees now."""
        return Snapshot(
            sensed=Sensed(index=self._tick, time=self._tick * PERIOD),
            dt=PERIOD if self._tick else 0.0,
            pose=LocatedPose(pose=self.pose),
            odometry=Odometry(
                pose=self.pose, speed=self._done.speed, steering=self._done.steering, distance=self._distance
            ),
            standing=self.stands,
            set_points=self._wanted,
            verdict=Verdict(),
        )

    def obey(self, command: DriveCommand) -> None:
        """One tick passes."""
        self._done, self._wanted = self._wanted, self._gate.limit(command, self._wanted, PERIOD)
        step, steering = self._done.speed * PERIOD, self._done.steering
        forward = step * math.cos(steering)
        self.pose = move(self.pose, forward, step * math.sin(steering) / self._wheelbase)
        self._distance += forward
        self._tick += 1


def quickest(call: Callable[[Any], object], arguments: Sequence[Any]) -> float:
    """Shortest time that a call took [s]."""
    times = []
    for argument in arguments:
        begun = stopwatch()
        call(argument)
        times.append(stopwatch() - begun)
    return min(times)


def _straight(length: float) -> Path:
    """Along x."""
    x = np.linspace(0.0, length, round(length / 0.1) + 1)
    return path_from_points(x, 0 * x)


def _circle(radius: float) -> Path:
    """Closed, to the left, from the origin along x."""
    angles = np.linspace(0.0, math.tau, 97)
    return path_from_points(radius * np.sin(angles), radius * (1 - np.cos(angles)))


def _start_of(path: Path) -> Pose:
    point = path.at(0.0)
    return Pose(x=point.x, y=point.y, heading=point.heading)
