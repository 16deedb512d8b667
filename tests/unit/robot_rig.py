"""A robot with a scripted decision core on a fake bus, on virtual time: a rig for tests of its loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, ClassVar

from core_builders import PERIOD, ROBOT, FakeBus, snapshot
from msgspec.structs import replace

from artemis.clock import SimulatedLoop, run
from artemis.config import Config
from artemis.devices.can_bus import Frame
from artemis.devices.device import Device, DeviceGroup
from artemis.devices.drive import Drives
from artemis.plugins.contracts import Localizer
from artemis.plugins.guard import PluginGuard
from artemis.robot import Core, Robot
from artemis.states.mode import ON
from artemis.values import Job, JobResult, Mode, OperatorInput, Request, Sensed, SetPoints, Tick, Wish

ENABLED = bytes.fromhex("37 03 00 00 00 00")
SYNC, HEARTBEAT = 0x080, 0x77F
EMERGENCY = Frame(0x083, bytes.fromhex("10 23 02 00 00 00 00 00"))


class ScriptedCore(Core):
    """Wishes what a script says."""

    def __init__(self, script: Callable[[Sensed], Wish]) -> None:
        self.seen: list[Sensed] = []
        self.script = script

    def decide(self, sensed: Sensed) -> Tick:
        self.seen.append(sensed)
        wish = self.script(sensed)
        seen = replace(snapshot(), sensed=sensed)
        return Tick(snapshot=seen, mode=Mode.READY, wish=wish, set_points=SetPoints())


class SlowDrives(Drives):
    """Their jobs take as many seconds as the job's value says."""

    async def perform(self, job: Job) -> JobResult:
        if job.value < 0:
            raise ZeroDivisionError("in a job")
        await asyncio.sleep(job.value)
        return JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=True)


class StubInput:
    """Reads what the test says."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, answer: Callable[[float], Any]) -> None:
        self.answer = answer

    def read(self, now: float) -> OperatorInput:
        sample: OperatorInput = self.answer(now)
        return sample

    def close(self) -> None: ...


class Rig:
    """A robot with a scripted decision core on a fake bus."""

    def __init__(self, script: Callable[[Sensed], Wish] = lambda sensed: ON, **inputs: Callable[[float], Any]) -> None:
        self.core = ScriptedCore(script)
        self.bus = FakeBus()
        self.inputs = {name: StubInput(answer) for name, answer in inputs.items()}
        self.observe: Callable[[Tick], None] = lambda tick: None
        self.sensors: list[Device] = []
        self.attended: Callable[[float], tuple[bool, bool]] = lambda time: (False, False)
        self.acts: list[tuple[float, Callable[[], None]]] = []
        self.begins = 0.0
        """The loop's time [s] when the run begins."""
        self.localizer: Localizer | None = None
        self.robot: Robot
        self.loop: SimulatedLoop

    def at(self, time: float, act: Callable[[], None]) -> None:
        self.acts.append((time, act))

    def run(self, seconds: float = 0.2) -> Rig:
        """Run for so long, or until the script says that it has finished."""
        run(self._main(seconds), simulated=True)
        return self

    async def _main(self, seconds: float) -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, SimulatedLoop)
        self.loop, self.bus.clock = loop, loop.time
        self.bus.arrived = [Frame(0x181 + node, ENABLED) for node in range(4)]
        devices = DeviceGroup(tuple(ROBOT.drives), [SlowDrives(ROBOT, self.bus)], self.sensors)
        guard = PluginGuard(self.inputs, loop.time, self.localizer)
        self.robot = Robot(
            self.core, devices, guard, PERIOD, lambda tick: self.observe(tick), lambda time: self.attended(time)
        )
        for time, act in self.acts:
            loop.call_at(time, act)
        script = self.core.script

        def until_the_end(sensed: Sensed) -> Wish:
            wish = script(sensed)
            return replace(wish, finished=True) if sensed.time > seconds - PERIOD / 2 else wish

        self.core.script = until_the_end
        await asyncio.sleep(self.begins)
        await self.robot.run()

    def hear(self, *frames: Frame) -> Callable[[], None]:
        def arrive() -> None:
            self.bus.arrived += frames
            self.bus.wake()

        return arrive

    def request(self, request: Request) -> Callable[[], None]:
        return lambda: self.robot.request(request)

    @property
    def scheduled(self) -> list[float]:
        return [sensed.time for sensed in self.core.seen if not sensed.urgent]

    @property
    def urgent(self) -> list[Sensed]:
        return [sensed for sensed in self.core.seen if sensed.urgent]

    def collected(self, field: str) -> list[Any]:
        return [item for sensed in self.core.seen for item in getattr(sensed, field)]

    def faults(self) -> list[tuple[float, str, str]]:
        return [(round(s.time, 6), fault.id, fault.device) for s in self.core.seen for fault in s.faults]
