"""The process of a node of ROS 2: `python -m artemis.bridges.ros2.dds FD`. The only file that imports cyclonedds.

The bytes of messages are made elsewhere; here they are written and taken as they are, by calls that cyclonedds keeps
to itself (`cyclonedds._clayer`), for which its version is pinned. Its write holds the interpreter as long as it waits,
and a fault in its C code ends the process: so the run has none of it in its own.

Names of topics and types, user data and the discovery information are those of rmw_dds_common and of REP 2016.
"""

from __future__ import annotations

import ctypes
import os
import socket
import stat
import struct
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from ipaddress import ip_address
from multiprocessing.connection import Connection
from typing import Any

import msgspec
from cyclonedds._clayer import ddspy_take, ddspy_write
from cyclonedds.core import (
    DDSException,
    InstanceState,
    Policy,
    Qos,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.types import (
    array,
    float32,
    float64,
    int8,
    int16,
    int32,
    int64,
    sequence,
    uint8,
    uint16,
    uint32,
    uint64,
)
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from artemis.bridges.kept_process import LOOK
from artemis.bridges.ros2.parts import (
    FAILURE,
    INFORMATION,
    MESSAGE,
    READER,
    STATE,
    WRITER,
    Endpoint,
    NodeFailure,
    NodeParts,
    NodeState,
)
from artemis.clock import stopwatch

MOST = 64
"""Messages of a topic that are taken at once."""
APART = 0.005
"""Between two looks what has arrived [s]: of a flood of commands the newest is passed on."""
HELD_UP = 0.15
"""A look this long after the one before is late [s]: this process was delayed, or the run does not read."""
MOST_MESSAGE = 1 << 14
"""Bytes of a message that is passed on: commands are small, and a tick may have to read many."""
LAST_WORDS = 0.3
"""Time for other participants to take the message that it leaves [s]."""
RELIABILITY, DURABILITY = 11, 2
_ATTACH_FILTER, _NETWORK_HEADER, _INSTRUCTION = 26, 0xFFF00000, struct.Struct("HBBI")
"""SO_ATTACH_FILTER and SKF_NET_OFF of Linux, and a sock_filter."""
_NODE, _GID = "rmw_dds_common/msg/NodeEntitiesInfo", "rmw_dds_common/msg/Gid"
_KINDS = {
    "bool": bool,
    "byte": uint8,
    "octet": uint8,
    "char": uint8,
    "int8": int8,
    "uint8": uint8,
    "int16": int16,
    "uint16": uint16,
    "int32": int32,
    "uint32": uint32,
    "int64": int64,
    "uint64": uint64,
    "float32": float32,
    "float64": float64,
    "string": str,
}


def dds_type(type: str) -> str:
    """How DDS names a type: `nav_msgs.msg.dds_.Odometry_` for `nav_msgs/msg/Odometry`."""
    package, kind, name = type.split("/")
    return f"{package}.{kind}.dds_.{name}_"


def made_types(described: Mapping[str, Sequence[tuple[str, Sequence[str | int]]]]) -> dict[str, Any]:
    """Classes of cyclonedds, by the names that ROS gives the types."""
    made: dict[str, Any] = {}
    for type, fields in described.items():
        kinds = {}
        for name, (of, *counts) in fields:
            kind = made.get(str(of)) or _KINDS[str(of)]
            for count in counts:
                kind = array[kind, count] if count else sequence[kind]
            kinds[name] = kind
        made[type] = make_idl_struct(dds_type(type).rpartition(".")[2], dds_type(type), kinds)
    return made


def quality(endpoint: Endpoint) -> Qos:
    """Quality of service, and the type's hash, of a writer or a reader. A write never waits for a slow reader."""
    keep = Policy.History.KeepLast(endpoint.depth)
    policies = [
        Policy.Reliability.Reliable(duration(seconds=0)) if endpoint.reliable else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if endpoint.latched else Policy.Durability.Volatile,
        keep,
        Policy.DataRepresentation(use_cdrv0_representation=True),
    ]
    if endpoint.latched:
        policies.append(Policy.DurabilityService(duration(seconds=0), keep, -1, -1, -1))
    if endpoint.hash:
        policies.append(Policy.Userdata(f"typehash={endpoint.hash};".encode()))
    return Qos(*policies)


class DdsNode:
    """A participant with the writers and readers of one node."""

    def __init__(self, parts: NodeParts) -> None:
        """Take part.

        Raises:
            DDSException: DDS does not let it.
        """
        self._parts, self.dropped = parts, 0
        self._too_long: dict[str, None] = {}
        self._domain = Domain(parts.domain, parts.configuration)
        keep_to(parts.address)
        self._participant = DomainParticipant(parts.domain, qos=Qos(Policy.Userdata(b"enclave=/;")))
        self._types = made_types(parts.types)
        information = Endpoint("", INFORMATION, parts.discovery_hash, reliable=True, latched=True, depth=1)
        self._information = self._writer("ros_discovery_info", information)
        self.writers = [self._writer(f"rt{each.topic}", each) for each in parts.writers]
        self.readers = [self._reader(f"rt{each.topic}", each) for each in parts.readers]
        self._conditions = []
        self.waiting = WaitSet(self._participant)
        for reader in self.readers:
            condition = ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any)
            self.waiting.attach(condition)
            self._conditions.append(condition)
        self._tell()

    def write(self, number: int, data: bytes) -> None:
        """Have a message sent, of the writer with that number."""
        if ddspy_write(self.writers[number]._ref, data.ljust(-(-len(data) // 4) * 4, b"\0")) < 0:
            self.dropped += 1

    def take(self, number: int) -> list[tuple[int, bytes]]:
        """What arrived at the reader with that number, the oldest first: sender and message."""
        taken = ddspy_take(self.readers[number]._ref, self._conditions[number].mask, MOST)
        valid = [(info.publication_handle, data) for data, info in taken if info.valid_data]
        if any(len(data) > MOST_MESSAGE for _, data in valid):
            self._too_long[self._parts.readers[number].topic] = None
        return [(sender, data) for sender, data in valid if len(data) <= MOST_MESSAGE]

    def state(self) -> NodeState:
        """How it is."""
        return NodeState(
            heard=[len(writer.get_matched_subscriptions()) for writer in self.writers],
            senders=[len(reader.get_matched_publications()) for reader in self.readers],
            refused=list(self._refusals()),
            dropped=self.dropped,
        )

    def close(self) -> None:
        """Announce that it leaves. Not all take the message of DDS for that: they notice after 10 s."""
        self._tell(there=False)
        with suppress(DDSException):
            self._information.wait_for_acks(duration(milliseconds=round(LAST_WORDS * 1000)))
        self._domain._delete(self._domain._ref)

    def _refusals(self) -> Iterator[str]:
        """Which peers ask for more than a writer offers, offer less than a reader asks for, or send too much."""
        for topic in self._too_long:
            yield f"a message of {topic} is dropped: it has more than {MOST_MESSAGE} bytes"
        for writer, endpoint in zip(self.writers, self._parts.writers, strict=True):
            status = writer.get_offered_incompatible_qos_status()
            if status.total_count:
                more = asked_more(status.last_policy_id)
                yield f"a subscriber of {endpoint.topic} is refused: {more} than is offered"
        for reader, endpoint in zip(self.readers, self._parts.readers, strict=True):
            status = reader.get_requested_incompatible_qos_status()
            if status.total_count:
                more = asked_more(status.last_policy_id)
                yield f"a publisher of {endpoint.topic} is refused: {more} than it offers"

    def _writer(self, name: str, endpoint: Endpoint) -> Any:  # noqa: ANN401 (cyclonedds has no types)
        topic = Topic(self._participant, name, self._types[endpoint.type])
        return DataWriter(self._participant, topic, quality(endpoint))

    def _reader(self, name: str, endpoint: Endpoint) -> Any:  # noqa: ANN401
        topic = Topic(self._participant, name, self._types[endpoint.type])
        return DataReader(self._participant, topic, quality(endpoint))

    def _tell(self, *, there: bool = True) -> None:
        """Publish what `ros2 node list` and `ros2 topic info -v` show; not `there`: that the node has left."""
        (_, (_, length)), *_ = self._parts.types[_GID]
        gid = self._types[_GID]

        def gids(entities: Sequence[Any]) -> list[object]:
            return [gid(data=list(each.guid.bytes.ljust(int(length), b"\0"))) for each in entities]

        node = self._types[_NODE](
            node_namespace=self._parts.namespace,
            node_name=self._parts.name,
            reader_gid_seq=gids(self.readers),
            writer_gid_seq=gids(self.writers),
        )
        (own,) = gids([self._participant])
        self._information.write(self._types[INFORMATION](gid=own, node_entities_info_seq=[node] if there else []))


def asked_more(policy: int) -> str:
    """What one side asks for more of, by the number of the policy (DDS 1.4, 2.3.3)."""
    words = {RELIABILITY: "more reliability is asked for", DURABILITY: "more durability is asked for (latched)"}
    return words.get(policy, f"more of policy {policy} is asked for")


def keep_to(address: str) -> None:
    """Have this process' UDP sockets use the filter of `address_filter`: Cyclone binds them to every address.

    Raises:
        OSError: the system does not do that.
    """
    filtering = address_filter(address)
    code = ctypes.create_string_buffer(filtering, len(filtering))
    program = struct.pack("HP", len(filtering) // _INSTRUCTION.size, ctypes.addressof(code))
    for number in map(int, os.listdir("/proc/self/fd")):
        try:
            if not stat.S_ISSOCK(os.fstat(number).st_mode):
                continue
        except OSError:  # that of the list itself
            continue
        with socket.socket(fileno=os.dup(number)) as each:
            if each.family != socket.AF_INET:
                continue
            if ip_address(address).is_loopback:
                each.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, b"lo")
            each.setsockopt(socket.SOL_SOCKET, _ATTACH_FILTER, program)


def address_filter(address: str) -> bytes:
    """A program for `SO_ATTACH_FILTER` that takes packets to an address, to this computer's own, and multicast.

    Fast DDS sends to 127.0.0.1 what is for the same computer, whatever address that has. The instructions are those of
    linux/filter.h.
    """
    load, equal, at_least, give = 0x20, 0x15, 0x35, 0x06  # BPF_LD|W|ABS, BPF_JMP|JEQ|K, BPF_JMP|JGE|K, BPF_RET|K
    steps = (
        (load, 0, 0, _NETWORK_HEADER + 16),
        (equal, 3, 0, int(ip_address(address))),
        (equal, 2, 0, int(ip_address("127.0.0.1"))),
        (at_least, 1, 0, int(ip_address("224.0.0.0"))),
        (give, 0, 0, 0),
        (give, 0, 0, 0xFFFFFFFF),
    )
    return b"".join(_INSTRUCTION.pack(*step) for step in steps)


def why_not(error: DDSException, parts: NodeParts) -> str:
    """Why DDS does not let a node take part."""
    first, last = parts.ports
    for port in range(first, last, 2):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one, socket.socket(one.family, one.type) as other:
            with suppress(OSError):
                one.bind(("", port))
                other.bind(("", port + 1))
                return f"DDS: {error.msg or error}"
    return f"every port of domain {parts.domain} is in use: {first} to {last}"


def run(connection: Connection) -> None:
    """Be a node until the other end of the connection is closed."""
    parts = msgspec.msgpack.decode(connection.recv_bytes(), type=NodeParts)
    try:
        node = DdsNode(parts)
    except (DDSException, OSError) as error:
        text = why_not(error, parts) if isinstance(error, DDSException) else f"{parts.address}: {error}"
        connection.send_bytes(FAILURE + msgspec.msgpack.encode(NodeFailure(text)))
        return
    ended = threading.Event()

    def obey() -> None:
        try:
            while True:
                block = connection.recv_bytes()
                (number,) = WRITER.unpack_from(block)
                node.write(number, block[WRITER.size :])
        except (EOFError, OSError):
            ended.set()

    threading.Thread(target=obey, daemon=True).start()
    with suppress(OSError):
        _serve(node, connection.send_bytes, ended)
    node.close()


def _serve(node: DdsNode, send: Callable[[bytes], None], ended: threading.Event) -> None:
    looked = stopwatch()
    while not ended.is_set():
        send(STATE + msgspec.msgpack.encode(node.state()))
        if node.readers:
            node.waiting.wait(duration(milliseconds=round(LOOK * 1000)))
        else:  # for nothing it does not wait
            ended.wait(LOOK)
        ended.wait(APART)
        now = stopwatch()
        arrived = looked if now - looked > HELD_UP else now  # after a late look: as old as it may be
        looked = now
        for number in range(len(node.readers)):
            for sender, data in node.take(number):
                send(MESSAGE + READER.pack(number, sender & 0xFFFFFFFFFFFFFFFF, arrived) + data)


if __name__ == "__main__":
    run(Connection(int(sys.argv[1])))
