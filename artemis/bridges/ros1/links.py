"""Both ends of ROS 1's data connections: publications, subscriptions and services, over TCPROS."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Mapping, Sequence
from typing import Any, NamedTuple

from artemis.bridges.ros1.connections import Connections
from artemis.bridges.ros1.tcpros import (
    MOST_HEADER,
    QUEUE,
    NewestBlock,
    SubscriberLink,
    framed,
    pack_header,
    parse_header,
    read_block,
    set_up,
)
from artemis.bridges.ros1.xmlrpc import BROKEN, PATIENCE, CallError, call

MOST_MESSAGE = 1 << 14
"""Bytes of a message that is read: commands are small, and a tick may have to read many."""
MOST_PUBLISHERS = 64
"""Publishers of a topic that are read; of more the first."""
MOST_KNOWN = 1024
"""Publishers of a topic that are remembered, also when they have left."""
AT_ONCE, APART = 1 << 18, 0.005
"""Bytes that are read of a publisher at once, and how much time passes between two times [s]."""
AGAIN = 1.0
"""A publisher that cannot be reached is tried again after this time [s]."""


class Publication:
    """A topic of ours, and its subscribers."""

    def __init__(
        self, topic: str, type: str, md5: str, definition: str, *, latched: bool = False, queue: int = QUEUE
    ) -> None:
        """`type` as ROS 1 writes it."""
        self.topic, self.type, self.md5, self._definition = topic, type, md5, definition
        self._latched, self._queue, self._last = latched, queue, b""
        self.links: list[SubscriberLink] = []
        self._gone = 0

    def put(self, data: bytes) -> None:
        """Send a message to all."""
        message = framed(data)
        if self._latched:
            self._last = message
        for link in self.links:
            link.put(message)

    @property
    def dropped(self) -> int:
        """Messages that subscribers did not take in time."""
        return self._gone + sum(link.dropped for link in self.links)

    def refusal(self, fields: Mapping[str, str]) -> str:
        """Why a subscriber with this header cannot receive it; empty: it can."""
        type, md5 = fields.get("type", "*"), fields.get("md5sum", "")
        if type not in ("*", self.type) or md5 not in ("*", self.md5):
            return f"{self.topic} is {self.type} with md5sum {self.md5}, and {type} with {md5} was asked for"
        return ""

    async def serve(self, node: str, fields: Mapping[str, str], writer: asyncio.StreamWriter) -> None:
        """Serve a subscriber until it leaves."""
        answer = {
            "callerid": node,
            "latching": str(int(self._latched)),
            "md5sum": self.md5,
            "message_definition": self._definition,
            "topic": self.topic,
            "type": self.type,
        }
        writer.write(pack_header(answer))
        link = SubscriberLink(writer, fields.get("callerid", "?"), self._queue)
        if self._last:
            link.put(self._last)
        self.links.append(link)
        try:
            await link.send()
        finally:
            self.links.remove(link)
            self._gone += link.dropped
            link.close()


class Service(NamedTuple):
    """A service of ours without arguments."""

    name: str
    type: str
    md5: str
    answer: Callable[[], Awaitable[bytes]]
    """Is called once for each request; gives the response."""


class TcpRosServer:
    """Accepts subscribers and callers of services."""

    def __init__(self, node: str, publications: Mapping[str, Publication], services: Mapping[str, Service]) -> None:
        self._node, self._publications, self._services = node, publications, services
        self.connections = Connections(self._serve, BROKEN)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        set_up(writer)
        async with asyncio.timeout(PATIENCE):
            fields = parse_header(await read_block(reader, MOST_HEADER))
        if "service" in fields:
            await self._serve_calls(fields, reader, writer)
        else:
            await self._serve_topic(fields, reader, writer)

    async def _serve_topic(
        self, fields: Mapping[str, str], reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        topic = fields.get("topic", "")
        publication = self._publications.get(topic)
        refusal = f"{self._node} does not publish {topic}" if publication is None else publication.refusal(fields)
        if publication is None or refusal:
            writer.write(pack_header({"error": refusal}))
            return
        sending = asyncio.ensure_future(publication.serve(self._node, fields, writer))
        try:  # a subscriber sends nothing more: reading ends when it leaves
            while await reader.read(1 << 12):
                pass
        finally:
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)

    async def _serve_calls(
        self, fields: Mapping[str, str], reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        service = self._services.get(fields["service"])
        if service is None or fields.get("md5sum") not in ("*", service.md5):
            why = "no such service" if service is None else f"its md5sum is {service.md5}"
            writer.write(pack_header({"error": f"{self._node}: {fields['service']}: {why}"}))
            return
        kind = {"callerid": self._node, "md5sum": service.md5, "service": service.name, "type": service.type}
        kind |= {"request_type": f"{service.type}Request", "response_type": f"{service.type}Response"}
        writer.write(pack_header(kind))
        while fields.get("probe") != "1":
            await read_block(reader, MOST_HEADER)
            writer.write(b"\x01" + framed(await service.answer()))
            await writer.drain()
            if fields.get("persistent") != "1":
                return


class Subscription:
    """A topic of others that is read."""

    def __init__(
        self,
        node: str,
        topic: str,
        type: str,
        md5: str,
        take: Callable[[bytes, str], object],
        leave: Callable[[str], object] | None = None,
    ) -> None:
        """Read no publisher yet.

        Args:
            node: the subscriber.
            topic: absolute.
            type: as ROS 1 writes it.
            md5: of the type.
            take: called with each message and its sender.
            leave: is told who sent it of a message that a publisher had kept for whoever connects, and that may be an
                old one: all but what a publisher says which has just come; None: `take` is given these, too.
        """
        self.topic, self.type, self._node, self._md5, self._take = topic, type, node, md5, take
        self._leave = leave
        self.registered = False
        """The master has reported the earlier publishers; one that becomes known from now on is new."""
        self.connected: list[str] = []
        """URIs of the publishers that are being read."""
        self.problem = ""
        """Why the newest publisher that is not read is not."""
        self._links: dict[str, asyncio.Task[None]] = {}
        self._wanted: set[str] = set()
        self._known: dict[str, None] = {}

    def meet(self, uris: Sequence[str]) -> list[Coroutine[Any, Any, None]]:
        """The publishers are these now; returns what connects to the new ones."""
        uris = list(dict.fromkeys(uris))[:MOST_PUBLISHERS]
        begun = {uri: self.registered and uri not in self._known for uri in uris if uri not in self._wanted}
        self._wanted = set(uris)
        self._known.update(dict.fromkeys(begun))
        while len(self._known) > MOST_KNOWN:
            del self._known[next(iter(self._known))]
        for uri, task in list(self._links.items()):
            if uri not in self._wanted:
                task.cancel()
        return [self._hear(uri, new=new) for uri, new in begun.items()]

    def close(self) -> None:
        """Read no publisher any more."""
        self.meet([])

    async def _hear(self, uri: str, *, new: bool) -> None:
        """Read one publisher while it exists; `new`: none of its messages is older than its connection."""
        task = asyncio.current_task()
        assert task is not None
        if (before := self._links.get(uri)) is not None:
            before.cancel()
        self._links[uri] = task
        try:
            while uri in self._wanted:
                try:
                    await self._listen(uri, new=new)
                except (CallError, OverflowError, *BROKEN) as error:  # OverflowError: no port has that number
                    self.problem = f"{uri}: {error}"
                new = False
                await asyncio.sleep(AGAIN)
        finally:
            if self._links.get(uri) is task:
                del self._links[uri]

    async def _take_newest(
        self, reader: asyncio.StreamReader, transport: asyncio.WriteTransport, sender: str, *, kept: bool
    ) -> None:
        """Take messages until the publisher leaves: the newest, now and then, so that a flood costs little.

        The first one is `kept`: from before the connection.
        """
        assert isinstance(transport, asyncio.Transport)
        blocks = NewestBlock(MOST_MESSAGE)
        while data := await reader.read(AT_ONCE):
            transport.pause_reading()
            if (newest := blocks.feed(data)) is not None:
                if kept and blocks.count == 1 and self._leave is not None:
                    self._leave(sender)
                else:
                    self._take(newest, sender)
            await asyncio.sleep(APART)
            transport.resume_reading()
        raise ConnectionResetError("the publisher has closed the connection")

    async def _listen(self, uri: str, *, new: bool) -> None:
        answer = await call(uri, "requestTopic", self._node, self.topic, [["TCPROS"]])
        match answer:
            case [1, _, ["TCPROS", str(host), int(port)]]:
                pass
            case _:
                raise ValueError(f"{self.topic} is not given: {answer!r:.100}")
        async with asyncio.timeout(PATIENCE):
            reader, writer = await asyncio.open_connection(host, port)
        try:
            set_up(writer)
            wish = {"callerid": self._node, "topic": self.topic, "type": self.type, "md5sum": self._md5}
            writer.write(pack_header({**wish, "tcp_nodelay": "1"}))
            async with asyncio.timeout(PATIENCE):
                fields = parse_header(await read_block(reader, MOST_HEADER))
            if "error" in fields:
                raise ValueError(fields["error"])
            self.connected.append(uri)
            try:
                kept = fields.get("latching") == "1" and not new
                await self._take_newest(reader, writer.transport, fields.get("callerid", "?"), kept=kept)
            finally:
                self.connected.remove(uri)
        finally:
            writer.close()
