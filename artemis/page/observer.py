"""The observer `page`: shows browsers what the robot does, and passes the requests of operators to the input `page`."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Sequence
from ipaddress import ip_address
from math import inf
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import msgspec
from pydantic import Field, model_validator

from artemis.bridges.addresses import ListenAddress, bound
from artemis.bridges.complaints import Complaints
from artemis.bridges.loop_thread import LoopThread
from artemis.bridges.operator.server import TlsFiles, files_of_tls
from artemis.bridges.places import TakenPlace, port_place
from artemis.build import require
from artemis.clock import stopwatch
from artemis.config import Config
from artemis.devices.can_bus import Traffic
from artemis.errors import ConfigError
from artemis.page.access import Access, key_place, read_key, used_place
from artemis.page.view import PageView, mission_in
from artemis.page.zones import ZoneFiles
from artemis.plugins.contracts import PluginContext
from artemis.values import Tick

PORT = 8480
"""In no list of well-known ports."""
STATES_EVERY = 0.05
"""From state to state on average [s]; each is made of the first tick after it is due."""
_JSON = msgspec.json.Encoder().encode


class PageObserverConfig(Config):
    """Keys that a mission may write beside `plugin: page` under `observers`."""

    listen: ListenAddress = "127.0.0.1"
    """The address of this computer at which browsers reach the page; another than a loopback address needs `tls`."""
    port: Annotated[int, Field(ge=1, le=65535)] = PORT
    tls: TlsFiles | None = None
    """Encrypt the connection; browsers must trust the certificate."""
    names: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """Names by which browsers reach it besides this computer's own; addresses in numbers always do."""
    input: str = "page"
    """The name of the mission's input with `plugin: page` that is given what operators want."""
    started_by_page: bool = False
    """`artemis page` started the run; it holds the port, too, and answers there before and after."""

    def places(self, name: str) -> Sequence[TakenPlace]:
        """Its port."""
        return port_place(self.listen, self.port)

    @model_validator(mode="after")
    def _encrypted(self) -> Self:
        if self.tls is None and not ip_address(self.listen).is_loopback:
            raise ValueError(
                f"listen: other computers reach {self.listen}: needs `tls`; `artemis page certificate` makes its files"
            )
        return self


def url_of(config: PageObserverConfig) -> str:
    """Where browsers find the page."""
    host = config.listen
    if ip_address(host).is_unspecified:
        from socket import gethostname

        host = gethostname()
    host = f"[{host}]" if ":" in host else host
    return f"{'https' if config.tls else 'http'}://{host}:{config.port}"


def check_installed(what: str) -> None:
    """Nothing, where the extra is installed that `what` needs. Raises ConfigError."""
    require(what, "web", "starlette", "uvicorn", "websockets", "segno")


class PageObserver:
    """Serves the page. In a run its port is taken when it is made."""

    Config: ClassVar[type[Config]] = PageObserverConfig
    contract: ClassVar[int] = 1
    live: ClassVar[bool] = True
    own_process: ClassVar[bool] = True
    pure: ClassVar[bool] = True

    def __init__(self, config: PageObserverConfig, context: PluginContext) -> None:
        """Take the robot and the mission.

        Raises:
            ConfigError: the extra is not installed, the port is in use, this computer has no such address, or a file of
                TLS or the page's key is bad.
        """
        check_installed(f"{context.name}: plugin: page")
        files = files_of_tls(config.tls, context.folder, context.name)
        mission = mission_in(context.mission)
        self._view = PageView(context.robot, mission, context.routes, context.map, config.input)
        self._complaints = Complaints(context.name, "browser")
        self._known: dict[str, int] = {}
        self._due = -inf
        self._closed = False
        self._thread: _ServerThread | None = None
        if context.run is not None:  # not where a mission is only checked
            zones = ZoneFiles(context.folder, mission)
            self._thread = _ServerThread(config, context.name, self._view, zones, files, context.run.parent)
            self._thread.start()

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        """Publish a tick."""
        view, thread = self._view, self._thread
        if thread is None:
            return
        view.see(tick)
        time = stopwatch()
        if time < self._due and not tick.wish.finished:
            return
        self._due = max(self._due + STATES_EVERY, time)
        update: dict[str, Any] = {"state": _JSON(view.state(tick)), "over": tick.wish.finished}
        new = {name: part for name, part in view.parts.items() if self._known.get(name) != part[0]}
        if new:
            self._known.update({name: version for name, (version, _) in new.items()})
            update["parts"] = {name: (version, _JSON(content)) for name, (version, content) in new.items()}
        if view.log:
            update["log"] = [_JSON(line) for line in view.log]
            view.log.clear()
        thread.put(update)

    def take_problems(self) -> list[tuple[str, str, str]]:
        """That its server has ended."""
        if self._thread is None:
            return []
        return self._complaints.new(self._thread.problem, 0, closed=self._closed)

    def close(self) -> None:
        """Leave."""
        self._closed = True
        if self._thread is not None:
            self._thread.close()


class _ServerThread(LoopThread):
    """The server beside the ticks that are decoded here."""

    def __init__(
        self,
        config: PageObserverConfig,
        name: str,
        view: PageView,
        zones: ZoneFiles,
        files: tuple[Path, Path] | None,
        runs: Path,
    ) -> None:
        key = read_key(key_place())
        try:
            self._socket = bound(config.listen, config.port, listening=True, shared=config.started_by_page)
        except OSError as error:
            raise ConfigError(
                f"{name}: {config.listen}, port {config.port}: {error.strerror}; take another one: --page-port N"
            ) from None
        self._config, self._view, self._files, self._key, self._runs = config, view, files, key, runs
        self._zones = zones
        self._hub: Any = None
        super().__init__(name)

    @property
    def problem(self) -> str:
        """Why no browser is answered; empty: they are."""
        return "" if self._closed or self._thread.is_alive() else "its server has ended"

    def put(self, update: dict[str, Any]) -> None:
        """Send to browsers. Never waits."""
        self.hand_over(self._put, update)

    def _put(self, update: dict[str, Any]) -> None:
        if self._hub is not None:
            self._hub.put(update)

    def _give_back(self) -> None:
        self._socket.close()

    async def _main(self, end: asyncio.Event) -> None:
        from artemis.page.hub import Hub
        from artemis.page.paired import serve
        from artemis.page.server import PageServer

        config = self._config
        hub = Hub((os.getppid(), os.getpid()), config.input, self._zones)
        hub.about = _JSON(self._view.about())
        hub.history, hub.trail = lambda: _JSON(self._view.history), lambda: _JSON(self._view.trail)
        access = Access(self._key, config.port, used_place(), tls=config.tls is not None, names=config.names)
        server = PageServer(hub, access, self._key, url_of(config), [self._runs])
        self._hub = hub
        hub.begin()
        try:
            await serve(server, self._socket, end, self._files)
        finally:
            hub.close()
