"""50 Hz of odometry, transforms and joints to three subscribers over loopback: what of it is lost.

`python -m tests.peers.ros1_load --seconds 600` shows ticks to the observer `ros1`, as a run does: on schedule, through
its thread, to a process of its own.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import sys
import threading
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

sys.path.append(str(Path(__file__).parents[1] / "unit"))
import synthetic_run
from ros1_rig import Master, Peer

from artemis.bridges.ros1.tcpros import read_block
from artemis.clock import stopwatch
from artemis.mission.loading import load_model
from artemis.plugins.contracts import PluginContext
from artemis.plugins.observers.ros1 import Ros1Observer, Ros1ObserverConfig
from artemis.plugins.observing import Observation
from artemis.plugins.own_process import ObserverProcess
from artemis.values import Mode
from artemis.vehicle import RobotFile

TOPICS: Mapping[str, str] = {
    "/odom": "nav_msgs/msg/Odometry",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/joint_states": "sensor_msgs/msg/JointState",
}
SUBSCRIBERS, RATE = 3, 50
ROBOT = Path(__file__).parents[2] / "missions/robots/artemis.yaml"
LAPS = 1000
"""Of the run that is shown: more than any that is measured."""


class Heard(NamedTuple):
    """What one subscriber heard of one topic."""

    topic: str
    messages: int
    told: int

    @property
    def lost(self) -> int:
        return self.told - self.messages


def measure(seconds: float) -> list[Heard]:
    """What three subscribers hear of so many seconds' ticks."""
    master = Master()
    master.begin()
    context = PluginContext(name="ros", robot=load_model(ROBOT, RobotFile), folder=ROBOT.parent)
    process = ObserverProcess(Ros1Observer, Ros1ObserverConfig(master=master.uri), context)
    observation = Observation("ros", process, threaded=True)
    run = (observed.tick for observed in synthetic_run.run(LAPS))
    ticks = itertools.dropwhile(lambda tick: tick.mode is Mode.INIT, run)  # until then some drives have no joints
    never = threading.Event()

    def show() -> None:
        tick = next(ticks)
        observation.see(tick, (), tick.snapshot.time)

    try:
        process.wait()
        show()
        master.until(lambda: TOPICS.keys() <= master.published.keys())
        peer = Peer(master)
        links = [(topic, *peer.connect(topic)[:2]) for topic in TOPICS for _ in range(SUBSCRIBERS)]
        counts = [Count() for _ in links]
        for (_, reader, _), count in zip(links, counts, strict=True):
            asyncio.run_coroutine_threadsafe(count.hear(reader), master._loop)
        number = round(seconds * RATE)
        due = stopwatch()
        for _ in range(number):
            due += 1 / RATE
            never.wait(max(0.0, due - stopwatch()))
            show()
        with suppress(TimeoutError):  # some are lost
            master.until(lambda: all(count.number == number for count in counts))
        found = [Heard(topic, count.number, number) for (topic, _, _), count in zip(links, counts, strict=True)]
        observation.close()
        for _, _, writer in links:
            master._loop.call_soon_threadsafe(writer.transport.abort)
        print(observation.take_problems() or "no problems")
    finally:
        observation.close()
        master.close()
    return found


class Count:
    """How many messages came over a connection."""

    number = 0

    async def hear(self, reader: asyncio.StreamReader) -> None:
        """Until it ends."""
        with suppress(asyncio.IncompleteReadError, ConnectionError):
            while True:
                await read_block(reader, 1 << 20)
                self.number += 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    seconds = parser.parse_args().seconds
    found = measure(seconds)
    for heard in found:
        print(f"{heard.topic}: {heard.messages} of {heard.told} in {seconds:g} s, {heard.lost} lost")
    sys.exit(any(heard.lost for heard in found))


if __name__ == "__main__":
    main()
