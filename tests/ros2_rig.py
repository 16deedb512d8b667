"""A domain of ROS 2 for one test, and a program in it that hears and says: another node of ours."""

from __future__ import annotations

import os
import queue
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from artemis.bridges.ros2.process import NodeProcess
from artemis.bridges.ros2.settings import MOST_DOMAIN, Ros2NodeConfig

LONGEST = 60.0
"""Anything takes less [s]."""
STEP = 0.02
"""Between two looks whether something holds [s]."""


@contextmanager
def own_domain() -> Iterator[int]:
    """The number of a domain that no other test uses."""
    with ExitStack() as held:
        claim = held.enter_context(socket.socket())
        for domain in (os.getpid() + step for step in range(MOST_DOMAIN)):
            try:
                claim.bind(("127.0.0.1", 7400 + 250 * (domain % MOST_DOMAIN)))
            except OSError:
                continue
            yield domain % MOST_DOMAIN
            return
        raise AssertionError("every domain is in use")


def own_address() -> str:
    """One of this computer that is not of its loopback device; empty: there is none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as tried:
        try:
            tried.connect(("192.0.2.1", 9))
        except OSError:
            return ""
        found: str = tried.getsockname()[0]
        return found


def until(holds: Callable[[], object], step: Callable[[], object] = lambda: None) -> None:
    """Take one step after the other until something holds."""
    nothing: queue.Queue[None] = queue.Queue()
    for _ in range(round(LONGEST / STEP)):
        if holds():
            return
        step()
        try:
            nothing.get(timeout=STEP)
        except queue.Empty:
            continue
    raise AssertionError("that never holds")


class Program:
    """Another program of the domain."""

    def __init__(self, domain: int, name: str = "program") -> None:
        config = Ros2NodeConfig(domain=domain, distribution="jazzy", node=name)
        self.node = NodeProcess(config, name, name, {})
        self.heard: dict[str, list[Any]] = {}
        self._numbers: dict[str, tuple[int, str]] = {}

    def hear(self, topic: str, type: str) -> None:
        heard = self.heard.setdefault(topic, [])
        self.node.subscribe(topic, type, lambda data, sender: heard.append(self.node.types.unpack(type, data)))

    def has(self, topic: str, type: str, *, reliable: bool = True) -> None:
        self._numbers[topic] = self.node.publish(topic, type, reliable=reliable), type

    def say(self, topic: str, **content: object) -> None:
        number, type = self._numbers[topic]
        self.node.put(number, self.node.types.pack(type, content))

    def meets(self, topic: str) -> bool:
        return self.node.heard(self._numbers[topic][0]) > 0

    def begin(self) -> None:
        self.node.start()
        until(lambda: self.node.state.heard or self.node.state.senders)
