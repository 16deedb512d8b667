"""The process of a node of ROS 2, seen from the run: started, heard, and started again if it ends."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection

import msgspec

from artemis.bridges.child_process import ChildProcess
from artemis.bridges.ros2.parts import (
    FAILURE,
    INFORMATION,
    LOOK,
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
from artemis.clock import stopwatch
from artemis.errors import ConfigError

BEGIN, SILENCE = 10.0, 3.0
"""It has so long until it first says something, and between two times [s]; then it is ended."""
AGAIN = 1.0
"""Between two starts of one that ends at once [s]; one that lived longer is started again at once."""
END_TIME = 2.0
"""It has this long to leave at the end [s]."""


class NodeProcess:
    """A node in a process. All its topics are added before `start`.

    Attributes:
        names: Resolves the names that the node uses.
        types: Of its messages.
        state: What the process told last.
    """

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
            ConfigError: a variable of ROS is wrong.
        """
        self._config, self._plugin = config, plugin
        self.names = config.names(default)
        try:
            self._domain, distribution = config.domain_id(environment), config.peers(environment)
        except ValueError as error:
            raise ConfigError(f"{plugin}: {error}") from None
        self.types = Ros2Types(distribution)
        self._hashed = distribution != "humble"
        self._writers: list[Endpoint] = []
        self._readers: list[Endpoint] = []
        self._takers: list[Callable[[bytes, str], None]] = []
        self._latched: dict[int, bytes] = {}
        self.state = NodeState([], [], [], 0)
        self.problem = ""
        """Why the node is not heard at present; empty: it is, or it has only begun."""
        self.pid: int | None = None
        """Of the process."""
        self._connection: Connection | None = None
        self._renewed = False
        self._sending = threading.Lock()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name=plugin, daemon=True)

    # ------------------------------------------------------------------------------------------ before it runs

    def publish(self, topic: str, type: str, *, reliable: bool = True, latched: bool = False, depth: int = 10) -> int:
        """Have a topic, of an absolute name; returns its number."""
        self._writers.append(self._endpoint(topic, type, reliable, latched, depth))
        return len(self._writers) - 1

    def subscribe(
        self, topic: str, type: str, take: Callable[[bytes, str], None], *, reliable: bool = True, depth: int = 10
    ) -> int:
        """Hear a topic: `take` is called in a thread, with each message and who sent it.

        `reliable`: what is lost is sent again; who publishes at best effort is refused.
        """
        self._readers.append(self._endpoint(topic, type, reliable, False, depth))
        self._takers.append(take)
        return len(self._readers) - 1

    def _endpoint(self, topic: str, type: str, reliable: bool, latched: bool, depth: int) -> Endpoint:
        self.types.prepare(type)
        return Endpoint(topic, type, self.types.hash(type) if self._hashed else "", reliable, latched, depth)

    def parts(self) -> NodeParts:
        """What the process is told."""
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

    def start(self) -> None:
        """Take part.

        Raises:
            ConfigError: this computer has no such address.
        """
        try:
            self._config.check_address()
        except OSError as error:
            raise ConfigError(f"{self._plugin}: listen: {self._config.listen}: {error.strerror}") from None
        self._thread.start()

    def put(self, number: int, data: bytes) -> None:
        """Publish a message of the topic with that number. Waits for a process that is slow, until that is ended."""
        if self._writers[number].latched:
            self._latched[number] = data
            if self._renewed:
                return  # with the others
        self._send(number, data)

    def keep(self) -> None:
        """Tell a new process the latched messages. To be called again and again, in the thread that publishes."""
        if self._renewed:
            self._renewed = False
            for number, data in self._latched.items():
                self._send(number, data)

    def heard(self, number: int) -> int:
        """How many programs hear the topic with that number."""
        heard = self.state.heard
        return heard[number] if heard else 0

    def senders(self, number: int) -> int:
        """How many programs are heard on the topic with that number."""
        senders = self.state.senders
        return senders[number] if senders else 0

    def close(self) -> None:
        """Leave; harmless when repeated."""
        self._end.set()
        if self._thread.ident is not None:
            self._thread.join(2 * END_TIME)

    def _run(self) -> None:
        parts = msgspec.msgpack.encode(self.parts())
        while not self._end.is_set():
            begun = stopwatch()
            failure = self._live(parts)
            self.state = NodeState([], [], [], 0)
            if not self._end.is_set():
                self.problem = failure
                self._end.wait(max(0.0, begun + AGAIN - stopwatch()))

    def _live(self, parts: bytes) -> str:
        """Have a process until it ends; returns why it did."""
        ours, its = Pipe()
        try:
            with its:
                process = ChildProcess(["-m", "artemis.bridges.ros2.dds"], [its.fileno()])
        except OSError as error:
            ours.close()
            return f"its process cannot be started: {error.strerror}"
        self.pid = process.pid
        failure = self._talk(ours, parts, process)
        if failure:
            process.end()  # who sends goes on
        with self._sending:
            self._connection = None
            ours.close()
        process.wait(END_TIME)
        words = process.end()
        return failure or f"its process: {words}"

    def _talk(self, ours: Connection, parts: bytes, process: ChildProcess) -> str:
        """Tell the process what it is, and hear it until it ends; returns why it shall end, if it has not."""
        patience, silent = BEGIN, 0.0
        with suppress(EOFError, OSError):
            ours.send_bytes(parts)
            with self._sending:
                self._connection, self._renewed = ours, True
            while not self._end.is_set():
                if not ours.poll(LOOK):
                    silent += LOOK
                    if silent >= patience:
                        return "its process does not answer"
                    continue
                block, silent = ours.recv_bytes(), 0.0
                kind, block = block[:1], block[1:]
                if kind == STATE:
                    process.trim()
                    self.state, self.problem, patience = msgspec.msgpack.decode(block, type=NodeState), "", SILENCE
                elif kind == MESSAGE:
                    number, sender = READER.unpack_from(block)
                    self._takers[number](block[READER.size :], f"{sender:x}")
                elif kind == FAILURE:
                    return msgspec.msgpack.decode(block, type=NodeFailure).text
        return ""

    def _send(self, number: int, data: bytes) -> None:
        with self._sending:
            if self._connection is not None:
                with suppress(OSError):  # it has ended; the thread finds that
                    self._connection.send_bytes(WRITER.pack(number) + data)
