"""SICK's laser scanners LMS100, LMS111 and their like, over the network."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator

from artemis.config import Config
from artemis.devices import tcp
from artemis.devices.lms1xx.session import Session
from artemis.plugins.contracts import PluginContext
from artemis.scan import Scan


class Lms1xxConfig(Config):
    """Keys of a scanner with `plugin: lms1xx`, in the robot file."""

    host: Annotated[str, Field(min_length=1)]
    """Name or address; 192.168.0.1 as it is made."""
    port: Annotated[int, Field(ge=1, le=65535)] = 2111
    frequency_hz: Literal[25, 50] = 50
    """Turns per second."""
    resolution_deg: float = 0.5
    """From beam to beam: 0.5, or 0.25 with 25 turns per second."""

    @property
    def address(self) -> str:
        """Host and port: no other scanner has them."""
        return f"{self.host}:{self.port}".lower()

    @field_validator("host")
    @classmethod
    def _one_word(cls, host: str) -> str:
        if host.split() != [host]:
            raise ValueError("expected a name or an address without blanks")
        return host

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.resolution_deg not in (0.25, 0.5):
            raise ValueError(f"resolution_deg: expected 0.25 or 0.5, found {self.resolution_deg:g}")
        if self.frequency_hz == 50 and self.resolution_deg == 0.25:
            raise ValueError("resolution_deg: 0.25 needs frequency_hz: 25; with 50 it measures every half degree")
        return self


class Lms1xxScanner:
    """One such scanner, by CoLa A."""

    Config: ClassVar[type[Config]] = Lms1xxConfig
    contract: ClassVar[int] = 1
    field_deg: ClassVar[tuple[float, float]] = (-135.0, 135.0)
    least_range_m: ClassVar[float] = 0.5  # "working range 0.5 m to 20 m": data sheet of the LMS100

    def __init__(self, config: Lms1xxConfig, context: PluginContext) -> None:
        """Nothing is opened before it runs."""
        self._session = Session(context.name, config, context.dial or tcp.dial)

    async def run(self, clock: Callable[[], float], give: Callable[[Scan], None]) -> None:
        """One session with the device. Raises as that does."""
        await self._session.hold(clock, give)

    def close(self) -> None:
        """Close the connection."""
        self._session.close()
