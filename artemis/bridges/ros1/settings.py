"""Settings of a node of ROS 1 in a mission, and the environment variables (wiki.ros.org/ROS/EnvironmentVariables)."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from ipaddress import ip_address
from typing import Annotated, ClassVar
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field

from artemis.bridges.addresses import ListenAddress, check_listen
from artemis.bridges.names import NameResolver, check_base_name, check_name, check_namespace
from artemis.bridges.places import TakenPlace
from artemis.config import Config
from artemis.errors import ConfigError

DEFAULT_MASTER = "http://localhost:11311"


def check_master(uri: str) -> str:
    """The URI of a master.

    Raises:
        ValueError: it is none.
    """
    parts = urlsplit(uri)
    if parts.scheme != "http" or not parts.hostname or parts.port is None:
        raise ValueError(f"'{uri}' is no URI of a master: http://HOST:PORT, such as {DEFAULT_MASTER}")
    return uri


GraphName = Annotated[str, AfterValidator(check_name)]


class NodeConfig(Config):
    """Keys of a plugin that is a node of ROS 1."""

    node: Annotated[str, AfterValidator(check_base_name)] | None = None
    """Its name; if left out: artemis, for an input artemis_NAME."""
    namespace: Annotated[str, AfterValidator(check_namespace)] | None = None
    """Before every relative name; if left out: ROS_NAMESPACE, or /."""
    remap: dict[GraphName, GraphName] = Field(default_factory=dict)
    """Other names of topics and services: old to new."""
    master: Annotated[str, AfterValidator(check_master)] | None = None
    """If left out: ROS_MASTER_URI, or http://localhost:11311."""
    listen: ListenAddress = "127.0.0.1"
    """The address of this computer at which other nodes reach artemis; 0.0.0.0: any. Other nodes get ROS_HOSTNAME or
    ROS_IP, if this is not the loopback address. Programs that reach it receive all, and drive by an input."""

    default_node: ClassVar[str] = "artemis"
    """The node's name, if the mission has none; {} is the plugin's."""

    def checked(self, plugin: str, environment: Mapping[str, str] = os.environ) -> tuple[NameResolver, str]:
        """What resolves the node's names, and the URI of its master. Nothing is left open.

        Args:
            plugin: its name in the mission.
            environment: variables of ROS.

        Raises:
            ConfigError: a variable is wrong, or this computer has no such address.
        """
        names, master = self._resolved(plugin, environment)
        check_listen(plugin, self.listen)
        return names, master

    def places(self, plugin: str) -> Sequence[TakenPlace]:
        """A master knows a node only once: the earlier one is asked to leave."""
        try:
            names, master = self._resolved(plugin, os.environ)
        except ConfigError:  # that is complained of elsewhere
            return ()
        return (TakenPlace("node", f"the node {names.node} of ROS 1", master),)

    def _resolved(self, plugin: str, environment: Mapping[str, str]) -> tuple[NameResolver, str]:
        node = self.node or self.default_node.format(plugin)
        try:
            namespace = self.namespace or _variable("ROS_NAMESPACE", environment)
            return NameResolver(node, namespace, self.remap), self.master or _variable("ROS_MASTER_URI", environment)
        except ValueError as error:
            raise ConfigError(f"{plugin}: {error}") from None

    def host(self, environment: Mapping[str, str], this: str) -> str:
        """The name or address that others get; `this` computer's name, if it listens at any address."""
        listening = ip_address(self.listen)
        if listening.is_loopback:
            return self.listen
        told = environment.get("ROS_HOSTNAME") or environment.get("ROS_IP")
        return told or (this if listening.is_unspecified else self.listen)


_VARIABLES: Mapping[str, tuple[str, Callable[[str], str]]] = {
    "ROS_NAMESPACE": ("/", check_namespace),
    "ROS_MASTER_URI": (DEFAULT_MASTER, check_master),
}


def _variable(name: str, environment: Mapping[str, str]) -> str:
    """One of ROS' variables, or its default. Raises ValueError: it is wrong."""
    default, check = _VARIABLES[name]
    try:
        return check(environment.get(name) or default)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None
