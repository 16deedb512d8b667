"""An installed follower that drives well, and after a while seizes the whole host for some time."""

from __future__ import annotations

import asyncio
import ctypes
import os
import threading
import time
from typing import ClassVar, Literal

from artemis.config import Config
from artemis.motion.path import Path
from artemis.plugins.contracts import PluginContext
from artemis.plugins.followers.indiveri import IndiveriConfig, IndiveriFollower
from artemis.values import Snapshot

SEIZED = "seized"


class SeizingConfig(Config):
    speed_m_s: float
    way: Literal["loop", "lock", "interpreter"]
    """What is kept from going on: the event loop; the same by a lock that another thread holds; all of Python, by C
    code in another thread that holds the interpreter's lock."""
    after_s: float
    """From the start of the path."""
    seconds: float


class SeizingFollower(IndiveriFollower):
    Config: ClassVar[type[Config]] = SeizingConfig

    def __init__(self, config: SeizingConfig, context: PluginContext) -> None:
        super().__init__(IndiveriConfig(speed_m_s=config.speed_m_s), context)
        self._seizure = config

    def start(self, path: Path, snapshot: Snapshot) -> None:
        super().start(path, snapshot)
        way, after, seconds = self._seizure.way, self._seizure.after_s, self._seizure.seconds
        if way == "interpreter":
            threading.Thread(target=_hold_interpreter, args=(after, seconds), daemon=True).start()
        else:
            seize = _sleep if way == "loop" else _wait_for_a_lock
            asyncio.get_running_loop().call_later(after, seize, seconds)


def _sleep(seconds: float) -> None:
    os.write(1, f"{SEIZED}\n".encode())  # as it is: what a plugin prints is shown behind its name
    time.sleep(seconds)


def _hold_interpreter(after: float, seconds: float) -> None:
    time.sleep(after)
    os.write(1, f"{SEIZED}\n".encode())  # as it is: what a plugin prints is shown behind its name
    ctypes.PyDLL(None).usleep(round(seconds * 1e6))  # unlike CDLL it keeps the interpreter's lock


def _wait_for_a_lock(seconds: float) -> None:
    lock = threading.Lock()
    lock.acquire()
    os.write(1, f"{SEIZED}\n".encode())  # as it is: what a plugin prints is shown behind its name
    threading.Timer(seconds, lock.release).start()
    lock.acquire()
