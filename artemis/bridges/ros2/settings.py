"""Settings of a node of ROS 2 in a mission, and the environment variables of ROS."""

from __future__ import annotations

from collections.abc import Mapping
from ipaddress import ip_address
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from artemis.bridges.names import NameResolver, check_base_name, check_name, check_namespace
from artemis.bridges.ros_types import STORES
from artemis.config import Config

Distribution = Literal["humble", "iron", "jazzy", "kilted"]
DEFAULT_DISTRIBUTION: Distribution = "jazzy"
MOST_DOMAIN = 232
"""Beyond it ports end (docs.ros.org, "The ROS_DOMAIN_ID")."""
MOST_INDEX = 99
"""Programs on a computer that are looked for; each has two ports of the domain."""
ANNOUNCED = 0.5
"""If multicast reaches no participant, each port is asked at this interval [s]."""
_BASE, _PER_DOMAIN, _UNICAST = 7400, 250, 10


def check_ros2_name(name: str) -> str:
    """The name of a topic: absolute, relative, or private as `~/NAME`.

    Raises:
        ValueError: ROS 2 forbids it.
    """
    check_name(name)
    if "__" in name or (name.startswith("~") and not name.startswith("~/")):
        raise ValueError(f"'{name}' is no name in ROS 2: no __, and a private one begins with ~/")
    return name


def check_ipv4(address: str) -> str:
    """An address of this computer.

    Raises:
        ValueError: it is none of IPv4.
    """
    if ip_address(address).version != 4:
        raise ValueError(f"{address}: an address of IPv4 is needed here")
    return address


Ros2Name = Annotated[str, AfterValidator(check_ros2_name)]


class Ros2NodeConfig(Config):
    """Keys of a plugin that is a node of ROS 2."""

    node: Annotated[str, AfterValidator(check_base_name)] | None = None
    """Its name; if left out: artemis, for an input artemis_NAME."""
    namespace: Annotated[str, AfterValidator(check_namespace)] = "/"
    """Before every relative name."""
    remap: dict[Ros2Name, Ros2Name] = Field(default_factory=dict)
    """Other names of topics: old to new."""
    domain: Annotated[int, Field(ge=0, le=MOST_DOMAIN)] | None = None
    """If left out: ROS_DOMAIN_ID, or 0."""
    distribution: Distribution | None = None
    """That of the other programs; if left out: ROS_DISTRO, or jazzy."""
    listen: Annotated[str, AfterValidator(check_ipv4)] = "127.0.0.1"
    """The address of this computer at which other nodes reach artemis, and by whose network it finds them. Programs
    that reach it receive everything, and drive if there is an input."""

    def names(self, default: str) -> NameResolver:
        """Resolves the node's names; `default` is the node's, if the mission has none."""
        return NameResolver(self.node or default, self.namespace, self.remap)

    def domain_id(self, environment: Mapping[str, str]) -> int:
        """The domain.

        Raises:
            ValueError: ROS_DOMAIN_ID is none.
        """
        if self.domain is not None:
            return self.domain
        text = environment.get("ROS_DOMAIN_ID") or "0"
        if not (text.isascii() and text.isdigit() and int(text) <= MOST_DOMAIN):
            raise ValueError(f"ROS_DOMAIN_ID: '{text}' is no domain: a number from 0 to {MOST_DOMAIN}")
        return int(text)

    def peers(self, environment: Mapping[str, str]) -> str:
        """The distribution of the other programs.

        Raises:
            ValueError: ROS_DISTRO is one whose types are not known.
        """
        name = self.distribution or environment.get("ROS_DISTRO") or DEFAULT_DISTRIBUTION
        if name not in STORES:
            raise ValueError(f"ROS_DISTRO: '{name}' is not known: write `distribution:`, one of {', '.join(STORES)}")
        return name

    @property
    def local(self) -> bool:
        """Only programs of this computer are met."""
        return ip_address(self.listen).is_loopback


def unicast_ports(domain: int) -> tuple[int, int]:
    """The first and the last port at which programs of a domain are met (RTPS 9.6.1.1)."""
    first = _BASE + _PER_DOMAIN * domain + _UNICAST
    return first, first + 2 * _most_index(domain) + 1


def _most_index(domain: int) -> int:
    first = _BASE + _PER_DOMAIN * domain + _UNICAST
    return min(MOST_INDEX, (65535 - first - 1) // 2)


def cyclone_configuration(address: str, domain: int, *, local: bool) -> str:
    """The configuration of Cyclone DDS (its options.md).

    The loopback device knows no multicast: there every port at which a program of this computer may be is asked,
    again and again.
    """
    multicast = "false" if local else "default"
    most = _most_index(domain)
    finding = f"<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>{most}</MaxAutoParticipantIndex>"
    if local:
        finding += f"<SPDPInterval>{ANNOUNCED:g}s</SPDPInterval>"
        finding += f'<Peers><Peer Address="{address}" PruneDelay="inf"/></Peers>'
    return (
        f'<CycloneDDS><Domain Id="any"><General><Interfaces><NetworkInterface address="{address}"/></Interfaces>'
        f"<AllowMulticast>{multicast}</AllowMulticast></General><Discovery>{finding}</Discovery>"
        "<Tracing><Verbosity>none</Verbosity></Tracing></Domain></CycloneDDS>"
    )
