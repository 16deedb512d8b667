"""A node of ROS 1 in a thread of its own."""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress

from artemis.bridges.addresses import bound
from artemis.bridges.loop_thread import LoopThread
from artemis.bridges.ros1.node import RosNode
from artemis.bridges.ros1.settings import NodeConfig
from artemis.errors import ConfigError


class NodeThread(LoopThread):
    """The thread of one node. Publications, subscriptions and services are added to `node` before `start`."""

    def __init__(self, config: NodeConfig, plugin: str, environment: Mapping[str, str] = os.environ) -> None:
        """Take two free ports.

        Args:
            config: the node's keys.
            plugin: its name in the mission.
            environment: variables of ROS.

        Raises:
            ConfigError: this computer has no such address, or a variable is wrong.
        """
        self.names, master = config.checked(plugin, environment)
        with ExitStack() as made:
            try:
                tcp, rpc = (made.enter_context(bound(config.listen)) for _ in range(2))
            except OSError as error:
                raise ConfigError(f"{plugin}: listen: {config.listen}: {error.strerror}") from None
            host = config.host(environment, socket.gethostname())
            self.node = RosNode(self.names.node, master, tcp, rpc, host)
            made.pop_all()
        self._sockets = tcp, rpc
        super().__init__(plugin)

    def put(self, messages: Sequence[tuple[str, bytes]]) -> None:
        """Publish: absolute names of topics, and messages' bytes. Waits for no subscriber."""
        self.hand_over(self._put, messages)

    @property
    def problem(self) -> str:
        """Why the node is not reachable; empty: it is."""
        if self._closed or self._thread.is_alive():
            return self.node.problem
        return self.node.problem or "it has ended"

    def _put(self, messages: Sequence[tuple[str, bytes]]) -> None:
        for topic, data in messages:
            self.node.publications[topic].put(data)

    def _give_back(self) -> None:
        """Of a node that ended before it listened, too."""
        for each in self._sockets:
            each.close()

    async def _main(self, end: asyncio.Event) -> None:
        node, ending = asyncio.ensure_future(self.node.run()), asyncio.ensure_future(end.wait())
        await asyncio.wait((node, ending), return_when=asyncio.FIRST_COMPLETED)
        ending.cancel()
        node.cancel()
        with suppress(asyncio.CancelledError):
            await node
