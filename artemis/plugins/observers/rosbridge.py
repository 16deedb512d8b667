"""The observer `rosbridge`: what the robot does, as JSON over WebSockets, as rosbridge tells it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, ClassVar

import msgspec
from pydantic import Field

from artemis.bridges.addresses import check_listen, listening_at
from artemis.bridges.complaints import Complaints
from artemis.bridges.json_messages import JsonMessages
from artemis.bridges.names import absolute
from artemis.bridges.rosbridge.server import RosbridgeServer
from artemis.bridges.rosbridge.session import QUEUE, Message, Offer, Outgoing
from artemis.bridges.rosbridge.settings import INPUT_PORT, PortConfig
from artemis.bridges.stamps import Stamps
from artemis.bridges.topics import Told, Topics
from artemis.build import require
from artemis.config import Config
from artemis.devices.can_bus import Traffic
from artemis.errors import ConfigError
from artemis.plugins.contracts import PluginContext
from artemis.values import Tick

PORT = 9090


class RosbridgeObserverConfig(PortConfig):
    """Keys that a mission may write beside `plugin: rosbridge` under `observers`."""

    port: Annotated[int, Field(ge=0, le=65535)] = PORT
    """0: any that is free."""
    inputs: Annotated[int, Field(ge=1, le=65535)] | None = None
    """The port of an input of this mission with `plugin: rosbridge`: clients then command through this server, too."""
    every: Annotated[int, Field(ge=1, le=1000)] = 1
    """Odometry, pose, transforms and joints come each so many ticks."""
    transforms: bool = True
    """False: leave /tf and /tf_static to another program."""
    queue: Annotated[int, Field(ge=1, le=10_000)] = QUEUE
    """Messages that wait for a slow client; then the oldest are dropped."""


class RosbridgeObserver:
    """A server that tells what it sees. In a run its port is taken when it is made."""

    Config: ClassVar[type[Config]] = RosbridgeObserverConfig
    contract: ClassVar[int] = 1
    live: ClassVar[bool] = True
    own_process: ClassVar[bool] = True
    pure: ClassVar[bool] = True

    def __init__(self, config: RosbridgeObserverConfig, context: PluginContext) -> None:
        """Take the robot, and the paths that are known.

        Raises:
            ConfigError: the extra is not installed, the port is in use, this computer has no such address, or the
                mission has no such input.
        """
        require(f"{context.name}: plugin: rosbridge", "web", "websockets")
        check_listen(context.name, config.listen)
        inputs = "" if config.inputs is None else _input_at(context.name, config.inputs, context.mission)
        self._stamps, self._messages = Stamps(), JsonMessages(config.ros)
        self._topics = Topics(
            context.robot, context.routes, every=config.every, transforms=config.transforms, map=context.map
        )
        told = {absolute(topic.name): Outgoing(topic.type, topic.latched) for topic in self._topics.topics}
        self._types = {name: topic.type for name, topic in told.items()}
        services: dict[str, Callable[[Message], Message]] = {
            "/rosapi/topics": lambda _: {"topics": list(self._types), "types": list(self._types.values())},
            "/rosapi/topic_type": lambda told: {"type": self._types.get(absolute(str(told.get("topic", ""))), "")},
            "/rosapi/services": lambda _: {"services": sorted(services)},
        }
        offer = Offer(told=told, services=services, elsewhere=inputs)
        self.server: RosbridgeServer | None = None
        if context.run is not None:  # not where a mission is only checked
            listening = listening_at(context.name, config.listen, config.port)
            self.server = RosbridgeServer(context.name, listening, offer, config, queue=config.queue, inputs=inputs)
        self._complaints = Complaints(context.name, "client")
        self._begun = self._closed = False

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        """Tell of a tick."""
        if (server := self.server) is None:
            return
        stamp = self._stamps.stamp(tick.snapshot.time)
        told: list[Told] = []
        if not self._begun:
            self._begun = True
            server.start()
            told += self._topics.begin(stamp)
        wanted = {name for name in (topic.name for topic in self._topics.topics) if absolute(name) in server.wanted}
        told += self._topics.tell(tick, stamp, wanted)
        server.put([(absolute(topic.name), self._messages.pack(topic.type, content)) for topic, content in told])

    def take_problems(self) -> list[tuple[str, str, str]]:
        """That it has ended; that a client is too slow, once, and at the end how much that cost."""
        if (server := self.server) is None:
            return []
        return self._complaints.new(server.problem, server.dropped, closed=self._closed)

    def close(self) -> None:
        """Leave."""
        self._closed = True
        if self.server is not None:
            self.server.close()


def _input_at(name: str, port: int, mission: bytes) -> str:
    """The URL of the mission's input with this plugin that has a port; `name` of the observer.

    Raises:
        ConfigError: there is none.
    """
    inputs = msgspec.json.decode(mission)["inputs"].values() if mission else ()
    served = {keys.get("port", INPUT_PORT): keys.get("listen") for keys in inputs if keys["plugin"] == "rosbridge"}
    if mission and port not in served:
        ports = ", ".join(map(str, served)) or "there is none"
        raise ConfigError(f"{name}: inputs: {port} is the port of no input with plugin: rosbridge ({ports})")
    listen = served.get(port) or "127.0.0.1"
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(listen, listen)
    return f"ws://[{host}]:{port}/" if ":" in host else f"ws://{host}:{port}/"
