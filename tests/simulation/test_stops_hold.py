"""A stop under way is neither weakened, dropped nor outrun, whatever else is asked for in the same tick."""

from __future__ import annotations

import math
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import pytest
from msgspec.structs import replace
from rig import (
    CALIBRATE,
    NODE,
    STEERING,
    STICK,
    STOP_FRAMES,
    TELEOP,
    TRACTION,
    Rig,
    Run,
    controlword,
    driven,
    follow,
    run,
    standing,
    stick,
    straight,
    write_mission,
)

from artemis.config import Config
from artemis.devices.can_bus import Frame
from artemis.devices.drive import Drives
from artemis.drive_states import DriveState
from artemis.errors import DeviceLost
from artemis.mission.loading import load_mission
from artemis.values import Mode, OperatorInput, Request

pytestmark = pytest.mark.short_alignment

OFF, QUICK_STOP, ENABLE = 0x00, 0x0B, 0x0F
LENGTH = 3.0
FILES = {"line.csv": straight(LENGTH), "stick.csv": stick((0.0, 0.0, 0.0, 0), (1.0, 0.0, 0.0, 0))}
DISABLED = (DriveState.SWITCH_ON_DISABLED,) * 4
ENABLED = (DriveState.OPERATION_ENABLE,) * 4
TOO_LATE = 0.0605
"""A tick so late is SYS-01 [s], while the drives' feedback is not yet too old."""


class Pad:
    """An input that rests, and drives from a time on; it may break for so many reads, or freeze."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, go: float = math.inf) -> None:
        self.go, self.freeze, self.failures = go, math.inf, 0

    def read(self, now: float) -> OperatorInput:
        if self.failures:
            self.failures -= 1
            raise OSError("unplugged")
        goes = now > self.go
        speed = 0.6 if goes else 0.0
        return OperatorInput(
            source="stick", speed=speed, enabled=goes, neutral=not goes, age=max(0.0, now - self.freeze)
        )

    def close(self) -> None: ...


def following_rig(folder: Path, speed: float = 0.4, pad: Pad | None = None, *, attended: bool = False) -> Rig:
    """Follows a straight path; with a pad connected that nothing asks."""
    keys: dict[str, Any] = {"inputs": STICK} if pad else {}
    return Rig(
        write_mission(folder, [CALIBRATE, follow(speed)], FILES, simulation=presence(attended), **keys), input=pad
    )


def teleop_rig(folder: Path, pad: Pad) -> Rig:
    """Drives by hand, attended."""
    return Rig(write_mission(folder, [TELEOP], FILES, inputs=STICK, simulation=presence(True)), input=pad)


def presence(attended: bool) -> dict[str, Any]:
    """Somebody who can arm is there for a minute, or nobody."""
    return {"operator": [{"at_s": 55.0, "do": "acknowledge"}]} if attended else {}


def words(seen: Run, begin: float, end: float, *names: str) -> list[int]:
    """Controlwords that these drives were sent, in their order."""
    nodes = {NODE[name] for name in names}
    frames = [frame for time, frame in seen.bus.sent if begin <= time <= end and frame.id & 0x7F in nodes]
    return [word for frame in frames if (word := controlword(frame)) is not None]


def way_from(seen: Run, time: float) -> float:
    """True distance from some time to the end of the run [m]."""
    return seen.world.pose.x - seen.truth_at(time).pose.x


def phase_is(phase: str) -> Callable[[Any], bool]:
    return lambda seen: bool(seen.phase == phase)


# ---------------------------------------------------------------------------------------------- a quick stop under way


@pytest.fixture(scope="module", params=[0.2, 0.6])
def alone(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[float, Run]:
    """A speed, and the run with a quick stop from it and nothing else."""
    speed: float = request.param
    rig = following_rig(tmp_path_factory.mktemp("alone"), speed, Pad())
    return speed, rig.while_following(rig.request(Request.QUICKSTOP), distance=1.5, name="stop").run()


@pytest.mark.parametrize("trouble", ["PLG-02", "SYS-01"])
def test_a_controlled_stop_after_a_quick_stop_does_not_weaken_it(
    tmp_path: Path, alone: tuple[float, Run], trouble: str
) -> None:
    speed, expected = alone
    pad = Pad()
    rig = following_rig(tmp_path, speed, pad)
    seen = rig.while_following(lambda: stop_with_trouble(rig, pad, trouble), distance=1.5, name="stop").run()
    at, undisturbed = seen.acts["stop"], expected.acts["stop"]
    assert (seen.status, seen.fault_ids) == (1, [trouble])
    assert seen.first(lambda s: s.tick.snapshot.verdict.stops).now - at < 0.09
    for name in TRACTION:
        first, *later = words(seen, at, math.inf, name)
        assert first == QUICK_STOP
        assert ENABLE not in later
    assert seen.truth_at(at).speed == pytest.approx(speed, rel=0.05)
    assert seen.stands_from() - at == pytest.approx(expected.stands_from() - undisturbed, abs=0.02)
    assert way_from(seen, at) == pytest.approx(way_from(expected, undisturbed), abs=0.005)


def stop_with_trouble(rig: Rig, pad: Pad, trouble: str) -> None:
    """A quick stop, and at the next tick a reason for a controlled one."""
    rig.robot.request(Request.QUICKSTOP)
    if trouble == "PLG-02":
        pad.failures = 1000
    else:
        clock: Any = rig.bus._loop
        clock._selector_with_time.now += 0.013 + TOO_LATE  # the next tick would be due in 13 ms


@pytest.mark.parametrize("stop_first", [True, False])
def test_a_stop_request_together_with_a_controlled_stop_is_a_quick_stop(tmp_path: Path, stop_first: bool) -> None:
    pad = Pad()
    rig = following_rig(tmp_path, 0.4, pad)

    def both() -> None:
        rig.robot._requests.append(Request.QUICKSTOP)  # without the tick at once
        pad.failures = 1000

    def input_first() -> None:
        pad.failures = 1000
        rig.robot.request(Request.QUICKSTOP)

    seen = rig.while_following(both if stop_first else input_first, name="stop").run()
    at = seen.acts["stop"]
    together = seen.first(lambda s: s.now >= at)
    assert Request.QUICKSTOP in together.tick.snapshot.sensed.requests
    assert seen.fault_ids == ["PLG-02"]
    assert together.tick.snapshot.verdict.stops
    for name in TRACTION:
        assert set(words(seen, together.now, math.inf, name)) == {QUICK_STOP, OFF}
    assert seen.stands_from() - at < 0.4 / 1.5 + 0.06


# ---------------------------------------------------------------------------------------------- in a controlled stop


@pytest.mark.parametrize("delay", [0.1, 3.0], ids=["on the ramp", "held at standstill"])
def test_a_stop_request_during_a_controlled_stop_is_a_quick_stop_and_switches_off(tmp_path: Path, delay: float) -> None:
    pad = Pad(go=7.5)
    pad.freeze = 10.0
    rig = teleop_rig(tmp_path, pad)
    rig.when(lambda s: s.mode is Mode.QUICKSTOP, rig.request(Request.QUICKSTOP), after=delay, name="stop")
    rig.when(lambda s: "stop" in rig._done, rig.request(Request.END), after=2.0, name="end")
    seen = rig.run()
    at = seen.acts["stop"]
    assert seen.fault_ids == ["INP-03"]
    assert seen.truth_at(at - 0.001).states == ENABLED
    assert standing(seen.truth_at(at)) is (delay > 1.0)
    first = [(time, frame.id, controlword(frame)) for time, frame in seen.bus.sent if time >= at][:2]
    assert first == [(at, STOP_FRAMES + NODE[name], QUICK_STOP) for name in TRACTION]
    assert ENABLE not in words(seen, at, math.inf, *TRACTION)
    assert seen.truth_at(seen.acts["end"] - 0.001).states == DISABLED


def test_an_acknowledgment_of_a_held_stop_leaves_the_drives_on_and_an_arm_goes_on(tmp_path: Path) -> None:
    pad = Pad()
    rig = following_rig(tmp_path, 0.4, pad, attended=True)
    rig.while_following(lambda: setattr(pad, "failures", 1), distance=1.0, name="failure")
    rig.when(lambda s: s.mode is Mode.QUICKSTOP, rig.request(Request.ACKNOWLEDGE), after=2.0, name="acknowledge")
    rig.when(lambda s: s.mode is Mode.QUICKSTOP, rig.request(Request.ARM), after=3.0, name="arm")
    seen = rig.run()
    held = [t for t in seen.truth_from(seen.acts["failure"]) if t.time < seen.in_mode(Mode.READY)[-1].now]
    assert {truth.states for truth in held} == {ENABLED}
    waiting = [t for t in held if seen.acts["acknowledge"] < t.time < seen.acts["arm"]]
    assert waiting
    assert all(standing(truth) for truth in waiting)
    assert (seen.status, seen.fault_ids) == (0, ["PLG-02"])
    assert driven(seen.in_mode(Mode.FOLLOW)[-1]) == pytest.approx(LENGTH, abs=0.03)


# ---------------------------------------------------------------------------------------------- during a re-arm


RE_ARM = 0.1
"""Time from an arm to the mode ready; a tick later the robot begins to move [s]."""
DELAYS = [0.0, *(0.003 + 0.01 * number for number in (*range(12), *range(14, 18)))]
"""From an arm to a stop request [s]: until the robot is to move, and while it begins to."""


@pytest.fixture(scope="module")
def hesitating(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """After a quick stop, every second an arm and soon after it a stop request."""
    rig = following_rig(tmp_path_factory.mktemp("hesitating"), attended=True)
    rig.while_following(rig.request(Request.QUICKSTOP))
    waits, tries = phase_is("stopped: arm to continue"), len(DELAYS)
    for number, delay in enumerate(DELAYS):
        rig.when(waits, rig.request(Request.ARM), after=1.0 + number, name=f"arm {number}")
        rig.when(waits, rig.request(Request.QUICKSTOP), after=1.0 + number + delay, name=f"stop {number}")
    return rig.when(waits, rig.request(Request.END), after=1.0 + tries, name=f"arm {tries}").run()


def windows(delays: Callable[[float], bool]) -> pytest.MarkDecorator:
    """The tries whose delays fulfil a condition."""
    numbers = [number for number, delay in enumerate(DELAYS) if delays(delay)]
    return pytest.mark.parametrize("number", numbers, ids=[f"after {DELAYS[n] * 1000:.0f} ms" for n in numbers])


@windows(lambda delay: delay < RE_ARM + 0.02)
def test_a_stop_request_during_a_re_arm_is_not_lost(hesitating: Run, number: int) -> None:
    at, next_arm = hesitating.acts[f"stop {number}"], hesitating.acts[f"arm {number + 1}"]
    later = [truth for truth in hesitating.truth_from(at) if truth.time < next_arm]
    assert all(standing(truth) for truth in later)
    assert {truth.states for truth in later if truth.time > at + 0.3} == {DISABLED}


@windows(lambda delay: delay >= RE_ARM + 0.02)
def test_a_stop_request_when_the_robot_just_begins_to_move_is_a_quick_stop(hesitating: Run, number: int) -> None:
    at, next_arm = hesitating.acts[f"stop {number}"], hesitating.acts[f"arm {number + 1}"]
    later = [truth for truth in hesitating.truth_from(at) if truth.time < next_arm]
    assert not standing(later[0])
    assert words(hesitating, at, next_arm - 0.001, *TRACTION)[:2] == [QUICK_STOP, QUICK_STOP]
    assert all(standing(truth) for truth in later if truth.time > at + 0.15)
    assert {truth.states for truth in later if truth.time > at + 0.3} == {DISABLED}
    assert hesitating.fault_ids == []


def test_a_re_arm_is_over_in_the_time_in_which_stop_requests_were_tried(tmp_path: Path) -> None:
    """Else the tests above would not try what they say."""
    rig = following_rig(tmp_path, attended=True)
    rig.while_following(rig.request(Request.QUICKSTOP))
    rig.when(phase_is("stopped: arm to continue"), rig.request(Request.ARM), after=1.0, name="arm")
    seen = rig.run()
    ready = seen.first(lambda s: s.now > seen.acts["arm"] and s.mode is Mode.READY)
    assert ready.now - seen.acts["arm"] == pytest.approx(RE_ARM, abs=0.021)
    assert seen.status == 0


# ---------------------------------------------------------------------------------------------- the end is not lost


@pytest.mark.parametrize("attended", [True, False])
@pytest.mark.parametrize("other", ["fault", "quick stop"])
def test_an_end_request_is_not_lost_in_the_tick_of_a_fault_or_quick_stop(
    tmp_path: Path, other: str, attended: bool
) -> None:
    rig = following_rig(tmp_path, attended=attended)

    def both() -> None:
        rig.robot.request(Request.END)
        act = rig.emergency("traction-left", 0x8611) if other == "fault" else rig.request(Request.QUICKSTOP)
        act()

    seen = rig.while_following(both, name="end").run()
    together = seen.first(lambda s: s.now >= seen.acts["end"])
    assert together.mode is (Mode.FAULT if other == "fault" else Mode.QUICKSTOP)
    assert Request.END in together.tick.snapshot.sensed.requests
    assert_ended_soon(seen)


def test_repeated_end_requests_end_the_run(tmp_path: Path) -> None:
    rig = following_rig(tmp_path, attended=True)
    for number in range(3):
        rig.while_following(rig.request(Request.END), distance=0.4 + 0.01 * number, name="end")
    assert_ended_soon(rig.run())


@pytest.mark.parametrize("also_a_fault", [False, True])
def test_a_second_signal_ends_the_run_too(tmp_path: Path, also_a_fault: bool) -> None:
    rig = following_rig(tmp_path, attended=True)

    def interrupt() -> None:
        signal.raise_signal(signal.SIGINT)

    def both() -> None:
        interrupt()
        if also_a_fault:
            rig.emergency("traction-left", 0x8611)()

    rig.while_following(both, name="end")
    rig.when(lambda s: "end" in rig._done, interrupt, after=0.05)
    seen = rig.run()
    assert_ended_soon(seen)
    assert seen.status == 128 + signal.SIGINT


def assert_ended_soon(seen: Run) -> None:
    assert seen.modes[-1] is Mode.END
    assert seen.seen[-1].now - seen.acts["end"] < 2.0
    assert standing(seen.world.truth)
    assert seen.world.truth.states == DISABLED
    assert seen.status != 0


# ---------------------------------------------------------------------------------------------- one refuses, one is off


class RefusingBus:
    """A bus that takes no frame for one node."""

    def __init__(self, node: int) -> None:
        self.node = node
        self.sent: list[Frame] = []
        self.error_frames = 0

    def send(self, frame: Frame) -> None:
        if frame.id & 0x7F == self.node:
            raise DeviceLost("CAN", "queue full")
        self.sent.append(frame)

    def receive(self) -> list[Frame]:
        return []

    def listen(self, wake: Callable[[], None]) -> None: ...

    def close(self) -> None: ...


@pytest.mark.parametrize("node", NODE.values())
def test_a_node_that_cannot_be_reached_does_not_keep_the_others_from_being_stopped(tmp_path: Path, node: int) -> None:
    bus = RefusingBus(node)
    Drives(load_mission(write_mission(tmp_path, [CALIBRATE])).robot, bus).stop()
    assert bus.sent == [Frame(STOP_FRAMES + other, b"\x0b\x00") for other in NODE.values() if other != node]


@pytest.mark.parametrize(("faulty", "healthy"), [STEERING, STEERING[::-1]])
def test_a_steered_wheel_holds_its_set_point_while_the_other_is_off(tmp_path: Path, faulty: str, healthy: str) -> None:
    bend = "x,y\n" + "".join(f"{0.05 * i:.2f},{0.15 * (0.05 * i) ** 2:.4f}\n" for i in range(60))
    rig = Rig(write_mission(tmp_path, [CALIBRATE, follow(0.4)], {"line.csv": bend}))
    seen = rig.while_following(rig.emergency(faulty, 0x2310), distance=0.8, name="emergency").run()
    stopping = [s for s in seen.in_mode(Mode.FAULT) if not s.standing]
    assert len(stopping) > 10
    place = STEERING.index(healthy)
    points = {(s.tick.set_points.steering_left, s.tick.set_points.steering_right)[place] for s in stopping}
    measured = {next(d for d in s.tick.snapshot.sensed.drives if d.name == healthy).position for s in stopping}
    assert len(points) == 1
    assert len(measured) > 1  # it was turning: a set-point that follows the measurement would differ from tick to tick


# ---------------------------------------------------------------------------------------------- harmless frames


def test_a_frame_that_is_no_emergency_of_ours_makes_no_extra_tick(tmp_path: Path) -> None:
    rig = following_rig(tmp_path)
    harmless = [
        Frame(0x089, b"\x10\x10\x01\0\0\0\0\0"),  # an emergency of a node that is not a frame of artemis
        Frame(0x081, bytes(8)),  # traction-left: no error any more
    ]
    for number, frame in enumerate(harmless):
        rig.while_following(lambda frame=frame: arrive(rig, frame), distance=0.4 + 0.1 * number, name=f"{number}")  # type: ignore[misc]
    seen = rig.run()
    assert len(seen.acts) == 2
    assert (seen.status, seen.fault_ids) == (0, [])
    begin, end = seen.acts["0"] - 0.1, seen.acts["1"] + 0.1
    assert not any(s.tick.snapshot.sensed.urgent for s in seen.seen if begin < s.now < end)


def test_an_emergency_of_ours_makes_an_extra_tick(tmp_path: Path) -> None:
    """Else the test above would prove nothing."""
    rig = following_rig(tmp_path)
    frame = Frame(0x081, b"\x10\x10\x01\0\0\0\0\0")
    seen = rig.while_following(lambda: arrive(rig, frame), name="emergency").run()
    assert seen.first(lambda s: s.now >= seen.acts["emergency"]).tick.snapshot.sensed.urgent


def arrive(rig: Rig, frame: Frame) -> None:
    """The host's adapter hears a frame now."""
    rig.bus._inbox.append(replace(frame, time=rig.bus._loop.time()))
    assert rig.bus._wake is not None
    rig.bus._wake()


def test_a_robot_that_creeps_on_because_its_last_set_points_are_lost_is_stopped(tmp_path: Path) -> None:
    hand = {"stick": {"plugin": "scripted", "file": "stick.csv", "max_speed_m_s": 0.4, "done_at_end": False}}
    simulation = {"faults": [{"at_s": 8.37, "inject": "COM-12"}], "operator": [{"at_s": 14, "do": "end"}]}
    rows = stick((0, 0, 0, 0), (6, 0, 1, 1), (8, 0, 0, 0), (40, 0, 0, 0))
    steps = [{"teleop": {"input": "stick", "until": {"seconds": 30}}}]

    seen = run(write_mission(tmp_path, steps, {"stick.csv": rows}, inputs=hand, simulation=simulation))

    assert seen.fault_ids == ["RUN-02"]
    rolled = [each.pose.x for each in seen.seen if each.time > 8.4]
    assert 0.05 < rolled[-1] - rolled[0] < 0.15
