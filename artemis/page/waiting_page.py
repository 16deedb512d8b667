"""A robot that waits for an operator: the page of a folder of missions, and the runs that are started from it.

The port stays bound all the time. While a run is active its own page answers there, and this one does not
listen: driving and Stop do not depend on it.
"""

from __future__ import annotations

import asyncio
import fcntl
import os
import socket
from collections.abc import Callable, Sequence
from pathlib import Path

from artemis.bridges.addresses import bound
from artemis.clock import wall_date
from artemis.errors import ConfigError
from artemis.notify import READY, STATUS, STOPPING, ServiceManager
from artemis.page.access import Access, key_place, read_key, used_place
from artemis.page.mission_folder import CheckedMission, MissionFolder
from artemis.page.observer import PageObserverConfig, url_of
from artemis.page.paired import serve
from artemis.page.started_run import END_TIME, StartedRun
from artemis.page.waiting import Ended, Waiting
from artemis.page.waiting_server import WaitingServer

LOOK = 0.1
"""Between two looks at the run [s]."""
LOOK_AT_FOLDER = 2.0


class WaitingPage:
    """One such process."""

    def __init__(
        self,
        folder: Path,
        config: PageObserverConfig,
        tls: tuple[Path, Path] | None,
        check: Sequence[str],
        run: Callable[[CheckedMission], Sequence[str]],
        manager: ServiceManager,
    ) -> None:
        """Take the port.

        Args:
            folder: Of the missions.
            config: As of a run's page; its key for the mission's input is not used.
            tls: Certificate and key.
            check: The command that checks missions.
            run: The command that runs one.
            manager: Gets the state of this process.

        Raises:
            ConfigError: the port is in use, also by a run that a page before this one started; or the key is bad.
        """
        self._config, self._tls, self._run_command, self._manager = config, tls, run, manager
        key = read_key(key_place())
        self._lock = _locked(key_place().with_name(f"page-{config.port}.lock"), config.port)
        self._reserved, self._listening = self._bound(), self._bound(listening=True)
        self._folder = MissionFolder(folder, check, self._tell)
        self._waiting = Waiting(
            missions=self._folder.get,
            begin=self._begin,
            cancel=self._cancel,
            check=lambda: self._folder.look(anew=True),
            changed=self._tell,
        )
        access = Access(key, config.port, used_place(), tls=tls is not None, names=config.names)
        self._server = WaitingServer(self._waiting, self._folder, access, key, url_of(config))
        self._leave, self._back = asyncio.Event(), asyncio.Event()
        self._shown: list[str] = []
        self._latest = 0.0
        """When a run is killed that has not ended [s]; 0: the end was not asked for."""
        self._idle = f"{STATUS}waiting for an operator at {url_of(config)}"

    async def wait(self) -> None:
        """Serve until the end was asked for, and what was started has ended."""
        async with asyncio.TaskGroup() as tasks:
            looking = tasks.create_task(self._look())
            self._manager.tell(READY, self._idle)
            while not looking.done():
                serving = tasks.create_task(serve(self._server, self._listening, self._leave, self._tls))
                await asyncio.wait((serving, looking), return_when=asyncio.FIRST_COMPLETED)
                if not (self._leave.is_set() or looking.done()):
                    raise RuntimeError("the page's server has ended")
                self._leave.set()
                await serving
                returning = tasks.create_task(self._back.wait())
                await asyncio.wait((returning, looking), return_when=asyncio.FIRST_COMPLETED)
                returning.cancel()
                if not looking.done():
                    self._leave.clear()
                    self._listening = self._bound(listening=True)
        self._manager.tell(STOPPING)

    def end(self) -> None:
        """Leave, after what was started has ended in order, with its report; asked again the robot stops quickly."""
        now = asyncio.get_running_loop().time()
        self._latest = self._latest or now + END_TIME
        if self._server.run is not None:
            self._server.run.end(now)

    async def close(self) -> None:
        """Release everything. A run that is still active, because this page has failed, is ended in order before."""
        if not self._latest:
            self.end()
        await self._look()
        await self._folder.close()
        for open_socket in (self._listening, self._reserved):
            open_socket.close()
        os.close(self._lock)

    def _bound(self, *, listening: bool = False) -> socket.socket:
        """A socket at the port. Raises ConfigError."""
        listen, port = self._config.listen, self._config.port
        try:
            return bound(listen, port, listening=listening, shared=True)
        except OSError as error:
            raise ConfigError(f"{listen}, port {port}: {error.strerror}") from None

    # ------------------------------------------------------------------------------------------ the run

    def _tell(self) -> None:
        self._server.tell()

    def _begin(self, mission: CheckedMission) -> str:
        """Start a mission; why that cannot be, or nothing."""
        if self._latest:
            return "this page is ending"
        now = asyncio.get_running_loop().time()
        try:
            run = StartedRun(self._run_command(mission), self._folder.folder, (self._lock,), now)
        except OSError as error:
            return f"the run cannot be started: {error.strerror}"
        self._server.run = run
        self._manager.tell(f"{STATUS}starts {mission.file}")
        return ""

    def _cancel(self) -> None:
        if self._server.run is not None:
            self._server.run.cancel(asyncio.get_running_loop().time())

    async def _look(self) -> None:
        """Look after the run, and at the folder, until the end."""
        loop, look_at_folder = asyncio.get_running_loop(), 0.0
        while True:
            now = loop.time()
            if self._server.run is not None:
                self._look_at_run(self._server.run, now)
            if self._latest and self._server.run is None:
                return
            if self._latest and self._server.run is not None and now > self._latest:
                self._server.run.kill()
            if self._server.run is None and now >= look_at_folder:
                look_at_folder = now + LOOK_AT_FOLDER
                self._folder.look()
            self._manager.alive(now)
            await asyncio.sleep(LOOK)

    def _look_at_run(self, run: StartedRun, now: float) -> None:
        waiting, status = self._waiting, run.look(now)
        if waiting.state == "starting" and run.is_ready:
            waiting.state = "running"
            self._back.clear()
            self._leave.set()  # its page answers at the port already
        if waiting.state == "running" and (run.is_stopping or status is not None):
            waiting.state = "ending"
            self._back.set()
        shown = [waiting.state, run.status]
        if waiting.state != "running":
            shown += run.lines()
        if shown != self._shown:
            self._shown = shown
            self._manager.tell(f"{STATUS}{waiting.state}: {waiting.chosen.file if waiting.chosen else ''} {run.status}")
            self._tell()
        if status is not None:
            self._end(run, status)

    def _end(self, run: StartedRun, status: int) -> None:
        waiting, mission = self._waiting, self._waiting.chosen
        assert mission is not None
        ended = Ended(
            file=mission.file,
            mission=mission.mission,
            who=waiting.started_by,
            date=wall_date().isoformat(timespec="seconds"),
            status=status,
            outcome=run.outcome,
            lines=run.lines(),
        )
        run.close()
        self._server.run = None
        self._back.set()
        waiting.over(ended)
        self._folder.look(anew=status == 2)  # what was refused may have changed with another file
        self._manager.tell(self._idle)


def _locked(path: Path, port: int) -> int:
    """A file that one such process has open at a time, and the run that it started as long as that is active."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise ConfigError(
            f"port {port}: another `artemis page` is there, or a run that one started has not ended"
        ) from None
    return descriptor
