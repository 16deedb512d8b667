"""A node of ROS 1 on the running loop: publishers, subscribers, services, and the master it is registered with.

The slave API and the master API are XML-RPC (wiki.ros.org/ROS/Slave_API, ROS/Master_API). Nothing here waits for a peer
longer than `xmlrpc.PATIENCE`, and no peer makes another one wait.
"""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any

from artemis.bridges.background import BackgroundTasks
from artemis.bridges.ros1.connections import Connections
from artemis.bridges.ros1.links import Publication, Service, Subscription, TcpRosServer
from artemis.bridges.ros1.xmlrpc import CallError, XmlRpcServer, call

LOOK = 1.0
"""Between two looks whether the master is there, and still the same [s]."""
LIMIT = 1 << 14
"""Bytes of a request that wait to be read."""
_DONE = 1


class RosNode:
    """One node. Its topics and services are made before `run`.

    Attributes:
        problem: Why it is not reachable; empty: it is.
        replaced: Another node took its name; it takes no further part.
    """

    def __init__(self, name: str, master: str, listening: socket.socket, rpc: socket.socket, host: str) -> None:
        """Begin, unregistered.

        Args:
            name: absolute.
            master: its URI.
            listening: a bound socket for TCPROS.
            rpc: a bound socket for XML-RPC.
            host: the name or address by which others reach both.
        """
        self.name, self.problem, self.replaced = name, "", False
        self._master, self._rpc, self._tcp = master, rpc, listening
        self.uri = f"http://{host}:{rpc.getsockname()[1]}/"
        self._address = host, listening.getsockname()[1]
        self.publications: dict[str, Publication] = {}
        self.subscriptions: dict[str, Subscription] = {}
        self.services: dict[str, Service] = {}
        self._pid: int | None = None
        self._shutdown = asyncio.Event()
        self._tasks = BackgroundTasks()
        self._updated: set[str] = set()
        """Topics whose publishers the master has reported since this node asked."""

    # ------------------------------------------------------------------------------------------ before it runs

    def publish(self, publication: Publication) -> None:
        """Have a topic."""
        self.publications[publication.topic] = publication

    def subscribe(
        self,
        topic: str,
        type: str,
        md5: str,
        take: Callable[[bytes, str], object],
        leave: Callable[[str], object] | None = None,
    ) -> Subscription:
        """Subscribe to a topic: `take` is called with each message and its node; `leave`: as of `Subscription`."""
        subscription = self.subscriptions[topic] = Subscription(self.name, topic, type, md5, take, leave)
        return subscription

    def serve(self, service: Service) -> None:
        """Have a service."""
        self.services[service.name] = service

    # ------------------------------------------------------------------------------------------ its life

    async def run(self) -> None:
        """Take part until cancelled, or until another node takes the name; then unregister."""
        rpc = XmlRpcServer(self._slave_api())
        tcp = TcpRosServer(self.name, self.publications, self.services)
        servers: list[tuple[Connections, asyncio.Server]] = []
        try:
            for of, listening in ((rpc.connections, self._rpc), (tcp.connections, self._tcp)):
                servers.append((of, await asyncio.start_server(of.accept, sock=listening, limit=LIMIT)))
            await self._keep_registered()
        finally:
            for task in self._tasks:
                task.cancel()
            for subscription in self.subscriptions.values():
                subscription.close()
            await asyncio.gather(*self._tasks, return_exceptions=True)
            await self._unregister()
            for of, server in servers:
                await of.close(server)

    async def _keep_registered(self) -> None:
        """Be known to the master, and again to one that was restarted."""
        while not self.replaced:
            try:
                pid = await self._ask("getPid")
                if pid != self._pid:
                    await self._register()
                    self._pid = pid
                problem = ""
            except CallError as error:
                self._pid, problem = None, str(error)
            if not self.replaced:  # while the master was asked
                self.problem = problem
            with suppress(TimeoutError):
                await asyncio.wait_for(self._shutdown.wait(), LOOK)

    async def _register(self) -> None:
        host, port = self._address
        for service in self.services.values():
            await self._ask("registerService", service.name, f"rosrpc://{host}:{port}", self.uri)
        for publication in self.publications.values():
            await self._ask("registerPublisher", publication.topic, publication.type, self.uri)
        for subscription in self.subscriptions.values():
            self._updated.discard(subscription.topic)
            subscription.registered = False
            uris = await self._ask("registerSubscriber", subscription.topic, subscription.type, self.uri)
            if subscription.topic not in self._updated:  # else news of it have overtaken the answer
                self._meet(subscription, [*uris, *subscription.connected])  # a new master does not know them
            subscription.registered = True

    async def _unregister(self) -> None:
        """As far as the master answers."""
        if self._pid is None or self.replaced:
            return
        host, port = self._address
        with suppress(CallError):
            for service in self.services:
                await self._ask("unregisterService", service, f"rosrpc://{host}:{port}")
            for topic in self.publications:
                await self._ask("unregisterPublisher", topic, self.uri)
            for topic in self.subscriptions:
                await self._ask("unregisterSubscriber", topic, self.uri)

    async def _ask(self, method: str, *arguments: object) -> Any:  # noqa: ANN401 (whatever the master says)
        answer = await call(self._master, method, self.name, *arguments)
        if not isinstance(answer, list) or len(answer) != 3 or answer[0] != _DONE:
            raise CallError(f"{self._master}: {method}: {answer!r:.100}")
        return answer[2]

    def _meet(self, subscription: Subscription, uris: Iterable[object]) -> None:
        """Connect to the publishers of a topic, and leave those that are gone."""
        for work in subscription.meet([uri for uri in uris if isinstance(uri, str)]):
            self._tasks.begin(work)

    # ------------------------------------------------------------------------------------------ what others ask

    def _slave_api(self) -> dict[str, Callable[..., Any]]:
        return {
            "requestTopic": self._request_topic,
            "publisherUpdate": self._publisher_update,
            "getPid": lambda caller: [_DONE, "", os.getpid()],
            "getMasterUri": lambda caller: [_DONE, "", self._master],
            "getBusStats": lambda caller: [_DONE, "", [[], [], []]],
            "getBusInfo": lambda caller: [_DONE, "", self._bus_info()],
            "getPublications": lambda caller: [_DONE, "", [[p.topic, p.type] for p in self.publications.values()]],
            "getSubscriptions": lambda caller: [_DONE, "", [[s.topic, s.type] for s in self.subscriptions.values()]],
            "paramUpdate": lambda caller, key, value: [_DONE, "", 0],
            "shutdown": self._shut_down,
        }

    def _request_topic(self, caller: str, topic: str, protocols: list[Any]) -> list[Any]:
        if topic not in self.publications:
            return [0, f"{self.name} does not publish {topic}", 0]
        if not any(protocol and protocol[0] == "TCPROS" for protocol in protocols):
            return [0, "only TCPROS is spoken here", 0]
        return [_DONE, "", ["TCPROS", *self._address]]

    def _publisher_update(self, caller: str, topic: str, uris: list[Any]) -> list[Any]:
        if topic in self.subscriptions:
            self._updated.add(topic)
            self._meet(self.subscriptions[topic], uris)
        return [_DONE, "", 0]

    def _shut_down(self, caller: str, reason: str = "") -> list[Any]:
        """The master reports it when another node registers under the name; `rosnode kill` does, too."""
        self.replaced, self.problem = True, f"shut down by {caller or 'another node'}: {reason}"
        self._shutdown.set()
        return [_DONE, "", 0]

    def _bus_info(self) -> list[list[Any]]:
        rows: list[list[Any]] = []
        for publication in self.publications.values():
            rows += [
                [len(rows) + n, link.name, "o", "TCPROS", publication.topic, True]
                for n, link in enumerate(publication.links)
            ]
        for subscription in self.subscriptions.values():
            rows += [
                [len(rows) + n, uri, "i", "TCPROS", subscription.topic, True]
                for n, uri in enumerate(subscription.connected)
            ]
        return rows
