"""50 Hz of odometry, transforms and joints to three readers over loopback: what of it is lost.

`python -m tests.peers.bridge_load ros1|ros2|rosbridge --seconds 600` shows ticks to the observer of that name, as a run
does: on schedule, through its thread, to a process of its own.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import json
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

sys.path += [str(Path(__file__).parents[1] / folder) for folder in ("unit", ".")]
import synthetic_run
from ros1_rig import Master, Peer
from ros2_rig import Program, own_domain

from artemis.bridges.ros1.tcpros import read_block
from artemis.clock import stopwatch
from artemis.config import Config
from artemis.mission.loading import load_model
from artemis.plugins.contracts import Observer, PluginContext
from artemis.plugins.observers.ros1 import Ros1Observer, Ros1ObserverConfig
from artemis.plugins.observers.ros2 import Ros2Observer, Ros2ObserverConfig
from artemis.plugins.observers.rosbridge import RosbridgeObserver, RosbridgeObserverConfig
from artemis.plugins.observing import Observation
from artemis.plugins.own_process import ObserverProcess
from artemis.values import Mode
from artemis.vehicle import RobotFile
from artemis_lab.bench.ports import free_port

TOPICS: Mapping[str, str] = {
    "/odom": "nav_msgs/msg/Odometry",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/joint_states": "sensor_msgs/msg/JointState",
}
READERS, RATE = 3, 50
ROBOT = Path(__file__).parents[2] / "missions/robots/artemis.yaml"
LAPS = 1000
"""Of the run that is shown: more than any that is measured."""
LONGEST, STEP = 20.0, 0.02
"""Readers have so long to connect, and to hear the last message; between two looks [s]."""


class Told(NamedTuple):
    """What one reader heard of one topic."""

    topic: str
    messages: int
    told: int

    @property
    def lost(self) -> int:
        return self.told - self.messages


class Readers(ABC):
    """Three that hear each topic; `counts` has how many messages came, by reader and topic."""

    plugin: Callable[[Any, PluginContext], Observer]

    def __init__(self) -> None:
        self.counts = {(reader, topic): 0 for reader in range(READERS) for topic in TOPICS}

    @abstractmethod
    def config(self) -> Config:
        """Keys of the observer."""

    @abstractmethod
    def connect(self, ends: ExitStack) -> bool:
        """Begin to hear, if that can be yet; what is to be closed goes to `ends`."""

    def count(self, reader: int, topic: str) -> None:
        """A message came."""
        self.counts[reader, topic] += 1


class Ros1Readers(Readers):
    """Subscribers of ROS 1, on the connections that TCPROS has."""

    plugin = Ros1Observer

    def __init__(self, ends: ExitStack) -> None:
        super().__init__()
        self._master = Master()
        ends.callback(self._master.close)
        self._master.begin()

    def config(self) -> Config:
        return Ros1ObserverConfig(master=self._master.uri)

    def connect(self, ends: ExitStack) -> bool:
        if not TOPICS.keys() <= self._master.published.keys():
            return False
        loop = self._master._loop
        for number, topic in self.counts:
            stream, writer, _ = Peer(self._master).connect(topic)
            asyncio.run_coroutine_threadsafe(self._hear(number, topic, stream), loop)
            ends.callback(loop.call_soon_threadsafe, writer.transport.abort)
        return True

    async def _hear(self, number: int, topic: str, stream: asyncio.StreamReader) -> None:
        with suppress(asyncio.IncompleteReadError, ConnectionError):
            while True:
                await read_block(stream, 1 << 20)
                self.count(number, topic)


class Ros2Readers(Readers):
    """Nodes of ROS 2, each a process."""

    plugin = Ros2Observer

    def __init__(self, ends: ExitStack) -> None:
        super().__init__()
        self._domain = ends.enter_context(own_domain())

    def config(self) -> Config:
        return Ros2ObserverConfig(domain=self._domain, distribution="jazzy")

    def connect(self, ends: ExitStack) -> bool:
        for number in range(READERS):
            node = Program(self._domain, f"reader{number}").node
            for topic, type in TOPICS.items():
                node.subscribe(topic, type, lambda data, sender, at=(number, topic): self.count(*at), depth=100)  # type: ignore[misc]
            node.start()
            ends.callback(node.close)
        return True


class RosbridgeReaders(Readers):
    """Clients of rosbridge."""

    plugin = RosbridgeObserver

    def __init__(self, ends: ExitStack) -> None:
        super().__init__()
        self._port = free_port()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._over: list[asyncio.Task[None]] = []
        ends.callback(self._end)

    def config(self) -> Config:
        return RosbridgeObserverConfig(port=self._port)

    def connect(self, ends: ExitStack) -> bool:
        for number in range(READERS):
            asyncio.run_coroutine_threadsafe(self._hear(number), self._loop)
        return True

    async def _hear(self, number: int) -> None:
        from websockets.asyncio.client import connect
        from websockets.exceptions import ConnectionClosed

        async with connect(f"ws://127.0.0.1:{self._port}", compression=None, proxy=None) as link:
            for topic in TOPICS:
                await link.send(json.dumps({"op": "subscribe", "topic": topic}))
            with suppress(ConnectionClosed):
                async for text in link:
                    self.count(number, json.loads(text)["topic"])

    def _end(self) -> None:
        async def end() -> None:
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)

        asyncio.run_coroutine_threadsafe(end(), self._loop).result(LONGEST)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


OF: Mapping[str, Callable[[ExitStack], Readers]] = {
    "ros1": Ros1Readers,
    "ros2": Ros2Readers,
    "rosbridge": RosbridgeReaders,
}


def measure(of: str, seconds: float) -> list[Told]:
    """What three readers hear of so many seconds' ticks."""
    run = (observed.tick for observed in synthetic_run.run(LAPS))
    ticks = itertools.dropwhile(lambda tick: tick.mode is Mode.INIT, run)  # until then some drives have no joints
    never = threading.Event()
    with ExitStack() as ends:
        folder = Path(ends.enter_context(TemporaryDirectory()))
        readers = OF[of](ends)
        context = PluginContext(name="bridge", robot=load_model(ROBOT, RobotFile), folder=folder, run=folder)
        process = ObserverProcess(readers.plugin, readers.config(), context)
        observation = Observation("bridge", process, threaded=True)
        ends.callback(observation.close)

        def show() -> None:
            tick = next(ticks)
            observation.see(tick, (), tick.snapshot.time)

        def until(holds: Callable[[], object], step: Callable[[], object]) -> None:
            for _ in range(round(LONGEST / STEP)):
                if holds():
                    return
                step()
                never.wait(STEP)

        process.wait()
        until(lambda: readers.connect(ends), show)
        until(lambda: min(readers.counts.values()) > 0, show)  # from now on nothing may be lost
        before = heard_before(readers, never)
        number = round(seconds * RATE)
        due = stopwatch()
        for _ in range(number):
            due += 1 / RATE
            never.wait(max(0.0, due - stopwatch()))
            show()
        until(lambda: all(count - before[at] == number for at, count in readers.counts.items()), lambda: None)
        found = [Told(at[1], count - before[at], number) for at, count in readers.counts.items()]
        observation.close()
        print(observation.take_problems() or "no problems")
        return found


def heard_before(readers: Readers, never: threading.Event) -> dict[tuple[int, str], int]:
    """The counts once nothing more comes of what was shown so far."""
    before: dict[tuple[int, str], int] = {}
    while before != (before := dict(readers.counts)):
        never.wait(1.0)
    return before


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("of", choices=OF)
    parser.add_argument("--seconds", type=float, default=600.0)
    arguments = parser.parse_args()
    found = measure(arguments.of, arguments.seconds)
    for told in found:
        print(f"{told.topic}: {told.messages} of {told.told} in {arguments.seconds:g} s, {told.lost} lost")
    sys.exit(any(told.lost for told in found))


if __name__ == "__main__":
    main()
