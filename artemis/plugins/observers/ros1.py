"""The observer `ros1`: what the robot does, on the topics that every program of ROS 1 knows."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from artemis.bridges.complaints import Complaints
from artemis.bridges.ros1.links import Publication
from artemis.bridges.ros1.settings import NodeConfig
from artemis.bridges.ros1.tcpros import QUEUE
from artemis.bridges.ros1.thread import NodeThread
from artemis.bridges.ros_types import Ros1Types, ros1_name
from artemis.bridges.stamps import Stamps
from artemis.bridges.topics import Content, Told, Topic, Topics
from artemis.build import require
from artemis.config import Config
from artemis.devices.can_bus import Traffic
from artemis.motion.totals import total
from artemis.plugins.contracts import PluginContext
from artemis.values import Tick


class Ros1ObserverConfig(NodeConfig):
    """Keys that a mission may write beside `plugin: ros1` under `observers`."""

    every: Annotated[int, Field(ge=1, le=1000)] = 1
    """Odometry, pose, transforms and joints come each so many ticks."""
    transforms: bool = True
    """False: leave /tf and /tf_static to another program, such as robot_state_publisher and a localizer."""
    queue: Annotated[int, Field(ge=1, le=10_000)] = QUEUE
    """Messages of a topic that wait for a slow subscriber; then the oldest are dropped."""


class Ros1Observer:
    """A node that publishes what it sees. Nothing is opened before the first tick."""

    Config: ClassVar[type[Config]] = Ros1ObserverConfig
    contract: ClassVar[int] = 1
    live: ClassVar[bool] = True
    own_process: ClassVar[bool] = True
    pure: ClassVar[bool] = True

    def __init__(self, config: Ros1ObserverConfig, context: PluginContext) -> None:
        """Take the robot, and the paths that are known.

        Raises:
            ConfigError: the extra is not installed, this computer has no such address, or a variable of ROS is wrong.
        """
        require(f"{context.name}: plugin: ros1", "ros", "rosbags")
        config.checked(context.name)
        self._config, self._name = config, context.name
        self._topics = Topics(
            context.robot, context.routes, every=config.every, transforms=config.transforms, map=context.map
        )
        self._types, self._stamps = Ros1Types(), Stamps()
        for type in {topic.type for topic in self._topics.topics}:
            self._types.prepare(type)
        self._thread: NodeThread | None = None
        self._resolved: dict[str, str] = {}
        self._numbers: dict[str, int] = {}
        self._complaints, self._closed = Complaints(context.name, "subscriber"), False

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        """Publish a tick."""
        stamp = self._stamps.stamp(tick.snapshot.time)
        if (thread := self._thread) is None:
            thread = self._thread = self._begun()
            self._put(thread, list(self._topics.begin(stamp)))
        heard = thread.node.publications
        wanted = {name for name, resolved in self._resolved.items() if heard[resolved].links}
        self._put(thread, list(self._topics.tell(tick, stamp, wanted)))

    def take_problems(self) -> list[tuple[str, str, str]]:
        """That it is not heard, once as long as that lasts; and that a subscriber is too slow, once."""
        if (thread := self._thread) is None:
            return []
        dropped = total(publication.dropped for publication in thread.node.publications.values())
        return self._complaints.new(thread.problem, dropped, closed=self._closed)

    def close(self) -> None:
        """Unregister."""
        self._closed = True
        if self._thread is not None:
            self._thread.close()

    def _begun(self) -> NodeThread:
        thread = NodeThread(self._config, self._name)
        for topic in self._topics.topics:
            self._resolved[topic.name] = resolved = thread.names.resolve(topic.name)
            text, md5 = self._types.definition(topic.type)
            kind, queue = ros1_name(topic.type), self._config.queue
            thread.node.publish(Publication(resolved, kind, md5, text, latched=topic.latched, queue=queue))
        thread.start()
        return thread

    def _put(self, thread: NodeThread, told: list[Told]) -> None:
        if told:
            thread.put([(self._resolved[topic.name], self._packed(topic, content)) for topic, content in told])

    def _packed(self, topic: Topic, content: Content) -> bytes:
        """A message's bytes; headers are numbered, as the libraries of ROS 1 do."""
        if "header" in content:
            self._numbers[topic.name] = number = self._numbers.get(topic.name, -1) + 1
            content["header"]["seq"] = number
        return self._types.pack(topic.type, content)
