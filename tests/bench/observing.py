"""What a tick pays for all its observers, at 50 Hz: each time for a processor that has slept meanwhile."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from threading import Event
from unittest.mock import patch

from artemis.clock import stopwatch
from artemis.errors import ConfigError
from artemis.mission.actions import PluginUse
from artemis.mission.loading import plugin_from
from artemis.planning import made
from artemis.plugins.contracts import PluginContext
from artemis.plugins.observing import Beside, Observation
from artemis.plugins.own_process import ObserverProcess
from artemis.plugins.registry import OBSERVERS, names
from artemis.plugins.stated import has_own_process
from artemis.testing.contracts import ROBOT
from artemis.testing.observers import ObserverContract
from artemis.values import Tick
from artemis_lab.bench.ports import free_port

from .measure import Row, microseconds, middle_and_tail

PERIOD = 0.02
DOMAIN = 231
"""Of ROS 2."""


def rows() -> list[Row]:
    """The row of the table."""
    contract = ObserverContract()
    contract.duration = 6.0
    with ExitStack() as ends:
        observers = every_observer(ends)
        number = len(observers)
        woken: list[Beside[Tick]] = [Beside("woken", lambda tick: None, threaded=True) for _ in range(number)]
        ours: list[float] = []
        peers: list[float] = []
        never, deadline = Event(), stopwatch()
        for tick in contract.ticks():
            for peer, times in ((False, ours), (True, peers)):  # half a tick between them: both begin after a sleep
                deadline += PERIOD / 2
                never.wait(max(0.0, deadline - stopwatch()))
                begun = stopwatch()
                if peer:
                    for beside in woken:
                        beside.put(tick)
                else:
                    for observer in observers:
                        observer.see(tick, (), tick.snapshot.time)
                        observer.take_problems()
                times.append(stopwatch() - begun)
        for beside in woken:
            beside.close()
    wake = median(peers)
    return [
        Row(
            name=f"all {number} observers at 50 Hz: what a tick hands over",
            measured=middle_and_tail(ours),
            budget="<= 30 us",
            held=median(ours) <= 30e-6,
            peer=f"waking {number} threads: {microseconds(wake)} ({median(ours) / wake:.2f} x)",
        )
    ]


def every_observer(ends: ExitStack) -> list[Observation]:
    """Those that are installed, at work as in a run: in threads, and most in processes of their own."""
    folder = Path(ends.enter_context(TemporaryDirectory()))
    ends.enter_context(patch.dict(os.environ, XDG_CONFIG_HOME=str(folder)))
    keys: Mapping[str, dict[str, object]] = {
        "ros1": {"master": f"http://127.0.0.1:{free_port()}"},
        "ros2": {"domain": DOMAIN},
        "rosbridge": {"port": 0},
        "foxglove": {"port": 0},
        "page": {"port": free_port()},
    }
    context = PluginContext(name="", robot=ROBOT, folder=folder, run=folder)
    begun: list[tuple[Observation, ObserverProcess | None]] = []
    for name in names(OBSERVERS):
        plugin, config = plugin_from(OBSERVERS, PluginUse.model_validate({"plugin": name, **keys.get(name, {})}))
        own, given = has_own_process(plugin), replace(context, name=name)
        observer = ObserverProcess(plugin, config, given) if own else made(plugin, config, given)
        begun.append((Observation(name, observer, threaded=True), observer if own else None))
        ends.callback(begun[-1][0].close)
    working = []
    for observation, process in begun:  # they begin at the same time
        try:
            if process is not None:
                process.wait()
        except ConfigError as error:
            print(f"not measured: {error}")
            continue
        working.append(observation)
    return working
