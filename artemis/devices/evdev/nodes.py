"""Event nodes of the Linux kernel as sysfs describes them: nothing is opened, and no permission is needed.

The kernel's names are those of `linux/input-event-codes.h` and Documentation/input/event-codes.rst.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from artemis.devices.hid.descriptor import GAMEPAD
from artemis.devices.hid.port import RULES, HidInfo
from artemis.errors import DeviceLost

SYSFS = Path("/sys")
NODES = Path("/dev/input")
RUMBLE, PERIODIC, CONSTANT, SPRING, AUTOCENTER = 0x50, 0x51, 0x52, 0x53, 0x61
"""Codes of forces (EV_FF)."""
_BUSES = {0x03: "usb", 0x05: "bluetooth", 0x18: "i2c", 0x1C: "spi"}
"""By the kernel's numbers (BUS_USB and so on)."""
_HAT0X = 0x10
_TOUCH = range(0x140, 0x150)
"""Fingers and pens: BTN_DIGI and what follows."""
_WORD = 8 * struct.calcsize("@l")


@dataclass(frozen=True, slots=True, kw_only=True)
class EventNode:
    """One `/dev/input/event*`."""

    info: HidInfo
    keys: frozenset[int]
    axes: frozenset[int]
    forces: frozenset[int]
    """What its motors can do; empty: it has none."""
    lamps: frozenset[int]
    """Lamps that it lets programs switch (EV_LED)."""
    hidraw: frozenset[str]
    """Names of the same device's hidraw nodes, as hidraw0."""

    @property
    def drives(self) -> bool:
        """Somebody may drive with it: a button of joysticks, gamepads or wheels, and an axis that is no hat switch."""
        return (
            any(is_control_button(key) for key in self.keys)
            and not any(key in _TOUCH for key in self.keys)
            and any(axis < _HAT0X for axis in self.axes)
        )


def is_control_button(key: int) -> bool:
    """Whether a key code is a button of a joystick (BTN_JOYSTICK), gamepad, wheel, or one that happens to be there."""
    return 0x120 <= key < 0x140 or key in (0x150, 0x151) or 0x2C0 <= key < 0x300


def event_nodes(sysfs: Path = SYSFS) -> list[EventNode]:
    """All that are there now, in the order of their numbers."""
    found = []
    for place in (sysfs / "class" / "input").glob("event[0-9]*"):
        try:
            found.append(_node(place))
        except (OSError, ValueError):
            continue  # gone meanwhile
    return sorted(found, key=lambda node: int(node.info.path.rpartition("event")[2]))


def _node(place: Path) -> EventNode:
    device = place / "device"

    def text(name: str) -> str:
        words = (device / name).read_text(errors="replace")
        return "".join(character for character in words if character.isprintable()).strip()

    bus, vendor, product = (int(text(f"id/{name}"), 16) for name in ("bustype", "vendor", "product"))
    return EventNode(
        info=HidInfo(
            path=str(NODES / place.name),
            bus=_BUSES.get(bus, "unknown"),
            vendor=vendor,
            product=product,
            serial=text("uniq"),
            name=text("name"),
            interface=-1,
            usage=GAMEPAD,
            source="evdev",
        ),
        keys=_bits(text("capabilities/key")),
        axes=_bits(text("capabilities/abs")),
        forces=_bits(text("capabilities/ff")),
        lamps=_bits(text("capabilities/led")),
        hidraw=frozenset(node.name for node in (device / "device" / "hidraw").glob("hidraw*")),
    )


def _bits(text: str) -> frozenset[int]:
    """Numbers of the bits in a bitmap of sysfs: hexadecimal words, the highest first."""
    value = 0
    for word in text.split():
        value = value << _WORD | int(word, 16)
    return frozenset(number for number in range(value.bit_length()) if value >> number & 1)


def hidden_controls(sysfs: Path = SYSFS) -> list[HidInfo]:
    """What somebody may drive with and hidraw does not show, as Xbox pads over USB."""
    return [node.info for node in event_nodes(sysfs) if node.drives and not node.hidraw]


def motors_of(info: HidInfo, sysfs: Path = SYSFS) -> EventNode | None:
    """The node by which a device's motors and lamps are driven, whichever way it is read; None: it has none.

    Of several the first with motors, else the first with lamps.
    """
    name = Path(info.path).name
    found = [
        node
        for node in event_nodes(sysfs)
        if (node.forces or node.lamps)
        and (node.info.path == info.path or (info.source == "hidraw" and name in node.hidraw))
    ]
    return max(found, key=lambda node: bool(node.forces), default=None)


@contextmanager
def opening(info: HidInfo) -> Iterator[None]:
    """Raise DeviceLost for an event node that is gone, or that this user may not open."""
    try:
        yield
    except PermissionError:
        raise DeviceLost(str(info), no_permission(info)) from None
    except OSError as error:
        raise DeviceLost(str(info), f"is not there ({error.strerror})") from None


def udev_rule(info: HidInfo) -> str:
    """The rule of udev that lets the user at the computer, and the group `input`, open such event nodes."""
    ids = f'ATTRS{{id/vendor}}=="{info.vendor:04x}", ATTRS{{id/product}}=="{info.product:04x}"'
    return f'KERNEL=="event*", {ids}, MODE="0660", GROUP="input", TAG+="uaccess"'


def no_permission(info: HidInfo) -> str:
    """What to do about an event node that this user may not open."""
    rule = f"write {udev_rule(info)} into {RULES}, run `udevadm control --reload`, and plug it in again"
    return f"no permission to open {info.path}; {rule}"
