"""What a run sends to the process of a node of ROS 2 (`dds`), and what that sends back.

Both ends have a connection on which blocks of bytes go over. To the process: first a `NodeParts`, then messages, each
behind the number of its writer. From it: a letter, then `NodeState`, `NodeFailure` or a message of a reader, behind the
number of the reader, that of its sender, and when it arrived [s], by `clock.stopwatch`.
"""

from __future__ import annotations

import struct

from msgspec import Struct

from artemis.bridges.ros_types import Field

WRITER = struct.Struct("<H")
READER = struct.Struct("<HQd")
STATE, FAILURE, MESSAGE = b"s", b"f", b"m"
INFORMATION = "rmw_dds_common/msg/ParticipantEntitiesInfo"
"""The type by which a node lists its topics and services."""


class Endpoint(Struct, frozen=True):
    """A writer or a reader."""

    topic: str
    """Absolute, as ROS writes it."""
    type: str
    hash: str
    """Empty: it is not published."""
    reliable: bool
    latched: bool
    depth: int
    """Number of the newest messages that are kept for a slow reader, and for one that comes later if it is latched."""


class NodeParts(Struct, frozen=True):
    """A node."""

    domain: int
    configuration: str
    """Of Cyclone DDS, in XML."""
    address: str
    """The address of this computer at which it is reached."""
    ports: tuple[int, int]
    """The first and the last of those of which it takes two."""
    namespace: str
    name: str
    types: dict[str, list[tuple[str, Field]]]
    """Of the endpoints, and that of the discovery information; each after those within."""
    discovery_hash: str
    writers: list[Endpoint]
    readers: list[Endpoint]


class NodeState(Struct, frozen=True):
    """How a node is."""

    heard: list[int]
    """How many readers each writer has."""
    senders: list[int]
    """Number of writers that each reader is matched with."""
    refused: list[str]
    """Peers whose quality of service does not match, as texts: each once."""
    dropped: int
    """Messages that readers did not take in time."""


class NodeFailure(Struct, frozen=True):
    """Why there is no node."""

    text: str
