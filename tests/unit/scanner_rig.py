"""A session with a simulated LMS100 on virtual time, and what it has seen."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from artemis import clock
from artemis.devices.lms1xx.session import Session
from artemis.errors import DeviceError
from artemis.plugins.scanners.lms1xx import Lms1xxConfig
from artemis.scan import Scan
from artemis.sim.lms100 import Lms100


def spiral(times: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Beam i measures 1000 + 3 i mm."""
    return np.asarray(1000 + 3 * np.arange(len(times)), np.uint16)


@dataclass
class Held:
    """One session after the other."""

    device: Lms100
    session: Session
    scans: list[Scan] = field(default_factory=list)
    given: list[float] = field(default_factory=list)
    """When [s]."""
    errors: list[DeviceError] = field(default_factory=list)

    async def hold(self, seconds: float) -> DeviceError | None:
        """Hold a session for so long, or until it ends with an error."""
        loop = asyncio.get_running_loop()

        def give(scan: Scan) -> None:
            self.scans.append(scan)
            self.given.append(loop.time())

        try:
            async with asyncio.timeout(seconds):
                await self.session.hold(loop.time, give)
        except TimeoutError as error:
            if not isinstance(error, DeviceError):
                return None
            self.errors.append(error)
        except DeviceError as error:
            self.errors.append(error)
        return self.errors[-1]


def held(test: Callable[[Held], Awaitable[None]], setting: Lms1xxConfig | None = None) -> None:
    """Run a test with a device and a session on virtual time."""

    async def main() -> None:
        device = Lms100(spiral, first_us=(1 << 32) - 2_000_000, drift=50e-6)
        session = Session("front", setting or Lms1xxConfig(host="scanner"), device.dial)
        await test(Held(device, session))

    clock.run(main(), simulated=True)
