"""What the third process of a page makes of runs: one task at a time, with its progress; kept beside the run."""

from __future__ import annotations

import asyncio
import os
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import msgspec

from artemis.bridges.background import BackgroundTasks
from artemis.page.runs import REPLAY, RunFacts, has_report, signature
from artemis.page.runs_replay import is_made
from artemis.page.runs_work import Said, command

LOOK_AGAIN = 10.0
"""A run that changes is read again after this time [s]."""
MOST_WAITING = 8
"""Works that wait for the one at a time."""
MOST_AT_ONCE = 50
"""Runs whose facts one process reads."""
MOST_ARCHIVES = 2
"""Downloads at once."""
MOST_LINE = 1 << 20
"""Longest line that a process prints; and part of an archive that waits for a slow browser [bytes]."""
_ERRORS = 2000
"""The last bytes of what a process complains of that are looked at."""


class Making(msgspec.Struct):
    """How far a work is."""

    state: str = "waiting"
    """`waiting`, `making`, `ready`, or `failed`."""
    share: float | None = None
    """That is done; None: unknown."""
    problem: str = ""


class _ReadFacts(msgspec.Struct):
    made_of: list[int]
    at: float
    facts: RunFacts


class Works:
    """On one running loop, whose end ends them."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._making: dict[tuple[str, Path], Making] = {}
        self._one = asyncio.Semaphore(1)
        self._archives = 0
        self._tasks = BackgroundTasks()
        self._known: dict[Path, _ReadFacts] = {}
        self._reading: set[Path] = set()

    # ------------------------------------------------------------------------------------------ the list

    def facts(self, folders: Sequence[Path]) -> list[RunFacts | None]:
        """What is known of these runs; None: not yet, ask again. What is new is read meanwhile."""
        wanted = [folder for folder in folders if self._is_old(folder) and folder not in self._reading][:MOST_AT_ONCE]
        if wanted and not self._reading:
            self._reading.update(wanted)
            self._tasks.begin(self._read(wanted))
        return [known.facts if (known := self._known.get(folder)) is not None else None for folder in folders]

    def _is_old(self, folder: Path) -> bool:
        known = self._known.get(folder)
        if known is None:
            return True
        return self._loop.time() - known.at > LOOK_AGAIN and (
            known.made_of != signature(folder) or known.facts.state == "running"
        )

    async def _read(self, folders: list[Path]) -> None:
        left, how = {str(folder): signature(folder) for folder in folders}, ""

        def take(run: str, facts: RunFacts) -> None:
            self._known[Path(run)] = _ReadFacts(left.pop(run), self._loop.time(), facts)

        try:
            async with _process("facts", *left) as (process, ended):
                async for said in _lines(process):
                    if said.facts is not None and said.run in left:
                        take(said.run, said.facts)
                how = await ended()
        except OSError as error:
            how = f"no process could be started: {error.strerror}"
        finally:
            self._reading.clear()
        for run in list(left):
            take(run, RunFacts(problem=f"it could not be read: {how}"))

    # ------------------------------------------------------------------------------------------ report and replay

    def state(self, what: str, folder: Path) -> Making | None:
        """How far the `report` or the `replay` of a run is; None: it neither exists nor is being made."""
        making = self._making.get((what, folder))
        if making is not None and making.state in ("waiting", "making"):
            return making
        if is_ready(what, folder):
            return Making("ready", 1.0)
        return making if making is not None and making.state == "failed" else None

    def make(self, what: str, folder: Path) -> Making:
        """Have it made, unless it is there or being made."""
        found = self.state(what, folder)
        if found is not None and found.state != "failed":
            return found
        if sum(making.state in ("waiting", "making") for making in self._making.values()) >= MOST_WAITING:
            return Making("failed", problem="too much is being made already: try again in a while")
        self._making = {key: each for key, each in self._making.items() if each.state in ("waiting", "making")}
        making = self._making[what, folder] = Making()
        self._tasks.begin(self._make(what, folder, making))
        return making

    async def _make(self, what: str, folder: Path, making: Making) -> None:
        async with self._one:
            making.state = "making"
            try:
                async with _process(what, str(folder)) as (process, ended):
                    async for said in _lines(process):
                        making.share, making.problem = said.share, said.problem or making.problem
                    how = await ended()
                if not making.problem and not await asyncio.to_thread(is_ready, what, folder):
                    making.problem = how or "the run changed meanwhile"
            except OSError as error:
                making.problem = f"no process could be started: {error.strerror}"
            making.state = "failed" if making.problem else "ready"

    # ------------------------------------------------------------------------------------------ an archive

    @property
    def can_pack(self) -> bool:
        """Whether one more run may be downloaded now."""
        return self._archives < MOST_ARCHIVES

    async def packed(self, folder: Path) -> AsyncIterator[bytes]:
        """A run as one zip archive, in pieces that are made as they are taken."""
        self._archives += 1
        try:
            async with _process("zip", str(folder)) as (process, ended):
                assert process.stdout is not None
                while piece := await process.stdout.read(1 << 16):
                    yield piece
                if how := await ended():
                    raise RuntimeError(how)  # ends the connection: a browser then shows that the download failed
        finally:
            self._archives -= 1


def is_ready(what: str, folder: Path) -> bool:
    """Whether it is there, and of the run as it is now."""
    if what == REPLAY:
        return is_made(folder / REPLAY, folder)
    return has_report(folder)


async def _lines(process: Process) -> AsyncIterator[Said]:
    assert process.stdout is not None
    async for line in process.stdout:
        with suppress(msgspec.DecodeError, UnicodeDecodeError):  # something that a library printed
            yield msgspec.json.decode(line, type=Said)


@asynccontextmanager
async def _process(what: str, *arguments: str) -> AsyncIterator[Any]:
    """A task in its own process, with a thread that waits for its end and reports errors; ends with the context."""
    with TemporaryFile() as errors:
        process = await asyncio.create_subprocess_exec(
            *command(what, *arguments),
            stdin=PIPE,
            stdout=PIPE,
            stderr=errors,
            limit=MOST_LINE,
            start_new_session=True,  # a terminal's signals are for the run
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )

        async def ended() -> str:
            if not (status := await process.wait()):
                return ""
            size = errors.seek(0, os.SEEK_END)
            errors.seek(max(0, size - _ERRORS))
            last = errors.read().decode(errors="replace").strip().splitlines()[-1:]
            return f"its process ended with status {status}" + "".join(f": {line}" for line in last)

        assert process.stdout is not None
        try:
            yield process, ended
        finally:
            with suppress(ProcessLookupError):
                process.kill()
            while await process.stdout.read(MOST_LINE):  # its end is not seen before that of a pipe that is full
                pass
            await process.wait()
