"""The input `network`: an operator on another computer, who runs `artemis operator` there.

The link has a process of its own, which alone reads what comes from the network; here its reports become samples. A
sample's age counts from the robot's beat that the operator's command quotes, plus the age of the operator's device.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import msgspec
from pydantic import Field

from artemis.bridges.addresses import ListenAddress, listening_at
from artemis.bridges.operator.link_process import LinkProcess, LinkSettings
from artemis.bridges.operator.pairing import default_place, read_secret
from artemis.bridges.operator.server import TlsFiles, files_of_tls
from artemis.bridges.operator.session import Arrived
from artemis.bridges.operator.status import SHOWN_EVERY, RobotStatus, Welcome, status_of
from artemis.bridges.places import TakenPlace, port_place
from artemis.bridges.received import REQUESTS
from artemis.config import Config
from artemis.errors import ConfigError
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.linked import LinkedInput, LinkPort
from artemis.values import Tick
from artemis.vehicle import WishedSpeed

PORT = 7482
"""Where artemis listens for operators; in no list of well-known ports."""


class NetworkConfig(Config):
    """Keys of an input with `plugin: network`."""

    listen: ListenAddress = "127.0.0.1"
    """The address of this computer at which operators reach it; 0.0.0.0 or ::: any."""
    port: Annotated[int, Field(ge=1, le=65535)] = PORT
    secret: str | None = None
    """File of the secret, relative to the mission's folder; None: where `artemis operator pair` keeps it."""
    tls: TlsFiles | None = None
    """Encrypt the link, and prove to operators who have the certificate which robot this is."""
    allow: Annotated[tuple[Literal["acknowledge", "arm", "end"], ...], Field(strict=False)] = ()
    """What may be asked for besides the quick stop, done and record. With acknowledge and arm an operator counts as
    present in the run."""
    max_speed_m_s: WishedSpeed | None = None
    """Faster commands are cut to this speed of the virtual front wheel; None: the robot's limit."""

    def places(self, name: str) -> Sequence[TakenPlace]:
        """Its port."""
        return port_place(self.listen, self.port)


class NetworkInput(LinkedInput):
    """One operator at a time, far away."""

    Config: ClassVar[type[Config]] = NetworkConfig
    live: bool = True
    enable: ClassVar[str] = "the operator's enable button"

    def __init__(
        self,
        config: NetworkConfig,
        context: PluginContext,
        port: LinkPort | None = None,
        clock: Callable[[], float] | None = None,
    ) -> None:
        """Listen, where the run keeps real time; else only look whether the files are good.

        Args:
            config: The mission's keys.
            context: Of the run.
            port: A link that is there already.
            clock: Of the link's times [s]; None: the running loop's.

        Raises:
            ConfigError: more speed than the robot has, a bad secret or certificate, an address that is taken.
        """
        self._top_speed = context.top_speed("max_speed_m_s", config.max_speed_m_s)
        self._limit = math.radians(context.robot.limits.steering_deg)
        self.live = {"acknowledge", "arm"} <= set(config.allow)
        self._shown: tuple[float, RobotStatus] | None = None
        self._name = context.name
        if port is None:
            settings = self._settings(config, context)
            if context.real_time and settings is not None:
                port = LinkProcess(listening_at(self._name, config.listen, config.port), settings)
        super().__init__(context, port, clock)

    @staticmethod
    def may_share(one: NetworkConfig, other: NetworkConfig, _files: Mapping[str, bytes]) -> bool:
        """Whether both listen at one port."""
        return one.port == other.port

    def show(self, tick: Tick) -> str:
        """Send the operator what the robot does: at once where it is news, else ten times a second."""
        if self._port is not None and self._report.seat == "held":
            now, status = tick.snapshot.time, status_of(tick, self._name)
            if self._shown is None or now - self._shown[0] >= SHOWN_EVERY or status.differs(self._shown[1]):
                self._shown = now, status
                self._port.tell(msgspec.json.encode(status))
        return ""

    # ------------------------------------------------------------------------------------------

    def _wish(self, arrived: Arrived, now: float) -> tuple[float, float]:
        """As commanded, within what the robot may do."""
        speed = max(min(arrived.speed, self._top_speed), -self._top_speed)
        return speed, max(min(arrived.steering, self._limit), -self._limit)

    def _settings(self, config: NetworkConfig, context: PluginContext) -> LinkSettings | None:
        """What the link's process needs; None: before a run, where the secret may still be missing.

        Raises:
            ConfigError: a file is bad.
        """
        place = default_place() if config.secret is None else context.folder / config.secret
        try:
            secret = read_secret(place) if context.real_time or place.exists() else None
        except ConfigError as error:
            raise ConfigError(f"{self._name}: secret: {error}") from None
        files = files_of_tls(config.tls, context.folder, self._name)
        if secret is None:
            return None
        certificate, key = ("", "") if files is None else map(str, map(Path.absolute, files))
        limits = context.robot.limits.model_copy(update={"speed_m_s": self._top_speed})
        robot = context.robot.model_copy(update={"limits": limits})
        return LinkSettings(
            secret=secret,
            welcome=msgspec.json.encode(
                Welcome(robot=msgspec.Raw(robot.model_dump_json().encode()), allow=config.allow)
            ),
            allow=tuple(REQUESTS[word] for word in config.allow),
            certificate=certificate,
            key=key,
        )
