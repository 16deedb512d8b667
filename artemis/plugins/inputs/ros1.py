"""The input `ros1`: commanded by velocity commands and requests of ROS 1."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from functools import partial
from typing import ClassVar

from artemis.bridges.answers import Answers
from artemis.bridges.received import Receiver
from artemis.bridges.ros1.links import Service
from artemis.bridges.ros1.settings import NodeConfig
from artemis.bridges.ros1.thread import NodeThread
from artemis.bridges.ros_types import TRIGGER_MD5, Ros1Types, ros1_name
from artemis.build import require
from artemis.clock import stopwatch
from artemis.config import Config
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.commanded import HELD, CommandedInput, Ros1CommandKeys, may_share

BEAT = HELD / 3
"""Between two looks whether the thread that reads was held up [s]."""
DRAIN = 0.05
"""After that what waited is read for so long [s]."""


class Ros1InputConfig(Ros1CommandKeys, NodeConfig):
    """Keys of an input with `plugin: ros1`."""

    default_node: ClassVar[str] = "artemis_{}"


class Ros1Input(CommandedInput):
    """A node that is commanded."""

    Config: ClassVar[type[Config]] = Ros1InputConfig
    may_share = staticmethod(may_share)

    def __init__(self, config: Ros1InputConfig, context: PluginContext, clock: Callable[[], float] = stopwatch) -> None:
        """Take the robot; `clock` of arrivals [s].

        Raises:
            ConfigError: the extra is not installed, this computer has no such address, a variable of ROS is wrong, or
                more speed than the robot has.
        """
        require(f"{context.name}: plugin: ros1", "ros", "rosbags")
        config.checked(context.name)
        super().__init__(config, context, clock)
        self._config, self._definitions, self._answers = config, Ros1Types(), Answers()
        self._receiver = Receiver(self._rules, self._definitions, self._mailbox, self._arrival)
        self._ran, self._held, self._drained = stopwatch(), 0.0, 0.0
        self._thread: NodeThread | None = None
        self._topic = ""

    def close(self) -> None:
        """Unregister."""
        if self._thread is not None:
            self._thread.close()

    def _open(self) -> None:
        thread = self._thread = NodeThread(self._config, self._name)
        resolve, node = thread.names.resolve, thread.node
        self._topic = resolve(self._config.commands)
        for name in self._config.requests:
            node.serve(Service(resolve(name), "std_srvs/Trigger", TRIGGER_MD5, partial(self._called, name)))
        for topic, (type, take) in self._receiver.topics().items():
            md5 = self._definitions.definition(type)[1]
            leave = None if topic == "stop" else partial(self._leave, topic)
            node.subscribe(resolve(topic), ros1_name(type), md5, take, leave)
        self._ran = stopwatch()
        thread.soon(self._beat)
        thread.start()

    def _heard(self) -> tuple[bool, str]:
        assert self._thread is not None
        return bool(self._thread.node.subscriptions[self._topic].connected), self._thread.problem

    def _beat(self) -> None:
        """Look again and again whether the thread was held up."""
        self._arrival()
        asyncio.get_running_loop().call_later(BEAT, self._beat)

    def _arrival(self) -> float:
        """When what is read now arrived [s]: what the thread reads first after a hold-up has waited as long as that."""
        time, now = self._clock(), stopwatch()
        if now - self._ran > HELD:
            self._held, self._drained = now - self._ran, now + DRAIN
        self._ran = now
        return time - self._held if now < self._drained else time

    def _leave(self, topic: str, sender: str) -> None:
        """A publisher sends what it has kept: perhaps from before the robot was stopped."""
        self._receiver.too_old(topic, f"latched message from {sender} dropped")

    def _answer(self, numbers: Sequence[int], taken: bool, words: str) -> None:
        if self._thread is not None:
            self._thread.soon(self._answers.give, numbers, taken, words)

    async def _called(self, name: str) -> bytes:
        """The response of a Trigger: whether it has an effect, and a message."""
        taken, words = await self._answers.of(self._receiver.call(name))
        message = words.encode()
        return bytes([taken]) + len(message).to_bytes(4, "little") + message
