"""Settings of a server of rosbridge in a mission."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field

from artemis.bridges.addresses import ListenAddress
from artemis.bridges.places import TakenPlace, port_place
from artemis.config import Config

INPUT_PORT = 9091
"""Of an input, if the mission has none."""


def check_origin(origin: str) -> str:
    """The origin of a page, as a browser sends it.

    Raises:
        ValueError: it is nothing of that kind.
    """
    parts = urlsplit(origin)
    if origin != "null" and (parts.scheme not in ("http", "https") or not parts.netloc or parts.path):
        raise ValueError(f"'{origin}' is no origin of a web page: http://HOST:PORT, or null for a page from a file")
    return origin


class ServerConfig(Config):
    """Keys of a plugin that is a server of rosbridge."""

    listen: ListenAddress = "127.0.0.1"
    """The address of this computer at which others reach artemis; 0.0.0.0: any. Programs that reach
    it receive everything, and drive if there is an input."""
    origins: Annotated[tuple[Annotated[str, AfterValidator(check_origin)], ...], Field(strict=False)] = ()
    """Web pages that may connect, by where they are from, such as http://localhost:8000. Other programs always may."""
    ros: Literal[1, 2] = 2
    """Field names of the parts of a time: secs and nsecs of ROS 1, or sec and nanosec."""


class PortConfig(ServerConfig):
    """Likewise, with its port."""

    port: Annotated[int, Field(ge=0, le=65535)]
    """0: any that is free."""

    def places(self, name: str) -> Sequence[TakenPlace]:
        """Its port."""
        return port_place(self.listen, self.port)
