"""The input `ros1`: commanded by velocity commands and requests of ROS 1."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import partial
from typing import ClassVar

from artemis.bridges.ros1.links import Service
from artemis.bridges.ros1.settings import NodeConfig
from artemis.bridges.ros1.thread import NodeThread
from artemis.bridges.ros_types import TRIGGER_MD5, Ros1Types, require_packages, ros1_name
from artemis.config import Config
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.commanded import REQUESTS, CommandedInput, Ros1CommandKeys


class Ros1InputConfig(Ros1CommandKeys, NodeConfig):
    """Keys of an input with `plugin: ros1`."""


class Ros1Input(CommandedInput):
    """A node that is commanded."""

    Config: ClassVar[type[Config]] = Ros1InputConfig

    def __init__(self, config: Ros1InputConfig, context: PluginContext) -> None:
        """Take the robot.

        Raises:
            ConfigError: the extra is not installed, this computer has no such address, a variable of ROS is wrong, or
                more speed than the robot has.
        """
        require_packages(context.name, "ros1", "rosbags")
        config.checked(context.name, f"artemis_{context.name}", os.environ)
        super().__init__(config, context, types := Ros1Types())
        self._config, self._definitions = config, types
        self._thread: NodeThread | None = None
        self._topic = ""

    @staticmethod
    def may_share(one: Ros1InputConfig, other: Ros1InputConfig, _files: Mapping[str, bytes]) -> bool:
        """Whether both hear one topic, or are one node."""
        return one.commands == other.commands or (one.node is not None and one.node == other.node)

    def close(self) -> None:
        """Unregister."""
        if self._thread is not None:
            self._thread.close()

    def _open(self) -> None:
        thread = self._thread = NodeThread(self._config, self._name, f"artemis_{self._name}")
        resolve, node = thread.names.resolve, thread.node
        self._topic = resolve(self._config.commands)
        for name in self._config.requests:
            node.serve(Service(resolve(name), "std_srvs/Trigger", TRIGGER_MD5, partial(self._answer, name)))
        for topic, (type, take) in self._topics().items():
            node.subscribe(resolve(topic), ros1_name(type), self._definitions.definition(type)[1], take)
        thread.start()

    def _heard(self) -> tuple[bool, str]:
        assert self._thread is not None
        return bool(self._thread.node.subscriptions[self._topic].connected), self._thread.problem

    def _answer(self, name: str) -> bytes:
        """The response of a Trigger: success, and a message. Called in the node's thread."""
        self._ask(REQUESTS[name])
        message = f"{name}: requested".encode()
        return b"\x01" + len(message).to_bytes(4, "little") + message
