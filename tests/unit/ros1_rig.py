"""A master of ROS 1 and peers for tests, in this process: what a node meets where no ROS is installed."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine, Sequence
from concurrent.futures import Future
from typing import Any, TypeVar

from artemis.bridges.ros1.connections import Connections
from artemis.bridges.ros1.tcpros import framed, pack_header, parse_header, read_block
from artemis.bridges.ros1.xmlrpc import BROKEN, CallError, XmlRpcServer, call
from artemis_lab.bench.ports import free_port

Answer = TypeVar("Answer")


class Master:
    """Knows who publishes, subscribes and serves; runs in a thread of its own, and can be restarted on its port."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self.port, self.pid = free_port(), 100
        self.published: dict[str, tuple[str, str]] = {}
        self.subscribed: dict[str, tuple[str, str]] = {}
        self.served: dict[str, str] = {}
        self.publishers: dict[str, list[str]] = {}
        """URIs that a new subscriber is told."""
        self.made: list[Publisher] = []
        self.opened: list[asyncio.StreamWriter] = []
        """Connections that peers made."""
        self._server: asyncio.Server | None = None
        self._rpc: XmlRpcServer | None = None

    @property
    def uri(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def run(self, work: Coroutine[Any, Any, Answer]) -> Answer:
        """What the coroutine returns, on the master's loop."""
        made: Future[Answer] = asyncio.run_coroutine_threadsafe(work, self._loop)
        return made.result(20.0)

    def until(self, holds: Callable[[], object]) -> None:
        """Wait until something holds; at most 20 s."""

        async def wait() -> None:
            async with asyncio.timeout(20.0):
                while not holds():
                    await asyncio.sleep(0.01)

        self.run(wait())

    def begin(self) -> None:
        """A new master, that knows nobody."""
        self.pid += 1
        for known in (self.published, self.subscribed, self.served):
            known.clear()
        self._rpc = XmlRpcServer(
            {
                "getPid": lambda caller: [1, "", self.pid],
                "registerPublisher": self._publisher,
                "registerSubscriber": self._subscriber,
                "registerService": self._service,
                "unregisterPublisher": lambda caller, topic, uri: [1, "", bool(self.published.pop(topic, None))],
                "unregisterSubscriber": lambda caller, topic, uri: [1, "", bool(self.subscribed.pop(topic, None))],
                "unregisterService": lambda caller, name, uri: [1, "", bool(self.served.pop(name, None))],
            }
        )
        self._server = self.run(
            asyncio.start_server(self._rpc.connections.accept, "127.0.0.1", self.port, limit=1 << 14)
        )

    def end(self) -> None:
        """The master is gone."""

        async def end() -> None:
            assert self._server is not None
            assert self._rpc is not None
            await self._rpc.connections.close(self._server)

        if self._server is not None:
            self.run(end())
            self._server = None

    def close(self) -> None:
        self.end()
        for publisher in self.made:
            publisher.leave()

        async def end() -> None:
            for writer in self.opened:
                writer.transport.abort()
            while others := asyncio.all_tasks() - {asyncio.current_task()}:
                for task in others:
                    task.cancel()
                await asyncio.gather(*others, return_exceptions=True)
                await asyncio.sleep(0.01)  # what was closed is given back, and what was accepted last begins
            await asyncio.sleep(0.01)

        self.run(end())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _publisher(self, caller: str, topic: str, type: str, uri: str) -> list[Any]:
        self.published[topic] = type, uri
        return [1, "", []]

    def _subscriber(self, caller: str, topic: str, type: str, uri: str) -> list[Any]:
        self.subscribed[topic] = type, uri
        return [1, "", self.publishers.get(topic, [])]

    def _service(self, caller: str, name: str, uri: str, caller_uri: str) -> list[Any]:
        self.served[name] = uri
        return [1, "", 0]


class Peer:
    """A subscriber of one topic, or a caller of one service, on the master's loop."""

    def __init__(self, master: Master) -> None:
        self.master = master

    def connect(self, topic: str, md5: str = "*") -> tuple[asyncio.StreamReader, asyncio.StreamWriter, dict[str, str]]:
        """Connect as a subscriber; returns the connection and the publisher's header."""
        return self.master.run(self._connect(topic, md5))

    async def _connect(self, topic: str, md5: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter, dict[str, str]]:
        _, uri = self.master.published[topic]
        code, text, address = await call(uri, "requestTopic", "/peer", topic, [["TCPROS"]])
        if code != 1:
            raise CallError(text)
        reader, writer = await asyncio.open_connection(address[1], address[2])
        self.master.opened.append(writer)
        writer.write(pack_header({"callerid": "/peer", "topic": topic, "md5sum": md5, "type": "*"}))
        return reader, writer, parse_header(await read_block(reader, 1 << 20))

    def hear(self, reader: asyncio.StreamReader) -> bytes:
        """The next message."""
        return self.master.run(asyncio.wait_for(read_block(reader, 1 << 20), 20.0))

    def ask(self, service: str, md5: str = "*") -> tuple[dict[str, str], bytes]:
        """The header and the response of a service without arguments."""

        return self.master.run(self.ask_later(service, md5))

    async def ask_later(self, service: str, md5: str = "*") -> tuple[dict[str, str], bytes]:
        """Likewise, on the master's loop."""
        host, _, port = self.master.served[service].removeprefix("rosrpc://").rpartition(":")
        reader, writer = await asyncio.open_connection(host, int(port))
        self.master.opened.append(writer)
        writer.write(pack_header({"callerid": "/peer", "service": service, "md5sum": md5}) + framed(b""))
        header = parse_header(await read_block(reader, 1 << 16))
        answer = b"" if "error" in header else await reader.readexactly(1) + await read_block(reader, 1 << 16)
        writer.close()
        return header, answer


class Publisher:
    """A publisher of one topic, on the master's loop; what is `kept` is told whoever connects."""

    def __init__(
        self, master: Master, topic: str, type: str, md5: str, name: str = "/peer", kept: bytes | None = None
    ) -> None:
        self.master, self._heard_by, self._kept = master, list[asyncio.StreamWriter](), kept
        self._links = Connections(self._serve, BROKEN)
        latching = str(int(kept is not None))
        self._header = {"callerid": name, "topic": topic, "type": type, "md5sum": md5, "latching": latching}
        self._tcp = master.run(asyncio.start_server(self._links.accept, "127.0.0.1", 0))
        port = self._tcp.sockets[0].getsockname()[1]
        self._calls = XmlRpcServer({"requestTopic": lambda *_: [1, "", ["TCPROS", "127.0.0.1", port]]})
        self._rpc = master.run(asyncio.start_server(self._calls.connections.accept, "127.0.0.1", 0))
        master.made.append(self)
        self.uri = f"http://127.0.0.1:{self._rpc.sockets[0].getsockname()[1]}/"
        known = master.publishers.setdefault(topic, [])
        known.append(self.uri)
        if topic in master.subscribed:
            master.run(call(master.subscribed[topic][1], "publisherUpdate", "/master", topic, known))

    @property
    def heard(self) -> bool:
        return bool(self._heard_by)

    def say(self, data: bytes) -> None:
        async def say() -> None:
            for link in self._heard_by:
                link.write(framed(data))

        self.master.run(say())

    def say_all(self, messages: Sequence[bytes]) -> None:
        """At once."""

        async def say() -> None:
            for link in self._heard_by:
                link.write(b"".join(map(framed, messages)))

        self.master.run(say())

    def cut(self) -> None:
        """Lose all connections."""

        async def cut() -> None:
            for link in self._heard_by:
                link.transport.abort()
            self._heard_by.clear()

        self.master.run(cut())

    def leave(self) -> None:
        """Go without a word."""

        async def leave() -> None:
            await self._links.close(self._tcp)
            await self._calls.connections.close(self._rpc)

        self.master.run(leave())

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await read_block(reader, 1 << 16)
        writer.write(pack_header(self._header))
        if self._kept is not None:
            writer.write(framed(self._kept))
        self._heard_by.append(writer)
        await reader.read()  # until it leaves
