"""The input `network`: an operator on another computer, who runs `artemis operator` there.

The link has a process of its own, which alone reads what comes from the network; here its reports become samples. A
sample's age counts from the robot's beat that the operator's command quotes, plus the age of the operator's device.
"""

from __future__ import annotations

import asyncio
import math
import socket
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Protocol

import msgspec
from pydantic import Field

from artemis.bridges.addresses import ListenAddress, bound
from artemis.bridges.operator.link_process import LinkProcess, LinkSettings
from artemis.bridges.operator.pairing import default_place, read_secret
from artemis.bridges.operator.robot_end import FRESH, Arrived, LinkReport, Problem
from artemis.bridges.operator.server import tls_context
from artemis.bridges.operator.status import SHOWN_EVERY, RobotStatus, Welcome, status_of
from artemis.config import Config
from artemis.errors import ConfigError, DeviceLost
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.commanded import REQUESTS
from artemis.plugins.stated import STALE
from artemis.values import OperatorInput, Request, Tick
from artemis.vehicle import WishedSpeed

PORT = 7482
"""Where artemis listens for operators; in no list of well-known ports."""
LINK_LOST, LATENCY = "NET-01", "NET-02"


class TlsFiles(Config):
    """A certificate and its key, in files (PEM), relative to the mission's folder."""

    certificate: str
    key: str
    """Not encrypted, and readable by its owner alone."""


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
    """What may be asked for besides the quick stop, done and record. With acknowledge and arm somebody counts as
    present in the run."""
    max_speed_m_s: WishedSpeed | None = None
    """Faster commands are cut to this speed of the virtual front wheel; None: the robot's limit."""


class LinkPort(Protocol):
    """The link as the input sees it: `LinkProcess`, or what a test has instead."""

    def watch(self, news: Callable[[], None]) -> None:
        """Have `news` called on the running loop when there are reports."""

    def take(self) -> list[LinkReport]:
        """The reports since the last call, oldest first. Raises DeviceLost."""

    def tell(self, status: bytes) -> None:
        """What the robot does, for the operator."""

    def close(self) -> None:
        """End it."""


class NetworkInput:
    """One operator at a time, far away."""

    Config: ClassVar[type[Config]] = NetworkConfig
    contract: ClassVar[int] = 1
    pure: ClassVar[bool] = True
    live: bool = True
    stale_s: ClassVar[float] = FRESH
    enabled_by: ClassVar[str] = "the operator's enable button"

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
        self._name, self._wake, self._clock = context.name, context.wake, clock
        self._top_speed = context.top_speed("max_speed_m_s", config.max_speed_m_s)
        self._limit = math.radians(context.robot.limits.steering_deg)
        self.live = {"acknowledge", "arm"} <= set(config.allow)
        self._arrived: Arrived | None = None
        self._report = LinkReport()
        self._late: tuple[float, float] = (-math.inf, 0.0)
        self._requests: list[Request] = []
        self._problems: list[Problem] = []
        self._released = self._heard = False
        self._shown: tuple[float, RobotStatus] | None = None
        self._port = port
        if port is None:
            settings = self._settings(config, context)
            if context.real_time and settings is not None:
                self._port = LinkProcess(_listening(config, self._name), settings)
        if self._port is not None:
            self._port.watch(self._hear)

    @staticmethod
    def may_share(one: NetworkConfig, other: NetworkConfig, _files: Mapping[str, bytes]) -> bool:
        """Whether both listen at one port."""
        return one.port == other.port

    def read(self, now: float) -> OperatorInput:
        """What the operator wishes, as far as it still counts.

        Raises:
            DeviceLost: the link's process has ended, or there is none.
        """
        if self._port is None:
            raise DeviceLost(self._name, "an operator needs real time: leave `pace: fast` out of the mission")
        try:
            self._take()
        except DeviceLost:
            requests, self._requests = tuple(self._requests), []
            if Request.QUICKSTOP not in requests:  # a stop goes first
                raise
            return OperatorInput(source=self._name, neutral=False, requests=(Request.QUICKSTOP,))
        requests, self._requests = tuple(self._requests), []
        sample = self._sample((self._clock or asyncio.get_running_loop().time)())
        return msgspec.structs.replace(sample, requests=requests)

    def take_problems(self) -> list[Problem]:
        """What is wrong with the link since the last call: rows of the fault table, and what was seen."""
        problems, self._problems = self._problems, []
        return problems

    def show(self, tick: Tick) -> str:
        """Tell the operator what the robot does: at once where it is news, else ten times a second."""
        if self._port is not None and self._report.seat == "held":
            now, status = tick.snapshot.time, status_of(tick, self._name)
            if self._shown is None or now - self._shown[0] >= SHOWN_EVERY or status.differs(self._shown[1]):
                self._shown = now, status
                self._port.tell(msgspec.json.encode(status))
        return ""

    def close(self) -> None:
        """End the link."""
        if self._port is not None:
            self._port.close()

    # ------------------------------------------------------------------------------------------

    def _hear(self) -> None:
        """Between two ticks; that the process has ended is for the next `read` to say."""
        with suppress(DeviceLost):
            self._take()

    def _take(self) -> None:
        """Take the link's reports; a quick stop does not wait for the next tick."""
        assert self._port is not None
        for report in self._port.take():
            if (report.seat, report.since) != (self._report.seat, self._report.since):
                self._released, self._late = False, (-math.inf, 0.0)
            self._report, self._arrived = report, report.newest
            self._late = report.late or self._late
            self._requests += report.requests
            self._problems += report.problems
            if Request.QUICKSTOP in report.requests:
                self._wake()

    def _sample(self, now: float) -> OperatorInput:
        """What the newest command wishes at `now` [s] of the link's clock."""
        report, arrived = self._report, self._arrived
        if report.seat == "free":
            self._released = False
            return OperatorInput(source=self._name, neutral=report.who != "", age=0.0 if report.who else None)
        if report.seat == "lost":
            self._released = False
            self._problems.append((LINK_LOST, f"{report.who}: {report.why}"))
            return OperatorInput(source=self._name, neutral=False, age=max(now - report.since, 0.0) + FRESH)
        quoted = max(now - (report.since if arrived is None else arrived.sent), 0.0)
        frozen = arrived is not None and arrived.age > STALE  # his device: INP-03
        age = quoted + (0.0 if arrived is None else arrived.age)
        if quoted > FRESH or (age > FRESH and not frozen):
            self._released = False
            late, how_old = self._late
            if now - late <= FRESH:
                self._problems.append((LATENCY, f"{report.who}: commands are {how_old * 1e3:.0f} ms old"))
            else:
                self._problems.append((LINK_LOST, f"{report.who}: nothing new for {age * 1e3:.0f} ms"))
        if arrived is None:  # just seated: the first command is on its way
            return OperatorInput(source=self._name, neutral=False, age=age)
        if not arrived.heard:
            self._released = False
            return OperatorInput(source=self._name, neutral=False)
        self._released = age <= FRESH and (self._released or arrived.neutral)
        return OperatorInput(
            source=self._name,
            speed=max(min(arrived.speed, self._top_speed), -self._top_speed),
            steering=max(min(arrived.steering, self._limit), -self._limit),
            enabled=arrived.enabled and self._released,
            neutral=arrived.neutral and not arrived.enabled,
            age=age,
            raw=(arrived.speed, arrived.steering),
            axes=arrived.axes,
            buttons=(arrived.enabled,),
        )

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
        tls = config.tls
        files = None if tls is None else (context.folder / tls.certificate, context.folder / tls.key)
        if files is not None:
            try:
                tls_context(*files)
            except ConfigError as error:
                raise ConfigError(f"{self._name}: {error}") from None
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


def _listening(config: NetworkConfig, name: str) -> socket.socket:
    """A socket that takes connections.

    Raises:
        ConfigError: this computer has no such address, or the port is taken.
    """
    try:
        return bound(config.listen, config.port, listening=True)
    except OSError as error:
        raise ConfigError(f"{name}: listen: {config.listen} port {config.port}: {error.strerror}") from None
