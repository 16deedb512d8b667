"""The report descriptors in tests/data/hid, and short ones made of items."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from artemis.devices.hid.descriptor import Descriptor, parse_descriptor
from artemis.yaml_file import load

FOLDER = Path(__file__).parents[1] / "data" / "hid"
DEVICES: dict[str, Any] = {path.stem: load(path).data for path in sorted(FOLDER.glob("*.yaml"))}
DESCRIPTORS = {name: bytes.fromhex(device["report_descriptor"]) for name, device in DEVICES.items()}
JOYSTICK = "05 01 09 04 a1 01"
"""Generic desktop page, usage joystick, collection (application)."""
STICK = bytes.fromhex(
    f"{JOYSTICK} 09 30 09 31 15 00 25 ff 75 08 95 02 81 02 05 09 19 01 29 08 25 01 75 01 95 08 81 02 c0"
)
"""Report of three bytes: x, y, eight buttons."""


def joystick(items: str) -> Descriptor:
    """The descriptor of a joystick whose collection has these items, in hexadecimal."""
    return parse_descriptor(bytes.fromhex(f"{JOYSTICK} {items} c0"))
