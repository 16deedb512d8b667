"""The process of a node of ROS 2, seen from the run: started, read, restarted if it ends."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping

import msgspec

from artemis.bridges.addresses import check_listen
from artemis.bridges.kept_process import KeptProcess
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
from artemis.bridges.ros2.settings import Ros2NodeConfig, cyclone_configuration, unicast_ports
from artemis.bridges.ros_types import Field, Ros2Types
from artemis.errors import ConfigError


class NodeProcess(KeptProcess):
    """A node in a process. All its topics are added before `start`.

    Attributes:
        names: Resolves the names that the node uses.
        types: Of its messages.
        state: What the process reported last.
        arrived: When the message that is being taken arrived [s].
    """

    module = "artemis.bridges.ros2.dds"

    def __init__(
        self, config: Ros2NodeConfig, plugin: str, default: str, environment: Mapping[str, str] = os.environ
    ) -> None:
        """Begin.

        Args:
            config: the node's keys.
            plugin: its name in the mission, for messages.
            default: the node's name, if the mission has none.
            environment: variables of ROS.

        Raises:
            ConfigError: a variable of ROS is wrong, or this computer has no such address.
        """
        check_listen(plugin, config.listen)
        self._config = config
        self.names = config.names(default)
        try:
            self._domain, distribution = config.domain_id(environment), config.peers(environment)
        except ValueError as error:
            raise ConfigError(f"{plugin}: {error}") from None
        self.types = Ros2Types(distribution)
        self._hashed = distribution != "humble"
        self._writers: list[Endpoint] = []
        self._readers: list[Endpoint] = []
        self._takers: list[Callable[[bytes, str], object]] = []
        self._latched: dict[int, bytes] = {}
        self.state, self.arrived = NodeState([], [], [], 0), 0.0
        self._dropped = 0
        super().__init__(plugin)

    # ------------------------------------------------------------------------------------------ before it runs

    def publish(self, topic: str, type: str, *, reliable: bool = True, latched: bool = False, depth: int = 10) -> int:
        """Have a topic, of an absolute name; returns its number."""
        self._writers.append(self._endpoint(topic, type, reliable, latched, depth))
        return len(self._writers) - 1

    def subscribe(
        self, topic: str, type: str, take: Callable[[bytes, str], object], *, reliable: bool = True, depth: int = 10
    ) -> int:
        """Subscribe to a topic: `take` is called in a thread, with each message and its sender.

        `reliable`: what is lost is sent again; best-effort publishers are refused.
        """
        self._readers.append(self._endpoint(topic, type, reliable, False, depth))
        self._takers.append(take)
        return len(self._readers) - 1

    def _endpoint(self, topic: str, type: str, reliable: bool, latched: bool, depth: int) -> Endpoint:
        self.types.prepare(type)
        return Endpoint(topic, type, self.types.hash(type) if self._hashed else "", reliable, latched, depth)

    def parts(self) -> NodeParts:
        """What is sent to the process first."""
        types: dict[str, list[tuple[str, Field]]] = {}
        for type in (INFORMATION, *(each.type for each in (*self._writers, *self._readers))):
            types |= self.types.fields(type)
        local, (namespace, _, name) = self._config.local, self.names.node.rpartition("/")
        return NodeParts(
            domain=self._domain,
            configuration=cyclone_configuration(self._config.listen, self._domain, local=local),
            address=self._config.listen,
            ports=unicast_ports(self._domain),
            namespace=namespace or "/",
            name=name,
            types=types,
            discovery_hash=self.types.hash(INFORMATION) if self._hashed else "",
            writers=self._writers,
            readers=self._readers,
        )

    # ------------------------------------------------------------------------------------------ its life

    def put(self, number: int, data: bytes) -> None:
        """Publish a message of the topic with that number. Waits for a process that is slow, until that is ended."""
        if self._writers[number].latched:
            self._latched[number] = data
            if self._new:
                return  # with the others
        self._send(WRITER.pack(number) + data)

    def keep(self) -> None:
        """Send a new process the latched messages. To be called again and again, in the thread that publishes."""
        if self._new:
            self._new = False
            for number, data in self._latched.items():
                self._send(WRITER.pack(number) + data)

    def heard(self, number: int) -> int:
        """Number of programs that read the topic with that number."""
        heard = self.state.heard
        return heard[number] if heard else 0

    @property
    def dropped(self) -> int:
        """Messages that programs did not take in time."""
        return self._dropped + self.state.dropped

    def senders(self, number: int) -> int:
        """Number of programs that publish on the topic with that number."""
        senders = self.state.senders
        return senders[number] if senders else 0

    def _first(self) -> bytes:
        return msgspec.msgpack.encode(self.parts())

    def _live(self, first: bytes) -> str:
        try:
            return super()._live(first)
        finally:
            self._dropped += self.state.dropped
            self.state = NodeState([], [], [], 0)

    def _hear(self, block: bytes) -> str:
        kind, block = block[:1], block[1:]
        if kind == STATE:
            self.state = msgspec.msgpack.decode(block, type=NodeState)
        elif kind == MESSAGE:
            number, sender, self.arrived = READER.unpack_from(block)
            self._takers[number](block[READER.size :], f"{sender:x}")
        elif kind == FAILURE:
            return msgspec.msgpack.decode(block, type=NodeFailure).text
        return ""
