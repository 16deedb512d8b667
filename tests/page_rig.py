"""The page without a robot: its server shows the ticks of a simulated run, and its input is read as a run reads it.

The run was computed on virtual time before, so that nothing here depends on how busy the computer is.
"""

from __future__ import annotations

import asyncio
import ssl
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar

import httpx
import pytest
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from artemis.app import Parts, run_mission
from artemis.bridges.operator.server import TlsFiles
from artemis.clock import SimulatedLoop
from artemis.config import Config
from artemis.devices.can_bus import Traffic
from artemis.mission.loading import LoadedMission, load_mission
from artemis.mission.schema import Operation
from artemis.page import paired
from artemis.page.access import key_place, new_code, read_key
from artemis.page.observer import PageObserver, PageObserverConfig
from artemis.planning import localizer_of, setup_for
from artemis.plugins.inputs.page import PageInput, PageInputConfig
from artemis.run_record import known_map
from artemis.values import OperatorInput, Tick
from artemis_lab.bench.ports import free_port

MISSIONS = Path(__file__).parents[1] / "missions"
PERIOD = 0.02
PATIENCE = 100.0
"""Longer than anything takes on a busy machine [s]."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """A run that is over."""

    loaded: LoadedMission
    ticks: list[tuple[Tick, Traffic]]

    def at(self, wanted: Callable[[Tick], bool]) -> int:
        """The number of the first such tick."""
        return next(number for number, (tick, _) in enumerate(self.ticks) if wanted(tick))


class Nobody:
    """At the page, on virtual time."""

    Config: ClassVar[type[Config]] = Config

    def read(self, now: float) -> OperatorInput:
        return OperatorInput(source="page", age=0.0)

    def close(self) -> None:
        pass


@cache
def recorded(mission: str, until: float, folder: Path) -> Recorded:
    """The first so many seconds of a run of a mission of this repository; its folder is made in `folder`."""
    loaded = load_mission(MISSIONS / mission)
    ends = loaded.mission.simulation.model_copy(update={"operator": (Operation(at_s=until, do="end"),)})
    words = {"record": str(folder), "simulation": ends, "observers": {}}
    loaded = replace(loaded, mission=loaded.mission.model_copy(update=words))
    inputs = {"page": Nobody()} if set(loaded.mission.inputs) == {"page"} else None
    ticks: list[tuple[Tick, Traffic]] = []

    def watch(tick: Tick, traffic: Traffic) -> None:
        if tick.snapshot.time <= until:
            ticks.append((tick, tuple(traffic)))

    run_mission(loaded, MISSIONS / mission, watch=watch, parts=Parts(loop=SimulatedLoop, inputs=inputs))
    return Recorded(loaded, ticks)


@dataclass
class PageRig:
    """A page that shows a recorded run."""

    run: Recorded
    port: int
    observer: PageObserver
    tls: bool = False
    samples: list[tuple[float, OperatorInput, list[tuple[str, str]]]] = field(default_factory=list)
    """What the input said, with the loop's time, and its problems."""
    place: int = 0
    playing: bool = False
    reading: bool = True
    _seen: int = 0
    _over: threading.Event = field(default_factory=threading.Event)
    _news: threading.Condition = field(default_factory=threading.Condition)

    @property
    def url(self) -> str:
        return f"http{'s' * self.tls}://127.0.0.1:{self.port}"

    def client(self, trusted: ssl.SSLContext | bool = True) -> httpx.Client:
        """A browser, as far as requests go: one that waits as long as it takes."""
        return httpx.Client(base_url=self.url, headers={"origin": self.url}, verify=trusted, timeout=PATIENCE)

    def link(
        self, client: httpx.Client, path: str, origin: str = "", trusted: ssl.SSLContext | None = None
    ) -> ClientConnection:
        """Its WebSocket."""
        return connect(
            self.url.replace("http", "ws") + path,
            additional_headers={"cookie": "; ".join(f"{name}={value}" for name, value in client.cookies.items())},
            origin=Origin(origin or self.url),
            ssl=trusted,
            open_timeout=PATIENCE,
            ping_interval=None,
        )

    def pairing(self) -> str:
        """An address that pairs one browser."""
        return f"{self.url}/pair#{new_code(read_key(key_place()))}"

    def now(self) -> float:
        """By the clock of the samples [s]."""
        return self.samples[-1][0]

    def problems(self) -> list[tuple[str, str]]:
        return [problem for _, _, problems in self.samples for problem in problems]

    def note(self, event: str, begun: float) -> float:
        """Print how long after `begun` no sample drove any more [s]: `pytest -rP` shows it."""
        stopped = next(time for time, sample, _ in self.samples if time > begun and not sample.enabled)
        print(f"{event}: no sample drives after {(stopped - begun) * 1e3:.0f} ms")
        return stopped - begun

    def wait(self, wanted: Callable[[OperatorInput], bool], patience: float = PATIENCE) -> OperatorInput:
        """The first sample that is as wanted, from the one on that was waited for before. Raises TimeoutError."""

        def found() -> bool:
            while self._seen < len(self.samples) and not wanted(self.samples[self._seen][1]):
                self._seen += 1
            return self._seen < len(self.samples)

        with self._news:
            if not self._news.wait_for(found, patience):
                raise TimeoutError(f"never; the last is {self.samples[-1]}")
            return self.samples[self._seen][1]

    def show(self, place: int) -> None:
        """Show all ticks until this one."""
        while self.place < place:
            self._see(self.place)
            self.place += 1

    def _see(self, place: int) -> None:
        tick, traffic = self.run.ticks[place]
        self.observer.see(tick, traffic, tick.snapshot.time)

    def _feed(self) -> None:
        while not self._over.wait(PERIOD):
            if self.playing and self.place + 1 < len(self.run.ticks):
                self.place += 1
            if self.reading and self.place:
                self._see(self.place)

    async def _read(self) -> None:
        loop = asyncio.get_running_loop()
        use = self.run.loaded
        context = replace(setup_for(use, f"page {self.port}"), real_time=True)
        speed = min(0.7, use.robot.limits.speed_m_s)
        device = PageInput(
            PageInputConfig(max_speed_m_s=speed, required=False, allow=("goal_pose", "initialpose")), context
        )
        try:
            while not self._over.is_set():
                device.show(self.run.ticks[self.place][0])
                sample = device.read(loop.time())
                with self._news:
                    self.samples.append((loop.time(), sample, device.take_problems()))
                    self._news.notify_all()
                await asyncio.sleep(PERIOD)
        finally:
            device.close()


def _with_input(loaded: LoadedMission, name: str) -> bytes:
    """The mission, whose input `page` has another name: several rigs are in one process."""
    text = loaded.mission.model_dump_json(by_alias=True)
    for known in ('"from_input":"page"', '"page":{"plugin":"page"'):
        text = text.replace(known, known.replace('"page"', f'"{name}"', 1))
    return text.encode()


@contextmanager
def page_rig(run: Recorded, folder: Path, tls: TlsFiles | None = None, runs: Path | None = None) -> Iterator[PageRig]:
    """The page of such a run; `runs`: the folder of past runs. The page's key is where XDG_CONFIG_HOME says."""
    loaded, port = run.loaded, free_port()
    use = localizer_of(loaded, simulated=True)
    shown = known_map(loaded, use) if use is not None and use.plugin == "scan_map" else None
    context = replace(
        setup_for(loaded, "page"),
        run=(runs or folder / "runs") / "present",
        routes=MappingProxyType(dict(loaded.routes)),
        mission=_with_input(loaded, f"page {port}"),
        map=lambda: shown,
    )
    observer = PageObserver(PageObserverConfig(port=port, tls=tls, input=f"page {port}"), context)
    rig = PageRig(run, port, observer, tls=tls is not None)
    threads = [
        threading.Thread(target=rig._feed, daemon=True),
        threading.Thread(target=lambda: asyncio.run(rig._read()), daemon=True),
    ]
    for thread in threads:
        thread.start()
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(paired, "FIRST_REQUEST", PATIENCE)  # also of a client on a busy machine
            patch.setattr(paired, "PING", PATIENCE)
            yield rig
    finally:
        rig._over.set()
        for thread in threads:
            thread.join(5.0)
        observer.close()
