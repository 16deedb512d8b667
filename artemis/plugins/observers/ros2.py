"""The observer `ros2`: what the robot does, on the topics that every program of ROS 2 knows."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from artemis.bridges.child_process import ENDED
from artemis.bridges.complaints import Complaints
from artemis.bridges.ros2.process import NodeProcess
from artemis.bridges.ros2.settings import Ros2NodeConfig
from artemis.bridges.stamps import Stamps
from artemis.bridges.topics import SCAN_TYPE, TRANSFORMS, Told, Topics
from artemis.build import require
from artemis.config import Config
from artemis.devices.can_bus import Traffic
from artemis.plugins.contracts import PluginContext
from artemis.values import Tick

DEPTH, DEPTH_OF_TRANSFORMS = 10, 100
"""Messages that are kept for a slow subscriber."""


class Ros2ObserverConfig(Ros2NodeConfig):
    """Keys that a mission may write beside `plugin: ros2` under `observers`."""

    every: Annotated[int, Field(ge=1, le=1000)] = 1
    """Odometry, pose, transforms and joints come each so many ticks."""
    transforms: bool = True
    """False: leave /tf and /tf_static to another program, such as robot_state_publisher and a localizer."""
    scans: Literal["reliable", "best_effort"] = "reliable"
    """reliable serves every subscriber; best_effort spares a bad radio link, and none that asks for reliable."""


class Ros2Observer:
    """A node that publishes what it sees. Nothing is opened before the first tick."""

    Config: ClassVar[type[Config]] = Ros2ObserverConfig
    contract: ClassVar[int] = 1
    live: ClassVar[bool] = True
    own_process: ClassVar[bool] = True
    """Messages are packed there; DDS has another one beside it, which is begun again without it."""
    pure: ClassVar[bool] = True

    def __init__(self, config: Ros2ObserverConfig, context: PluginContext) -> None:
        """Take the robot, and the paths that are known.

        Raises:
            ConfigError: the extra is not installed, a variable of ROS is wrong, or this computer has no such address.
        """
        require(f"{context.name}: plugin: ros2", "ros2", "cyclonedds", "rosbags")
        self._name, self._stamps = context.name, Stamps()
        self._topics = Topics(
            context.robot, context.routes, every=config.every, transforms=config.transforms, map=context.map
        )
        node = self._node = NodeProcess(config, context.name, "artemis")
        self._numbers = {
            topic.name: node.publish(
                node.names.resolve(topic.name),
                topic.type,
                reliable=topic.type != SCAN_TYPE or config.scans == "reliable",
                latched=topic.latched,
                depth=1 if topic.latched else DEPTH_OF_TRANSFORMS if topic is TRANSFORMS else DEPTH,
            )
            for topic in self._topics.topics
        }
        self._complaints = Complaints(context.name, "subscriber")
        self._begun = self._closed = False

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        """Publish a tick."""
        stamp, node = self._stamps.stamp(tick.snapshot.time), self._node
        if not self._begun:
            node.start()
            self._begun = True
            for told in self._topics.begin(stamp):
                self._put(told)
        node.keep()
        wanted = {name for name, number in self._numbers.items() if node.heard(number)}
        for told in self._topics.tell(tick, stamp, wanted):
            self._put(told)

    def take_problems(self) -> list[tuple[str, str, str]]:
        """That the process of DDS ended, and is back; a subscriber that is refused, or too slow, once."""
        node = self._node
        said = [(ENDED, self._name, words) for words in node.take_words()]
        return said + self._complaints.new("", node.dropped, closed=self._closed, refused=node.state.refused)

    def close(self) -> None:
        """Leave."""
        self._closed = True
        self._node.close()

    def _put(self, told: Told) -> None:
        topic, content = told
        self._node.put(self._numbers[topic.name], self._node.types.pack(topic.type, content))
