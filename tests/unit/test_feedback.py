"""What an operator feels in the device in his hand: rumble at a stop, a wheel's force; and what may go wrong."""

from __future__ import annotations

import dataclasses
import struct
import threading
from pathlib import Path

import pytest
from core_builders import snapshot
from evdev_devices import FakeEvdev
from msgspec.structs import replace
from pad import MISSIONS, ROBOT

from artemis.devices.evdev import effects
from artemis.devices.evdev.effects import BEAT, BEATS, FORCE, Motors, find_motors
from artemis.devices.evdev.nodes import AUTOCENTER, CONSTANT, PERIODIC, RUMBLE, SPRING, EventNode
from artemis.devices.hid.port import HidInfo
from artemis.errors import DeviceLost
from artemis.plugins.contracts import PluginContext, ShowsState
from artemis.plugins.inputs.feedback import Feedback
from artemis.plugins.inputs.gamepad import GamepadInput
from artemis.plugins.inputs.gamepad_config import GamepadConfig
from artemis.values import Mode, Odometry, SetPoints, Tick, Wish

PAD = HidInfo("/dev/hidraw0", "usb", 1, 2, "", "Pad", 0)
HEAD = struct.Struct("@HhHHHHH0P")


class FakeMotors:
    """A `MotorNode`: effects that were uploaded, by id, and events that were written."""

    def __init__(self) -> None:
        self.effects: dict[int, bytes] = {}
        self.written: list[tuple[int, int]] = []
        self.lamps: list[tuple[int, int]] = []
        self.error: OSError | None = None
        self.closed = False

    def upload(self, effect: bytes) -> int:
        self._check()
        id = HEAD.unpack_from(effect)[1]
        id = len(self.effects) if id == -1 else id
        self.effects[id] = effect
        return id

    def write(self, kind: int, code: int, value: int) -> None:
        self._check()
        (self.written if kind == FORCE else self.lamps).append((code, value))

    def close(self) -> None:
        self.closed = True

    def _check(self) -> None:
        if self.error is not None:
            raise self.error

    def kind(self, id: int) -> int:
        return int(HEAD.unpack_from(self.effects[id])[0])

    def body(self, id: int, layout: str) -> tuple[int, ...]:
        return struct.unpack_from(layout, self.effects[id], HEAD.size)


class Hand:
    """A device with such motors, and the robot's ticks."""

    def __init__(self, *forces: int, rumble: bool = True, force: float = 0.0, lamps: tuple[int, ...] = ()) -> None:
        self.node, self.lookups = FakeMotors(), 0
        self.forces, self.lamps = frozenset(forces), frozenset(lamps)
        self.feedback = Feedback(rumble, force, 0.7, self._find, threaded=False)
        self.feedback.take([PAD])

    def _find(self, info: HidInfo) -> Motors | None:
        self.lookups += 1
        return Motors(self.node, self.forces, self.lamps) if self.forces or self.lamps else None

    def show(self, mode: Mode, speed: float = 0.0) -> str:
        seen = replace(snapshot(), odometry=Odometry(speed=speed))
        return self.feedback.show(Tick(snapshot=seen, mode=mode, wish=Wish(), set_points=SetPoints()))


# ---------------------------------------------------------------------------------------------- rumble


@pytest.mark.parametrize("mode", [Mode.QUICKSTOP, Mode.FAULT])
def test_a_pad_rumbles_once_when_the_robot_stops(mode: Mode) -> None:
    hand = Hand(RUMBLE)
    hand.show(Mode.TELEOP, 0.5)
    assert hand.node.written == []
    for _ in range(3):
        assert hand.show(mode) == ""
    assert hand.node.written == [(0, 1)]
    _, _, _, _, _, length, delay = HEAD.unpack_from(hand.node.effects[0])
    assert (hand.node.kind(0), length, delay, hand.node.body(0, "@HH")) == (RUMBLE, 300, 0, (0x8000, 0x8000))
    hand.show(Mode.TELEOP)
    hand.show(mode)
    assert hand.node.written == [(0, 1), (0, 1)]
    assert len(hand.node.effects) == 1  # uploaded in its own place


def test_a_fault_after_a_quick_stop_is_felt_as_well() -> None:
    hand = Hand(RUMBLE)
    hand.show(Mode.QUICKSTOP)
    hand.show(Mode.FAULT)
    assert len(hand.node.written) == 2


def test_lamps_are_on_while_the_robot_is_stopped() -> None:
    hand = Hand(lamps=(8, 0))
    hand.show(Mode.TELEOP, 0.5)
    assert hand.node.lamps == []
    for mode in (Mode.QUICKSTOP, Mode.QUICKSTOP):
        assert hand.show(mode) == ""
    assert hand.node.lamps == [(0, 1), (8, 1)]
    hand.show(Mode.READY)
    assert hand.node.lamps[2:] == [(0, 0), (8, 0)]
    hand.show(Mode.FAULT)
    hand.feedback.close()
    assert hand.node.lamps[4:] == [(0, 1), (8, 1), (0, 0), (8, 0)]
    assert hand.node.written == []


def test_lamps_of_a_device_that_joins_a_stopped_robot_are_on() -> None:
    hand = Hand(RUMBLE, lamps=(8,))
    hand.show(Mode.FAULT)
    hand.feedback.take([PAD])
    assert hand.node.lamps == [(8, 1), (8, 0), (8, 1)]
    assert len(hand.node.written) == 1, "it rumbles at the stop alone"


def test_lamps_stay_as_they_are_where_rumble_is_left_out() -> None:
    hand = Hand(lamps=(8,), rumble=False, force=0.3)
    for mode in (Mode.FAULT, Mode.READY):
        hand.show(mode)
    hand.feedback.close()
    assert hand.node.lamps == []


def test_rumble_can_be_left_out() -> None:
    hand = Hand(RUMBLE, rumble=False)
    hand.show(Mode.FAULT)
    assert (hand.lookups, hand.node.effects) == (0, {})


def test_an_effect_is_as_long_as_the_kernels_structure() -> None:
    """On every machine: 16 bytes and the longest of the union, at a pointer's alignment (linux/input.h)."""
    hand = Hand(RUMBLE)
    hand.show(Mode.FAULT)
    assert len(hand.node.effects[0]) == {8: 48, 4: 44}[struct.calcsize("P")]


# ---------------------------------------------------------------------------------------------- a wheel's force


def test_a_wheel_centres_itself_the_faster_the_stronger() -> None:
    hand = Hand(SPRING, AUTOCENTER, CONSTANT, force=0.4)
    hand.show(Mode.TELEOP, 0.0)
    assert hand.node.effects == {}
    strengths = []
    for speed in (0.14, -0.35, 0.7, 1.4, 0.0):
        hand.show(Mode.TELEOP, speed)
        most_right, most_left, slope_right, slope_left, deadband, middle = hand.node.body(0, "@HHhhHh")
        assert (most_right, slope_right, deadband, middle) == (most_left, slope_left, 0, 0)
        strengths.append((round(most_right / 0xFFFF, 3), round(slope_right / 0x7FFF, 3)))
    assert strengths == [(0.08, 0.08), (0.2, 0.2), (0.4, 0.4), (0.4, 0.4), (0.0, 0.0)]
    assert hand.node.kind(0) == SPRING
    assert len(hand.node.effects) == 1


def test_a_force_that_would_be_felt_alike_is_not_asked_for_again() -> None:
    hand = Hand(AUTOCENTER, force=0.5)
    for millimetres in range(700):
        hand.show(Mode.TELEOP, millimetres / 1000)
    assert len(hand.node.written) == 20


def test_a_wheel_without_a_spring_has_its_own_centring_set_and_switched_off_at_the_end() -> None:
    hand = Hand(AUTOCENTER, CONSTANT, force=0.5)
    hand.show(Mode.TELEOP, 0.7)
    assert hand.node.written == [(AUTOCENTER, 0x8000)]
    hand.feedback.close()
    hand.feedback.close()
    assert hand.node.written[1:] == [(AUTOCENTER, 0)]
    assert hand.node.closed
    assert hand.show(Mode.FAULT) == ""


def test_a_wheel_is_shaken_to_alternate_sides_when_the_robot_stops() -> None:
    hand = Hand(CONSTANT, AUTOCENTER, force=0.3)
    hand.show(Mode.FAULT)
    heads = [HEAD.unpack_from(hand.node.effects[id]) for id in range(BEATS)]
    assert [(head[2], head[5], head[6]) for head in heads] == [
        (0x4000, BEAT, 0),
        (0xC000, BEAT, BEAT),
        (0x4000, BEAT, 2 * BEAT),
        (0xC000, BEAT, 3 * BEAT),
    ]
    assert {hand.node.body(id, "@h")[0] for id in range(BEATS)} == {round(0.3 * 0x7FFF)}
    assert hand.node.written == [(id, 1) for id in range(BEATS)]


def test_a_wheel_that_knows_waves_is_shaken_by_one() -> None:
    hand = Hand(CONSTANT, PERIODIC, SPRING, force=0.5)
    hand.show(Mode.FAULT)
    waveform, period, magnitude, offset, phase = hand.node.body(0, "@HHhhH")
    assert (hand.node.kind(0), waveform, period, magnitude, offset, phase) == (PERIODIC, 0x5A, 2 * BEAT, 0x4000, 0, 0)


def test_no_motor_turns_a_wheel_unless_the_mission_says_so() -> None:
    hand = Hand(CONSTANT, PERIODIC, SPRING, AUTOCENTER)
    hand.show(Mode.TELEOP, 0.7)
    hand.show(Mode.FAULT)
    hand.feedback.close()
    assert (hand.node.effects, hand.node.written) == ({}, [])


@pytest.mark.parametrize("force", [-0.1, 0.51, "much"])
def test_the_force_is_bounded(force: object) -> None:
    with pytest.raises(ValueError, match="wheel_force"):
        GamepadConfig.model_validate({"wheel_force": force})


# ---------------------------------------------------------------------------------------------- what goes wrong


def test_a_device_that_refuses_is_a_warning_once_and_left_alone() -> None:
    hand = Hand(RUMBLE)
    hand.node.error = OSError(22, "Invalid argument")
    assert hand.show(Mode.FAULT) == "the device does not take an effect (Invalid argument)"
    assert hand.node.closed
    hand.node.error = None
    assert [hand.show(mode) for mode in (Mode.TELEOP, Mode.FAULT)] == ["", ""]
    assert hand.node.written == []


def test_a_device_that_is_gone_is_no_warning_of_its_own() -> None:
    hand = Hand(RUMBLE)
    hand.node.error = OSError(19, "No such device")
    assert [hand.show(Mode.FAULT) for _ in range(2)] == ["", ""]
    hand.node, fresh = FakeMotors(), hand.node
    hand.feedback.take([PAD])
    hand.show(Mode.TELEOP)
    hand.show(Mode.FAULT)
    assert hand.node.written == [(0, 1)]
    assert fresh.closed


def test_a_force_that_no_motor_has_is_told_and_rumble_is_for_whoever_has_it() -> None:
    for hand in (Hand(RUMBLE, force=0.3), Hand(force=0.3)):
        words = [hand.show(Mode.TELEOP, speed) for speed in (0.0, 0.3, 0.6)]
        assert words == ["", f"{PAD}: no force that could centre it", ""]
    assert Hand().show(Mode.FAULT) == ""


def test_motors_that_may_not_be_opened_are_told_where_a_force_was_asked_for() -> None:
    def refused(info: HidInfo) -> Motors | None:
        raise DeviceLost("Wheel", "no permission")

    for force, words in ((0.2, "Wheel: no permission"), (0.0, "")):
        feedback = Feedback(True, force, 0.7, refused, threaded=False)
        feedback.take([PAD])
        tick = Tick(snapshot=snapshot(), mode=Mode.FAULT, wish=Wish(), set_points=SetPoints())
        assert [feedback.show(tick) for _ in range(2)] == [words, ""]


def test_a_device_that_takes_for_ever_delays_no_tick() -> None:
    begun, released = threading.Event(), threading.Event()

    class Slow(FakeMotors):
        def upload(self, effect: bytes) -> int:
            begun.set()
            released.wait(60.0)
            return super().upload(effect)

    node = Slow()
    feedback = Feedback(True, 0.0, 0.7, lambda info: Motors(node, frozenset({RUMBLE})))
    feedback.take([PAD])
    for mode in (Mode.TELEOP, Mode.FAULT):
        feedback.show(Tick(snapshot=snapshot(), mode=mode, wish=Wish(), set_points=SetPoints()))
    assert begun.wait(20.0)
    for mode in (Mode.TELEOP, Mode.FAULT) * 100:  # all of them while the device still takes its time
        feedback.show(Tick(snapshot=snapshot(), mode=mode, wish=Wish(), set_points=SetPoints()))
    assert node.written == []
    released.set()
    feedback.close()
    assert node.written
    assert node.closed


# ---------------------------------------------------------------------------------------------- the real edge


def test_motors_are_opened_where_their_node_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    info = dataclasses.replace(PAD, path=str(tmp_path / "event"))
    none = frozenset[int]()
    node = EventNode(
        info=info, keys=none, axes=none, forces=frozenset({RUMBLE}), lamps=none, hidraw=frozenset({"hidraw0"})
    )
    monkeypatch.setattr(effects, "motors_of", lambda info: node if info == PAD else None)
    assert find_motors(info) is None
    with pytest.raises(DeviceLost, match="is not there"):
        find_motors(PAD)
    (tmp_path / "event").touch()
    motors = find_motors(PAD)
    assert motors is not None
    with pytest.raises(OSError, match="Inappropriate ioctl"):
        motors.rumble()  # a file is no device
    motors.close()


def test_a_gamepad_shows_state() -> None:
    context = PluginContext(name="pad", robot=ROBOT, folder=MISSIONS)
    plugin = GamepadInput(GamepadConfig(), context, FakeEvdev(Path("nowhere")).port)
    assert isinstance(plugin, ShowsState)
    assert plugin.show(Tick(snapshot=snapshot(), mode=Mode.FAULT, wish=Wish(), set_points=SetPoints())) == ""
    plugin.close()
