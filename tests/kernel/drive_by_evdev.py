"""Drives missions by event devices of the Linux kernel; see scripts/kernel_evdev."""

from __future__ import annotations

import argparse
import os
import queue
import struct
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import Protocol

from drive_by_hid import PATIENCE, Impossible, Told, Wrong, judge, prepared, started, tried
from uinput import UinputDevice
from xbox_pad import XboxPad

from artemis.devices.evdev.layout import capabilities, evdev_layout
from artemis.devices.evdev.nodes import AUTOCENTER, CONSTANT, RUMBLE, SPRING, EventNode, event_nodes
from artemis.devices.evdev.port import Evdev
from artemis.devices.hid.descriptor import Field
from artemis.plugins.inputs.profiles import SHIPPED, Profile, profile_from

ROOT = Path(__file__).parents[2]
PAD_AXES = {**{code: (-32768, 32767) for code in (0, 1, 3, 4)}, 2: (0, 255), 5: (0, 255), 16: (-1, 1), 17: (-1, 1)}
PAD_KEYS = (0x130, 0x131, 0x133, 0x134, 0x136, 0x137, 0x13A, 0x13B, 0x13C, 0x13D, 0x13E)
WHEEL_AXES, WHEEL_KEYS = {0: (0, 65535), 9: (0, 255), 10: (0, 255)}, tuple(range(0x120, 0x130))
WHEEL_VENDOR, WHEEL_PRODUCT = 0x1209, 0x0001
FORCE = 0.4
WHEEL = """
name: kernel-wheel
device: {{bus: usb, vendor: 0x1209, product: 0x0001, capabilities: "{digest}"}}
kind: wheel
reports: on_change
axes:
  steering: {{field: x, minimum: 0, centre: 32768, maximum: 65535}}
  gas: {{field: gas, minimum: 0, maximum: 255}}
  brake: {{field: brake, minimum: 0, maximum: 255}}
buttons: {{enable: button.trigger, quickstop: button.thumb, arm: button.thumb2, done: button.top}}
"""
MISSION = """
mission: kernel-evdev
robot: robots/artemis.yaml
bus: simulation
inputs:
  hand: {{plugin: gamepad, {profile}, max_speed_m_s: 0.3, wheel_force: {force}}}
steps:
  - calibrate: {{steering: from_potentiometers}}
  - teleop: {{input: hand, until: {{button: done}}}}
"""
MISC = 8
"""A lamp (LED_MISC)."""
FLOOD = 400
"""Changes that nobody reads: more than the kernel keeps for a reader."""


class Device(Protocol):
    """Plugged in from its making on."""

    effects: list[bytes]
    played: list[tuple[int, int]]
    lit: list[tuple[int, int]]

    def send(self, changes: Mapping[int, int]) -> None: ...

    def close(self) -> None: ...


def uinput(held: Held) -> Device:
    """One that has no driver."""
    key = held.profile.parts[""]
    return UinputDevice(held.profile.name, key.vendor, key.product, held.axes, held.keys, held.forces, held.lamps)


def usb(held: Held) -> Device:
    """One on a USB controller without wires, for the driver xpad."""
    try:
        return XboxPad()
    except (OSError, subprocess.CalledProcessError, ValueError) as error:
        raise Impossible(f"no USB gadget can be made here: {error}") from None


@dataclass
class Held:
    """A device, and what a hand does with it."""

    profile: Profile
    axes: Mapping[int, tuple[int, int]]
    keys: tuple[int, ...]
    forces: tuple[int, ...]
    make: Callable[[Held], Device] = uinput
    plugged: Device | None = None
    lamps: tuple[int, ...] = ()

    def plug(self) -> Device:
        self.plugged = self.make(self)
        deadline = time.monotonic() + 10.0
        while not any(os.path.exists(node.info.path) for node in self._nodes()):
            if time.monotonic() > deadline:
                self.unplug()
                raise Impossible("the kernel made no event node of it")
            time.sleep(0.1)
        return self.plugged

    def unplug(self) -> None:
        """Harmless when repeated."""
        device, self.plugged = self.plugged, None
        if device is not None:
            device.close()

    def _nodes(self) -> list[EventNode]:
        key = self.profile.parts[""]
        return [node for node in event_nodes() if (node.info.vendor, node.info.product) == (key.vendor, key.product)]

    def state(self, *roles: str, forward: float = 0.0) -> dict[int, int]:
        """Codes of the buttons, those of these roles down, and of the axes; pushed forward from 0 to 1."""
        usages = {field.name: field.usage & 0xFFFF for field in self._fields()}
        changes = {usages[name]: int(role in roles) for role, name in self.profile.buttons.items()}
        for role, axis in self.profile.axes.items():
            start = axis.minimum if axis.centre is None else axis.centre
            end = axis.minimum if axis.inverted else axis.maximum
            changes[usages[axis.field]] = round(start + forward * (end - start)) if role in ("y", "gas") else start
        return changes

    def moved(self) -> dict[int, int]:
        """At rest, but for a little to the right: a device at rest says nothing."""
        axis = self.profile.axes["x" if self.profile.kind == "stick" else "steering"]
        assert axis.centre is not None
        return {**self.state(), 0: axis.centre + (axis.maximum - axis.centre) // 50}

    def _fields(self) -> tuple[Field, ...]:
        return evdev_layout(capabilities(self.axes, self.keys)).fields


def pad(make: Callable[[Held], Device] = uinput) -> Held:
    profile = profile_from((SHIPPED / "xbox-360-usb.yaml").read_bytes(), "xbox-360-usb.yaml")
    return Held(profile, PAD_AXES, PAD_KEYS, (RUMBLE,), make, lamps=(MISC,) if make is uinput else ())


def wheel() -> Held:
    text = WHEEL.format(digest=sha256(capabilities(WHEEL_AXES, WHEEL_KEYS)).hexdigest()[:16])
    return Held(profile_from(text.encode(), "wheel.yaml"), WHEEL_AXES, WHEEL_KEYS, (SPRING, CONSTANT, AUTOCENTER))


def drive(held: Held, slow: float, environment: Mapping[str, str]) -> str:
    """Drive, unplug on the way, plug in again, stop, end. What was seen, for people.

    Raises:
        Wrong: the robot, or the device, did what it must not, or did not what it must.
    """
    is_wheel = held.profile.kind == "wheel"
    with tempfile.TemporaryDirectory() as folder:
        mission, robots = Path(folder) / "mission.yaml", Path(folder) / "robots"
        robots.mkdir()
        (robots / "artemis.yaml").write_bytes((ROOT / "missions/robots/artemis.yaml").read_bytes())
        digest = held.profile.parts[""].digest
        (Path(folder) / "wheel.yaml").write_text(WHEEL.format(digest=digest))
        profile = "profile_file: wheel.yaml" if is_wheel else "profile: auto"
        mission.write_text(MISSION.format(profile=profile, force=FORCE if is_wheel else 0.0))
        device = held.plug()
        with started("run", str(mission), environment=environment) as (run, told):
            try:
                felt = act(held, device, told, slow)
            except (Wrong, queue.Empty) as error:
                lines = [str(error) or "nothing more comes", *told.lines, *told.come()]
                raise Wrong("\n    ".join(lines)) from None
            finally:
                held.unplug()
            if run.wait(PATIENCE) != 0:
                raise Wrong("\n    ".join([f"exit status {run.returncode}", *told.lines, *told.come()]))
        (folder_of_run,) = (Path(folder) / "runs").iterdir()
        return f"{judge(folder_of_run)}; {felt}"


def act(held: Held, device: Device, told: Told, slow: float) -> str:
    """What a person does, and feels: drive, lose the device, plug it in pushed, release, arm, drive, stop, arm, end."""

    def drive() -> None:
        device.send(held.state("enable"))
        device.send(held.state("enable", forward=1.0))
        told.wait_for("teleop     driving")
        time.sleep(1.5 * slow)

    def release_and_arm() -> None:
        device.send(held.moved())
        device.send(held.state())
        time.sleep(1.5 * slow)
        device.send(held.state("arm"))
        device.send(held.state())
        told.wait_for("hold the enable button")

    told.wait_for("release the controls")  # nothing is known of a device before it says something
    device.send(held.moved())
    device.send(held.state())
    told.wait_for("hold the enable button")
    drive()
    first = feel(held, device, stopped=False)
    held.unplug()
    told.wait_for("INP-01")
    told.wait_for("quickstop")
    device = held.plug()
    time.sleep(1.5 * slow)  # it is looked for once a second
    device.send(held.state("enable", forward=1.0))
    time.sleep(3.0 * slow)
    if any("driving" in line for line in told.come()):
        raise Wrong("it drives by itself after the device was plugged in again")
    release_and_arm()
    drive()
    device.send(held.state("enable", "quickstop", forward=1.0))
    told.wait_for("request    quick stop")
    time.sleep(0.5 * slow)
    felt = feel(held, device, stopped=True)
    release_and_arm()
    device.send(held.state("done"))
    device.send(held.state())
    told.wait_for("report  ")
    if any("INP-16" in line for line in told.lines):
        raise Wrong("the device did not take an effect")
    return f"{first}; {felt}"


def feel(held: Held, device: Device, *, stopped: bool) -> str:
    """What the device's motors were told so far, for people.

    Raises:
        Wrong: something else than they had to be.
    """
    kinds = [struct.unpack_from("@H", effect)[0] for effect in device.effects]
    if held.profile.kind == "stick":
        uploads = [RUMBLE] * stopped if isinstance(device, UinputDevice) else []
        lit = [(MISC, on) for on in (1, 0, 1)] * stopped if held.lamps else []  # it joined a robot that was stopped
        if kinds != uploads or len(device.played) != stopped or device.lit != lit:
            raise Wrong(f"effects {kinds}, played {device.played}, lamps {device.lit}")
        seen = " and its lamp was on" if lit else ""
        return f"it rumbled at the stop{seen}" if stopped else "nothing was felt while it drove"
    springs = [struct.unpack_from("@H", effect, 16)[0] / 0xFFFF for effect in device.effects if effect[0] == SPRING]
    pushes = [struct.unpack_from("@h", effect, 16)[0] / 0x7FFF for effect in device.effects if effect[0] == CONSTANT]
    if not springs or max(springs) > FORCE + 0.001 or max(springs) < 0.9 * FORCE:
        raise Wrong(f"springs {springs}")
    if [round(push, 2) for push in pushes] != [FORCE] * 4 * stopped:
        raise Wrong(f"pushes {pushes}")
    if any(code == AUTOCENTER for code, _ in device.played):
        raise Wrong("a wheel with a spring needs no FF_AUTOCENTER")
    return f"{len(springs)} springs up to {max(springs):.2f}" + (f", {len(pushes)} pushes" if stopped else "")


def flood(held: Held) -> str:
    """Events that the kernel dropped leave the state as it is, pressed buttons and all.

    Raises:
        Wrong: they do not.
    """
    device = held.plug()
    try:
        port = Evdev()
        (info,) = [info for info in port.enumerate() if info.vendor == held.profile.parts[""].vendor]
        handle = port.open(info)
        try:
            device.send(held.state("enable"))
            for number in range(FLOOD):
                device.send({0: number + 1})
            device.send({**held.state(), 0: -1234})
            layout, reports = evdev_layout(handle.descriptor()), list[bytes]()
            while (report := handle.read(0.5)) is not None:
                reports.append(report)
            last = layout.decode(reports[-1]) or {}
        finally:
            handle.close()
    finally:
        held.unplug()
    if len(reports) > FLOOD or (last["x"], last["button.tl"]) != (-1234, 0):
        raise Wrong(f"{len(reports)} reports, the last {last}")
    return f"of {FLOOD + 2} changes {len(reports)} were read, the last state is right"


def main() -> int:
    """Drive by each device; 1 if something was wrong."""
    parser = argparse.ArgumentParser(description="Drive by devices that are made with /dev/uinput.")
    parser.add_argument("--slow", type=float, default=1.0, help="so many times slower, with libfaketime")
    parser.add_argument("--only", action="append", choices=["dropped", "gamepad", "xpad", "wheel"])
    options = parser.parse_args()
    if not os.access("/dev/uinput", os.R_OK | os.W_OK):
        print("SKIP /dev/uinput: is missing, or not for this user")
        return 0
    if find_spec("evdev") is None:
        print("SKIP the extra evdev is not installed: pip install 'artemis-robot[evdev]'")
        return 0
    environment = prepared(options.slow)
    tries: dict[str, Callable[[], str]] = {
        "dropped": lambda: flood(pad()),
        "gamepad": lambda: drive(pad(), options.slow, environment),
        "xpad": lambda: drive(pad(usb), options.slow, environment),
        "wheel": lambda: drive(wheel(), options.slow, environment),
    }
    return tried({name: tries[name] for name in options.only or tries})


if __name__ == "__main__":
    raise SystemExit(main())
