"""The input `rosbridge`: commanded by velocity commands and requests of rosbridge's clients."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Annotated, ClassVar

from pydantic import Field

from artemis.bridges.json_messages import JsonMessages, full_name
from artemis.bridges.rosbridge.server import RosbridgeServer, require_websockets
from artemis.bridges.rosbridge.session import Message, Offer
from artemis.bridges.rosbridge.settings import ServerConfig
from artemis.config import Config
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.commanded import REQUESTS, CommandedInput, Ros1CommandKeys, Taker

PORT = 9091


class RosbridgeInputConfig(Ros1CommandKeys, ServerConfig):
    """Keys of an input with `plugin: rosbridge`."""

    port: Annotated[int, Field(ge=0, le=65535)] = PORT
    """0: any that is free."""


class RosbridgeInput(CommandedInput):
    """A server that is commanded."""

    Config: ClassVar[type[Config]] = RosbridgeInputConfig

    def __init__(self, config: RosbridgeInputConfig, context: PluginContext) -> None:
        """Take the robot.

        Raises:
            ConfigError: the extra is not installed, or more speed than the robot has.
        """
        require_websockets(context.name)
        super().__init__(config, context, JsonMessages(config.ros))
        self._config = config
        self.server: RosbridgeServer | None = None

    @staticmethod
    def may_share(one: RosbridgeInputConfig, other: RosbridgeInputConfig, _files: Mapping[str, bytes]) -> bool:
        """Whether both listen at one port."""
        return one.port == other.port != 0

    def close(self) -> None:
        """Leave."""
        if self.server is not None:
            self.server.close()

    def _open(self) -> None:
        heard = {f"/{topic.lstrip('/')}": (full_name(type), take) for topic, (type, take) in self._topics().items()}
        for name in self._places:
            type, take = heard[f"/{name}"]
            heard[f"/{name}"] = type, partial(self._take_pose, name, take)
        services = {f"/{name}": partial(self._answer, name) for name in self._keys.requests}
        offer = Offer(heard=heard, services=services)
        self.server = RosbridgeServer(self._config, self._name, self._config.port, offer)
        self.server.start()

    def _heard(self) -> tuple[bool, str]:
        assert self.server is not None
        return False, self.server.problem

    def _take_pose(self, name: str, take: Taker, data: bytes, sender: str) -> None:
        """Take a pose, or tell its sender why not (ValueError). Called in the server's thread."""
        try:
            self._pose(name, data)
        except ValueError as error:
            self._refuse(name, error)
            raise
        take(data, sender)

    def _answer(self, name: str, _: Message) -> Message:
        """The response of a Trigger. Called in the server's thread."""
        self._ask(REQUESTS[name])
        return {"success": True, "message": f"{name}: requested"}
