"""The page without a robot: its server shows the ticks of a simulated run, and its input is read as a run reads it.

The run was computed on virtual time before, so that nothing here depends on how busy the computer is.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from types import MappingProxyType

from ports import free_port

from artemis.app import Parts, run_mission
from artemis.clock import SimulatedLoop
from artemis.devices.can_bus import Traffic
from artemis.mission.loading import LoadedMission, load_mission
from artemis.mission.schema import Operation
from artemis.page.access import key_place, new_code, read_key
from artemis.page.observer import PageObserver, PageObserverConfig, PageTls
from artemis.planning import localizer_of, setup_for
from artemis.plugins.inputs.page import PageInput, PageInputConfig
from artemis.run_record import known_map
from artemis.values import OperatorInput, Tick

MISSIONS = Path(__file__).parents[1] / "missions"
PERIOD = 0.02


@dataclass(frozen=True, slots=True)
class Recorded:
    """A run that is over."""

    loaded: LoadedMission
    ticks: list[tuple[Tick, Traffic]]

    def at(self, wanted: Callable[[Tick], bool]) -> int:
        """The number of the first such tick."""
        return next(number for number, (tick, _) in enumerate(self.ticks) if wanted(tick))


@cache
def recorded(mission: str, until: float, folder: Path) -> Recorded:
    """The first so many seconds of a run of a mission of this repository; its folder is made in `folder`."""
    loaded = load_mission(MISSIONS / mission)
    ends = loaded.mission.simulation.model_copy(update={"operator": (Operation(at_s=until, do="end"),)})
    loaded = replace(loaded, mission=loaded.mission.model_copy(update={"record": str(folder), "simulation": ends}))
    ticks: list[tuple[Tick, Traffic]] = []

    def watch(tick: Tick, traffic: Traffic) -> None:
        if tick.snapshot.time <= until:
            ticks.append((tick, tuple(traffic)))

    run_mission(loaded, MISSIONS / mission, watch=watch, parts=Parts(loop=SimulatedLoop))
    return Recorded(loaded, ticks)


@dataclass
class PageRig:
    """A page that shows a recorded run."""

    run: Recorded
    port: int
    observer: PageObserver
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
        return f"http://127.0.0.1:{self.port}"

    def pairing(self) -> str:
        """An address that pairs one browser."""
        return f"{self.url}/pair#{new_code(read_key(key_place()))}"

    def now(self) -> float:
        """By the clock of the samples [s]."""
        return self.samples[-1][0]

    def problems(self) -> list[tuple[str, str]]:
        return [problem for _, _, problems in self.samples for problem in problems]

    def note(self, event: str, begun: float) -> None:
        """Print how long after `begun` no sample drove any more: `pytest -rP` shows it."""
        stopped = next(time for time, sample, _ in self.samples if time > begun and not sample.enabled)
        print(f"{event}: no sample drives after {(stopped - begun) * 1e3:.0f} ms")

    def wait(self, wanted: Callable[[OperatorInput], bool], patience: float = 20.0) -> OperatorInput:
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
        device = PageInput(PageInputConfig(max_speed_m_s=0.7, required=False), context)
        try:
            while not self._over.is_set():
                sample = device.read(loop.time())
                with self._news:
                    self.samples.append((loop.time(), sample, device.take_problems()))
                    self._news.notify_all()
                await asyncio.sleep(PERIOD)
        finally:
            device.close()


@contextmanager
def page_rig(run: Recorded, folder: Path, tls: PageTls | None = None, runs: Path | None = None) -> Iterator[PageRig]:
    """The page of such a run; `runs`: the folder of past runs. The page's key is where XDG_CONFIG_HOME says."""
    loaded, port = run.loaded, free_port()
    use = localizer_of(loaded, simulated=True)
    shown = known_map(loaded, use) if use is not None and use.plugin == "scan_map" else None
    context = replace(
        setup_for(loaded, "page"),
        run=(runs or folder / "runs") / "present",
        routes=MappingProxyType(dict(loaded.routes)),
        mission=loaded.mission.model_dump_json(by_alias=True).encode(),
        map=lambda: shown,
    )
    observer = PageObserver(PageObserverConfig(port=port, tls=tls, input=f"page {port}"), context)
    rig = PageRig(run, port, observer)
    threads = [
        threading.Thread(target=rig._feed, daemon=True),
        threading.Thread(target=lambda: asyncio.run(rig._read()), daemon=True),
    ]
    for thread in threads:
        thread.start()
    try:
        yield rig
    finally:
        rig._over.set()
        for thread in threads:
            thread.join(5.0)
        observer.close()
