"""A robot driven with a joystick of the HID class: the device is in memory, the rest is a whole run on virtual time."""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from typing import Any

import pytest
from rig import BRAKING, CALIBRATE, MISSIONS, STICK, TELEOP, TICK, Rig, Run, standing, stick, write_mission

from artemis.devices.hid.port import HidInfo
from artemis.mission.loading import load_mission
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.gamepad import GamepadInput
from artemis.plugins.inputs.gamepad_config import GamepadConfig
from artemis.plugins.inputs.held import GONE
from artemis.testing.fake_hid import FakeHid
from artemis.values import Mode, Request
from artemis.yaml_file import load

pytestmark = pytest.mark.short_alignment

FILE = Path(__file__).parents[1] / "data" / "hid" / "logitech_extreme_3d_pro.yaml"
INFO = HidInfo("/dev/hidraw0", "usb", 0x046D, 0xC215, "", "Stick", 0)
DRIVE = 6.4
"""By then the robot is aligned and ready."""
REST, ENABLE, STOP, DONE = 0, 1 << 0, 1 << 1, 1 << 10
"""Buttons 1, 2 and 11: trigger, thumb, base."""


def report(x: float = 0.0, y: float = 0.0, buttons: int = 0) -> bytes:
    """Seven bytes: x and y (10 bits, y to the operator), hat, twist, buttons 1 to 8, slider, buttons 9 to 12."""
    raw_x, raw_y = (round(508 + distance * (515 if distance > 0 else 508)) for distance in (x, -y))
    head = raw_x | raw_y << 10 | 8 << 20
    return head.to_bytes(3, "little") + bytes((128, buttons & 0xFF, 0, buttons >> 8))


class Desk:
    """A joystick on a desk, the plugin that reads it, and the run."""

    def __init__(self, folder: Path, **keys: Any) -> None:  # noqa: ANN401 (of a mission)
        device: Any = load(FILE).data
        self.raw = bytes.fromhex(device["report_descriptor"])
        self.hid = FakeHid()
        self.hid.plug(INFO, self.raw)
        mission = write_mission(folder, [CALIBRATE, TELEOP], {"stick.csv": stick((0, 0, 0, 0))}, inputs=STICK, **keys)
        context = PluginContext(name="stick", robot=load_mission(mission).robot, folder=folder, wake=self._wake)
        plugin = GamepadInput(GamepadConfig(profile="logitech-extreme-3d-pro"), context, self.hid)
        self.rig = Rig(mission, input=plugin)
        self.at(1.0)

    def _wake(self) -> None:
        self.rig.bus.loop.call_soon_threadsafe(self.rig.robot.tick_now)

    def at(self, time: float, x: float = 0.0, y: float = 0.0, buttons: int = REST, name: str = "act") -> None:
        """The joystick reports once, at a run time [s]."""
        self.rig.at(time, lambda: self.hid.send(report(x, y, buttons)), name=name)


def drives(seen: Run, begin: float, end: float) -> bool:
    truths = [truth for truth in seen.world.history if begin <= truth.time <= end]
    assert truths
    return not all(standing(truth) for truth in truths)


def test_a_joystick_drives_a_curve_to_the_left_and_ends_the_step(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    desk.at(DRIVE, buttons=ENABLE)
    for index in range(20):  # a hand that holds a stick moves a little
        desk.at(DRIVE + 0.5 + index * 0.2, x=-0.4 - 0.01 * (index % 2), y=0.8, buttons=ENABLE)
    desk.at(DRIVE + 5.0, buttons=ENABLE)
    desk.at(DRIVE + 6.5)
    desk.at(DRIVE + 7.0, buttons=DONE)
    seen = desk.rig.run()
    assert (seen.status, seen.fault_ids) == (0, [])
    pose, start = seen.world.pose, seen.first(lambda s: s.tick.wish.reset_pose).pose
    assert math.hypot(pose.x - start.x, pose.y - start.y) > 0.5
    assert pose.heading - start.heading > 0.5
    assert not drives(seen, DRIVE - 0.5, DRIVE + 0.5)


def test_stop_button_stops_between_two_ticks(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    desk.at(DRIVE, buttons=ENABLE)
    desk.at(DRIVE + 0.5, y=1.0, buttons=ENABLE)
    pressed = DRIVE + 3.007
    desk.rig.at(pressed, lambda: desk.hid.send(report(y=1.0, buttons=ENABLE | STOP)), name="press")
    (reader,) = desk.rig._input._readers.values()  # type: ignore[union-attr]  # its thread's part, done at once
    desk.rig.at(pressed + 0.001, lambda: reader._poll(desk.rig.bus.loop.time()), name="thread")
    seen = desk.rig.run()
    stopped = seen.first(lambda s: Request.QUICKSTOP in s.tick.snapshot.sensed.requests)
    assert stopped.tick.snapshot.sensed.urgent
    assert stopped.now == pytest.approx(seen.acts["thread"], abs=1e-9)
    assert stopped.mode is Mode.QUICKSTOP
    speed = max(abs(truth.speed) for truth in seen.world.history)
    assert seen.stands_from() < seen.acts["press"] + speed / BRAKING + 0.2
    assert seen.status == 1  # nobody was there to arm again


def test_released_trigger_stops_and_a_new_press_goes_on(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    desk.at(DRIVE, buttons=ENABLE)
    desk.at(DRIVE + 0.5, y=0.6, buttons=ENABLE)
    desk.at(DRIVE + 2.0, y=0.6)
    desk.at(DRIVE + 4.0, y=0.6, buttons=ENABLE)
    desk.at(DRIVE + 5.0, buttons=DONE)
    seen = desk.rig.run()
    assert (seen.status, seen.fault_ids) == (0, [])
    assert drives(seen, DRIVE + 1.0, DRIVE + 2.0)
    assert not drives(seen, DRIVE + 3.0, DRIVE + 3.9)
    assert drives(seen, DRIVE + 4.3, DRIVE + 5.0)


def test_unplugged_joystick_stops_and_its_return_does_not_drive(tmp_path: Path) -> None:
    desk = Desk(tmp_path, recovery={"INP-01": {"resume": "continue"}})  # as soon as it can
    held = report(y=1.0, buttons=ENABLE)
    desk.at(DRIVE, buttons=ENABLE)
    desk.at(DRIVE + 0.5, y=1.0, buttons=ENABLE)
    unplugged = DRIVE + 3.0
    desk.rig.at(unplugged, desk.hid.unplug, name="unplug")
    desk.rig.at(unplugged + 0.5, lambda: desk.hid.plug(INFO, desk.raw))
    for index in range(100):
        desk.rig.at(unplugged + 1.8 + index * 0.1, lambda: desk.hid.send(held))  # still held as it was
    desk.at(unplugged + 13.0)
    desk.at(unplugged + 14.5, buttons=ENABLE)
    desk.at(unplugged + 15.0, y=0.5, buttons=ENABLE)
    desk.at(unplugged + 17.0, buttons=DONE)
    seen = desk.rig.run()
    assert (seen.status, seen.fault_ids) == (0, ["INP-01"])
    stop = seen.first(lambda s: s.now > seen.acts["unplug"] and s.mode is Mode.QUICKSTOP)
    assert stop.now - seen.acts["unplug"] <= 0.05
    assert not drives(seen, unplugged + 2.0, unplugged + 15.0)
    assert drives(seen, unplugged + 15.5, unplugged + 17.0)


def test_held_joystick_that_says_nothing_more_stops(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    desk.at(DRIVE, buttons=ENABLE)
    desk.at(DRIVE + 0.5, y=1.0, buttons=ENABLE)
    desk.at(DRIVE + 8.0)
    desk.at(DRIVE + 9.0, buttons=DONE)
    seen = desk.rig.run()
    assert (seen.status, seen.fault_ids) == (0, [])
    assert drives(seen, DRIVE + 4.0, DRIVE + 4.5)
    assert not drives(seen, DRIVE + 0.5 + GONE + 1.0 + 2 * TICK, DRIVE + 8.0)


def test_the_wheel_of_the_shipped_mission_drives_both_ways(tmp_path: Path) -> None:
    folder = tmp_path / "missions"
    shutil.copytree(MISSIONS, folder, ignore=shutil.ignore_patterns("runs"))
    seen = Rig(folder / "teleop_wheel.yaml").run()
    assert (seen.status, seen.fault_ids) == (0, [])
    speeds = [truth.speed for truth in seen.world.history]
    assert max(speeds) > 0.3
    assert min(speeds) < -0.1
    turned = [sum(truth.wheel_angles) for truth in seen.world.history if abs(truth.speed) > 0.1]
    assert max(turned) > 0.4
    assert min(turned) < -0.2
