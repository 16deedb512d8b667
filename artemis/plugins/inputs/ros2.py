"""The input `ros2`: commanded by velocity commands and requests of ROS 2."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar, Literal

from artemis.bridges.child_process import ENDED
from artemis.bridges.received import Problem, Receiver
from artemis.bridges.ros2.process import NodeProcess
from artemis.bridges.ros2.settings import Ros2Name, Ros2NodeConfig
from artemis.build import require
from artemis.clock import stopwatch
from artemis.config import Config
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.commanded import CommandedInput, CommandKeys, may_share
from artemis.values import Tick


class Ros2InputConfig(CommandKeys, Ros2NodeConfig):
    """Keys of an input with `plugin: ros2`."""

    type: Literal[
        "geometry_msgs/msg/Twist",
        "geometry_msgs/msg/TwistStamped",
        "ackermann_msgs/msg/AckermannDrive",
        "ackermann_msgs/msg/AckermannDriveStamped",
    ] = "geometry_msgs/msg/Twist"
    """What the commands are."""
    topic: Ros2Name | None = None
    """Of the commands; if left out: cmd_vel, or ackermann_cmd."""


class Ros2Input(CommandedInput):
    """A node that is commanded."""

    Config: ClassVar[type[Config]] = Ros2InputConfig
    may_share = staticmethod(may_share)

    def __init__(self, config: Ros2InputConfig, context: PluginContext, clock: Callable[[], float] = stopwatch) -> None:
        """Take the robot; `clock`: the time now [s], as `stopwatch` has it, which arrivals are counted by.

        Raises:
            ConfigError: the extra is not installed, this computer has no such address, a variable of ROS is wrong, or
                more speed than the robot has.
        """
        require(f"{context.name}: plugin: ros2", "ros2", "cyclonedds", "rosbags")
        node = self._node = NodeProcess(config, context.name, f"artemis_{context.name}")
        super().__init__(config, context, clock)
        self._number = -1
        receiver = Receiver(self._rules, node.types, self._mailbox, lambda: node.arrived)
        for topic, (type, take) in receiver.topics().items():
            resolved = node.names.resolve(topic)
            asked = topic in config.allow or topic == "stop"
            if asked:
                node.subscribe(resolved, type, take)
            if not asked or topic == "stop":  # a lost command is of no use; a stop is heard from every publisher
                number = node.subscribe(resolved, type, take, reliable=False, depth=1)
                self._number = number if topic == config.commands else self._number
        self._reported: set[str] = set()

    def show(self, tick: Tick) -> str:
        """Nothing is answered in ROS 2; reports publishers that are refused."""
        super().show(tick)
        new = [words for words in self._node.state.refused if words not in self._reported]
        self._reported.update(new)
        return "; ".join(new)

    def take_problems(self) -> list[Problem]:
        """Likewise; and that the process of DDS ended, and is back."""
        return [*super().take_problems(), *((ENDED, words) for words in self._node.take_words())]

    def close(self) -> None:
        """Leave."""
        self._node.close()

    def _open(self) -> None:
        self._node.start()

    def _heard(self) -> tuple[bool, str]:
        return self._node.senders(self._number) > 0, self._node.problem

    def _answer(self, numbers: Sequence[int], taken: bool, words: str) -> None:
        """There are no services."""
