"""Names of nodes, topics and services, as ROS resolves them (wiki.ros.org/Names, "Remapping Arguments")."""

from __future__ import annotations

import re
from collections.abc import Mapping

_BASE = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_NAME = re.compile(r"(?:/|~/?|)(?:[A-Za-z][A-Za-z0-9_]*/)*[A-Za-z][A-Za-z0-9_]*")
_FORBIDDEN = re.compile(r"[^A-Za-z0-9_]")
RULE = "letters, digits and _, from a letter on; / between parts, in front for an absolute name, ~ for a private one"


def check_base_name(name: str) -> str:
    """The name of a node itself.

    Raises:
        ValueError: ROS forbids it.
    """
    if not _BASE.fullmatch(name):
        raise ValueError(f"'{name}' is no name of a node: letters, digits and _, from a letter on")
    return name


def check_name(name: str) -> str:
    """The name of a topic or a service; absolute, relative or private.

    Raises:
        ValueError: ROS forbids it.
    """
    if not _NAME.fullmatch(name):
        raise ValueError(f"'{name}' is no name in ROS: {RULE}")
    return name


def check_namespace(name: str) -> str:
    """A namespace: `/`, or a name that is not private.

    Raises:
        ValueError: ROS forbids it.
    """
    stripped = name.strip("/")
    if "~" in name or (stripped and not _NAME.fullmatch(stripped)):
        raise ValueError(f"'{name}' is no namespace in ROS: {RULE}")
    return "/" + stripped


def part_of_name(text: str) -> str:
    """Any text as part of a name: what ROS forbids becomes `_`."""
    text = _FORBIDDEN.sub("_", text)
    return text if _BASE.fullmatch(text) else f"n{text}"


def absolute(name: str) -> str:
    """The absolute name of one in the namespace `/`."""
    return "/" + name.lstrip("/")


class NameResolver:
    """Resolves the names that one node uses."""

    def __init__(self, node: str, namespace: str = "/", remap: Mapping[str, str] | None = None) -> None:
        """`remap`: what is used instead of a name; both are resolved, so `odom: /base/odom` meets every `odom`."""
        self._namespace = check_namespace(namespace)
        self.node = self._absolute(check_base_name(node))
        """The node's own name, absolute."""
        pairs = (remap or {}).items()
        self._remap = {self._absolute(check_name(old)): self._absolute(check_name(new)) for old, new in pairs}

    def resolve(self, name: str) -> str:
        """The absolute name that `name` means.

        Raises:
            ValueError: ROS forbids it.
        """
        absolute = self._absolute(check_name(name))
        return self._remap.get(absolute, absolute)

    def _absolute(self, name: str) -> str:
        if name.startswith("/"):
            return name
        if name.startswith("~"):
            return f"{self.node}/{name[1:].lstrip('/')}"
        return f"{self._namespace.rstrip('/')}/{name}"
