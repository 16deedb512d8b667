"""An operator whose hand is a program: reports at known times, and now and then a flood. A process of its own."""

from __future__ import annotations

import asyncio
import json
import random
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar, cast

from msgspec.structs import replace

from artemis.bridges.operator.pairing import read_secret
from artemis.bridges.operator.status import RobotStatus
from artemis.clock import stopwatch, until
from artemis.commands.operator import DeviceChoice
from artemis.commands.operator_drive import OperatorDrive, _RobotProtocol
from artemis.commands.operator_view import OperatorView
from artemis.config import Config
from artemis.errors import DeviceLost
from artemis.plugins.contracts import InputDevice, PluginContext
from artemis.values import OperatorInput, Request

SLOW, FAST = 0.1, 0.3
"""Speeds between which the hand changes [m/s]."""
SOON, LATE = 0.15, 0.4
"""From one report to the next [s]."""
FLOOD = 10_000
"""Frames a second."""
WINDOW = 2.0
"""Flood and quiet alternate [s]."""
SETTLE = 0.5
"""The hand waits so long before it presses [s]."""


class Hand:
    """A device in memory."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, seconds: float, seed: int) -> None:
        self.reports: list[tuple[float, float]] = []
        """Time, and the speed from then on."""
        self.told: RobotStatus | None = None
        self._seconds, self._random = seconds, random.Random(seed)
        self._begun: float | None = None
        self._next, self._speed = 0.0, SLOW

    def read(self, now: float) -> OperatorInput:
        """What is held now."""
        time = stopwatch()
        if self.told is None or self.told.mode != "teleop":
            return OperatorInput(source="hand", age=0.0)
        if self._begun is None:
            self._begun, self._next = time + SETTLE, time + SETTLE
        if time - self._begun > self._seconds:
            return OperatorInput(source="hand", age=0.0, requests=(Request.DONE,))
        while time >= self._next:
            self._speed = SLOW if self._speed == FAST else FAST
            self.reports.append((self._next, self._speed))
            self._next += self._random.uniform(SOON, LATE)
        held = time >= self._begun
        return OperatorInput(
            source="hand", age=0.0, speed=self._speed if held else 0.0, enabled=held, neutral=not held, axes=(0.0,)
        )

    def close(self) -> None:
        """Nothing is open."""


class _Choice(DeviceChoice):
    """That hand."""

    hand: ClassVar[Hand]

    def made(self, context: PluginContext) -> InputDevice:
        return cast(InputDevice, self.hand)


class _View(OperatorView):
    """Tells the hand."""

    def __init__(self, hand: Hand) -> None:
        super().__init__()
        self._hand = hand

    def see(self, status: RobotStatus) -> None:
        self._hand.told = status


class _Flooding(OperatorDrive):
    """Drives, and floods in between."""

    def __init__(self, *place: Any, hand: Hand, flood: bool) -> None:  # noqa: ANN401 (as `OperatorDrive` takes)
        super().__init__(*place)
        self._view, self._hand, self._flood = _View(hand), hand, flood
        self.floods: list[tuple[float, float]] = []
        """From when to when."""

    async def _first(self) -> _RobotProtocol:
        """The run may not listen yet."""
        loop = asyncio.get_running_loop()
        while True:
            with suppress(DeviceLost):
                return await super()._first()
            await until(loop.time() + 0.1)

    async def _session(self, protocol: _RobotProtocol) -> str:
        flooding = asyncio.ensure_future(self._pour(protocol))
        try:
            return await super()._session(protocol)
        finally:
            flooding.cancel()

    async def _pour(self, protocol: _RobotProtocol) -> None:
        loop = asyncio.get_running_loop()
        while self._flood:
            await until(loop.time() + WINDOW)
            if not self._hand.reports:
                continue
            begun, sent = stopwatch(), 0
            while (passed := stopwatch() - begun) < WINDOW:
                sample = replace(self._hand.read(0.0), requests=())
                while sent < passed * FLOOD:
                    protocol.end.command(sample, loop.time())
                    sent += 1
                protocol.flush()
                await until(loop.time() + 0.001)
            self.floods.append((begun, stopwatch()))


def main(port: str, secret: str, out: str, seconds: str, seed: str, flood: str) -> None:
    """OperatorDrive the robot on this computer, and write down when what was done."""
    hand = Hand(float(seconds), int(seed))
    _Choice.hand = hand
    drive = _Flooding(
        "127.0.0.1", int(port), read_secret(Path(secret)), None, "hand", _Choice(name="hand"), hand=hand,
        flood=flood == "flood",
    )  # fmt: skip
    status = drive.run()
    Path(out).write_text(json.dumps({"reports": hand.reports, "floods": drive.floods, "status": status}))


if __name__ == "__main__":
    main(*sys.argv[1:])
