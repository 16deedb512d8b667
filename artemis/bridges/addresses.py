"""Addresses of this computer at which other programs reach artemis."""

from __future__ import annotations

import socket
from ipaddress import ip_address
from typing import Annotated

from pydantic import AfterValidator

from artemis.errors import ConfigError


def check_address(address: str) -> str:
    """An address of this computer.

    Raises:
        ValueError: it is no address.
    """
    try:
        ip_address(address)
    except ValueError:
        raise ValueError("expected an IPv4 or IPv6 address of this computer") from None
    return address


ListenAddress = Annotated[str, AfterValidator(check_address)]


def bound(address: str, port: int = 0, *, listening: bool = False, shared: bool = False) -> socket.socket:
    """A TCP socket at an address and a port; 0: any that is free. It takes connections where it is `listening`.

    A `shared` port may be bound by other processes of the same user, if they share it, too (SO_REUSEPORT, socket(7)).

    Raises:
        OSError: this computer has no such address, or the port is taken.
    """
    made = socket.socket(socket.AF_INET6 if ":" in address else socket.AF_INET, socket.SOCK_STREAM)
    try:
        if port:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if shared:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        made.bind((address, port))
        if listening:
            made.listen()
    except OSError:
        made.close()
        raise
    return made


def listening_at(plugin: str, address: str, port: int) -> socket.socket:
    """A socket at which clients connect; port 0: any that is free.

    Raises:
        ConfigError: the port is in use, or this computer has no such address. `plugin`: its name in the mission.
    """
    try:
        return bound(address, port, listening=True)
    except OSError as error:
        raise ConfigError(f"{plugin}: {address}, port {port}: {error.strerror}") from None


def check_listen(plugin: str, address: str) -> None:
    """Nothing, if this computer has the address. Nothing is left open.

    Raises:
        ConfigError: it has not. `plugin`: its name in the mission.
    """
    try:
        bound(address).close()
    except OSError as error:
        raise ConfigError(f"{plugin}: listen: {address}: {error.strerror}") from None
