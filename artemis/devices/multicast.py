"""python-can's udp_multicast: buses without an adapter, on one computer or in one network, one for each group."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from socket import inet_aton
from typing import Any
from zlib import crc32

INTERFACE = "udp_multicast"
GROUPS = tuple(f"239.74.163.{number}" for number in range(2, 255))
"""The first is python-can's own."""
JOINED = Path("/proc/net/igmp")
"""Groups that programs on this computer listen to (Linux)."""
_DEFAULT_GROUPS, _DEFAULT_PORT = (None, GROUPS[0], "ff15:7079:7468:6f6e:6465:6d6f:6d63:6173"), 43113
"""Of python-can's udp_multicast."""


def with_port(words: Mapping[str, Any]) -> dict[str, Any]:
    """Words of a bus, with a port of its own for each group of udp_multicast that names none.

    python-can binds the port of all groups: on one host, buses with one port hear each other whatever their group.
    Its own default groups keep its port, for other CANopen tools.
    """
    if words.get("interface") != INTERFACE or "port" in words or words.get("channel") in _DEFAULT_GROUPS:
        return dict(words)
    return {**words, "port": _DEFAULT_PORT + 1 + crc32(str(words.get("channel")).encode()) % 10_000}


def place_of(words: Mapping[str, Any]) -> str:
    """A bus for people: interface and channel, and the port where artemis chose it."""
    chosen = with_port(words)
    place = " ".join(str(words[word]) for word in ("interface", "channel") if word in words)
    return f"{place} port {chosen['port']}" if "port" not in words and "port" in chosen else place


def free_group(joined: Path = JOINED) -> str:
    """A group that no program on this computer listens to; where that is not known, any but python-can's own."""
    try:
        listed = joined.read_text()
    except OSError:
        listed = ""
    return next(group for group in GROUPS[1:] if _listed(group) not in listed)


def _listed(group: str) -> str:
    """As the kernel lists it: its four bytes as one number."""
    return f"{int.from_bytes(inet_aton(group), sys.byteorder):08X}"
