"""Ports that a measurement or a test may use."""

from __future__ import annotations

import socket


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """A port of this computer that nobody uses now."""
    with socket.socket(socket.AF_INET, kind) as found:
        found.bind(("", 0))
        port: int = found.getsockname()[1]
        return port
