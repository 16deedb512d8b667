"""The observer `foxglove`: what the robot does, live in Foxglove, as the messages of ROS that its panels know."""

from __future__ import annotations

from collections.abc import Sequence
from logging import INFO, Handler, LogRecord, getLogger
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import Field

from artemis.bridges.addresses import ListenAddress, check_listen
from artemis.bridges.complaints import Complaints
from artemis.bridges.names import absolute
from artemis.bridges.places import TakenPlace, port_place
from artemis.bridges.ros_types import Ros2Types
from artemis.bridges.stamps import Stamps
from artemis.bridges.topics import Topics
from artemis.build import require
from artemis.config import Config
from artemis.devices.can_bus import Traffic
from artemis.errors import ConfigError
from artemis.plugins.contracts import PluginContext
from artemis.values import Tick

if TYPE_CHECKING:
    from foxglove import Channel, Context
    from foxglove.websocket import ChannelView, Client

PORT = 8765
TYPES = "humble"
"""Whose types; those that are told are the same in every distribution of ROS 2."""
QUEUE = 256


class FoxgloveObserverConfig(Config):
    """Keys that a mission may write beside `plugin: foxglove` under `observers`."""

    listen: ListenAddress = "127.0.0.1"
    """The address of this computer at which Foxglove reaches artemis; 0.0.0.0: any. Who reaches it hears everything."""
    port: Annotated[int, Field(ge=0, le=65535)] = PORT
    """0: any that is free."""
    every: Annotated[int, Field(ge=1, le=1000)] = 1
    """Odometry, pose, transforms and joints come each so many ticks."""
    queue: Annotated[int, Field(ge=1, le=10_000)] = QUEUE
    """Messages that wait for a slow viewer; then the oldest are dropped."""

    def places(self, name: str) -> Sequence[TakenPlace]:
        """Its port."""
        return port_place(self.listen, self.port)


class FoxgloveObserver:
    """A server that tells what it sees. In a run its port is taken when it is made. It takes no commands."""

    Config: ClassVar[type[Config]] = FoxgloveObserverConfig
    contract: ClassVar[int] = 1
    live: ClassVar[bool] = True
    own_process: ClassVar[bool] = True
    pure: ClassVar[bool] = True

    def __init__(self, config: FoxgloveObserverConfig, context: PluginContext) -> None:
        """Take the robot, and the paths that are known.

        Raises:
            ConfigError: the extra is not installed, the port is in use, or this computer has no such address.
        """
        require(f"{context.name}: plugin: foxglove", "foxglove", "foxglove", "rosbags")
        check_listen(context.name, config.listen)
        self._stamps, self._types = Stamps(), Ros2Types(TYPES)
        self._topics = Topics(context.robot, context.routes, every=config.every, map=context.map)
        self._channels: dict[str, Channel] = {}
        self._latched: dict[str, bytes] = {}
        """The newest message of topics that are told to who comes later."""
        self._new: set[str] = set()
        """Topics that somebody has subscribed to since the last tick."""
        self._server: Any = None
        self._slow, self._complaints = _SlowViewers(), Complaints(context.name, "viewer")
        self._group: Context | None = None
        """Without it its channels are closed."""
        self._begun = False
        if context.run is not None:  # not where a mission is only checked
            self._open(config, context.name)

    @property
    def port(self) -> int:
        """Where it listens."""
        port: int = self._server.port
        return port

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        """Tell of a tick."""
        if self._server is None:
            return
        stamp = self._stamps.stamp(tick.snapshot.time)
        wanted = {name for name, channel in self._channels.items() if channel.has_sinks()}
        told = list(self._topics.tell(tick, stamp, wanted))
        if not self._begun:
            self._begun = True
            told = [*self._topics.begin(stamp), *told]
        new, self._new = self._new, set()
        for name in new & self._latched.keys():
            self._channels[name].log(self._latched[name], log_time=stamp)
        for topic, content in told:
            data = self._types.pack(topic.type, content)
            if topic.latched:
                self._latched[topic.name] = data
            self._channels[topic.name].log(data, log_time=stamp)

    def take_problems(self) -> list[tuple[str, str, str]]:
        """That a viewer is too slow, once. How many messages that cost the package does not tell."""
        return self._complaints.new("", int(self._slow.seen), closed=False)

    def close(self) -> None:
        """Leave."""
        server, self._server = self._server, None
        if server is not None:
            server.stop()
            self._slow.close()

    def _open(self, config: FoxgloveObserverConfig, name: str) -> None:
        from foxglove import Channel, Context, Schema, start_server
        from foxglove.websocket import ServerListener

        names = {absolute(topic.name): topic.name for topic in self._topics.topics}

        def subscribed(_: object, client: Client, channel: ChannelView) -> None:
            """In a thread of the package's."""
            self._new.add(names[channel.topic])

        listener = type("Listener", (ServerListener,), {"on_subscribe": subscribed})
        group = self._group = Context()
        for topic in self._topics.topics:
            schema = Schema(name=topic.type, encoding="ros2msg", data=self._types.definition(topic.type).encode())
            self._channels[topic.name] = Channel(
                absolute(topic.name), message_encoding="cdr", schema=schema, context=group
            )
        self._slow.listen()
        try:
            self._server = start_server(
                name="artemis",
                host=config.listen,
                port=config.port,
                server_listener=listener(),
                context=group,
                message_backlog_size=config.queue,
            )
        except RuntimeError as error:
            raise ConfigError(f"{name}: {config.listen}, port {config.port}: {error}") from None


class _SlowViewers(Handler):
    """Hears the package say that a viewer does not take what it is sent."""

    SAID_BY = "foxglove.websocket.connected_client.send_lossy"

    def __init__(self) -> None:
        super().__init__(INFO)
        self.seen = False

    def listen(self) -> None:
        """From now on."""
        logger = getLogger(self.SAID_BY)
        logger.setLevel(INFO)
        logger.addHandler(self)

    def emit(self, record: LogRecord) -> None:
        """In a thread of the package's, or in that which logs."""
        self.seen = True

    def close(self) -> None:
        """No more."""
        getLogger(self.SAID_BY).removeHandler(self)
        super().close()
