"""The missions of a folder: which there are, and what a process beside found out about each."""

from __future__ import annotations

import asyncio
import os
import re
import subprocess
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import msgspec

from artemis.errors import writable

SUFFIXES = (".yaml", ".yml")
MOST_FILES, MOST_PROBLEMS = 200, 50
"""More files of a folder, and more problems of a mission, are not shown."""
HEAD = 100_000
"""The key `mission` is within this number of bytes of a mission file."""
PATIENCE = 120.0
"""A mission has this long to be checked [s], on a busy computer."""
_IS_MISSION = re.compile(rb"^mission[ \t]*:", re.MULTILINE)
_BESIDE = 15
"""Niceness of a check: Stop and ticks go first."""

Stamp = tuple[int, int, int]


class CheckedMission(msgspec.Struct, frozen=True, kw_only=True):
    """The result of `artemis check --json` for one mission."""

    file: str
    mission: str = ""
    about: str = ""
    robot: str = ""
    bus: str = ""
    simulated: bool = False
    hash: str = ""
    """Of its content, with all files that it names."""
    remarks: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()
    checked: bool = True
    """False: it is being checked, and the rest is not known yet."""

    @property
    def may_start(self) -> bool:
        """Nothing is wrong with it."""
        return self.checked and not self.problems and bool(self.hash)


@dataclass(slots=True)
class _Entry:
    stamp: Stamp
    facts: CheckedMission


class MissionFolder:
    """Looks which files there are; has those checked that are new, or not as they were."""

    def __init__(self, folder: Path, check: Sequence[str], changed: Callable[[], None]) -> None:
        """`check`: a command that takes file names and prints lines of JSON; `changed`: called for new results."""
        self.folder = folder
        self.note = ""
        """What keeps missions from being shown."""
        self._check, self._changed = check, changed
        self._known: dict[str, _Entry] = {}
        self._others: dict[str, Stamp] = {}
        """Files that are no missions."""
        self._checking: asyncio.Task[None] | None = None
        self._process: asyncio.subprocess.Process | None = None
        self._again = self._over = False
        """Check all missions anew afterwards; check nothing any more."""

    @property
    def missions(self) -> list[CheckedMission]:
        """All, by the names of their files."""
        return [self._known[name].facts for name in sorted(self._known)]

    def get(self, file: str) -> CheckedMission | None:
        """The mission in a file of the folder; None: there is none."""
        found = self._known.get(file)
        return None if found is None else found.facts

    def look(self, *, anew: bool = False) -> None:
        """See what is there; with `anew` check everything again: a mission also depends on other files."""
        checking = self._checking is not None and not self._checking.done()
        if anew and checking:
            self._again = True
            return
        if anew:
            self._known.clear()
            self._others.clear()
        before = self.note, set(self._known)
        found = self._files()
        for name in [name for name in self._known if name not in found]:
            del self._known[name]
        self._others = {name: stamp for name, stamp in self._others.items() if name in found}
        for name, stamp in found.items():
            known = self._known.get(name)
            if self._others.get(name) == stamp or (known is not None and known.stamp == stamp):
                continue
            if (facts := self._begun(name)) is None:
                self._others[name] = stamp
                self._known.pop(name, None)
            else:
                self._known[name] = _Entry(stamp, facts)
                before = "", set()
        if before != (self.note, set(self._known)):
            self._changed()
        if not checking and any(not known.facts.checked for known in self._known.values()):
            self._checking = asyncio.get_running_loop().create_task(self._sweep())

    async def close(self) -> None:
        """End a check that is running."""
        self._over = True
        self._end_process()
        if self._checking is not None:
            await self._checking

    def _end_process(self) -> None:
        if self._process is not None:
            with suppress(ProcessLookupError):
                self._process.kill()

    def _files(self) -> dict[str, Stamp]:
        """Files that may be missions, with what shows that one was changed."""
        found: dict[str, Stamp] = {}
        self.note = ""
        try:
            with os.scandir(self.folder) as entries:
                for entry in entries:
                    name = writable(entry.name)
                    if name != entry.name or not name.endswith(SUFFIXES):
                        continue
                    with suppress(OSError):  # gone meanwhile, or a link to nothing
                        if entry.is_file():
                            seen = entry.stat()
                            found[name] = seen.st_mtime_ns, seen.st_size, seen.st_ino
        except OSError as error:
            self.note = f"{self.folder.name}: {error.strerror}"
        if len(found) > MOST_FILES:
            self.note = f"only the first {MOST_FILES} of {len(found)} files are shown"
            found = {name: found[name] for name in sorted(found)[:MOST_FILES]}
        return found

    def _begun(self, name: str) -> CheckedMission | None:
        """What is known of a file at once; None: it is no mission."""
        path = self.folder / name
        if not path.resolve().is_relative_to(self.folder.resolve()):
            return CheckedMission(file=name, problems=(f"{name}: is a link to a file outside of the folder",))
        try:
            with path.open("rb") as file:
                is_mission = _IS_MISSION.search(file.read(HEAD))
        except OSError as error:
            return CheckedMission(file=name, problems=(f"{name}: cannot be read: {error.strerror}",))
        return CheckedMission(file=name, checked=False) if is_mission else None

    # ------------------------------------------------------------------------------------------ checks

    async def _sweep(self) -> None:
        """Check until all are; a file that ends its process has that as its error, and the others are checked."""
        while True:
            while waiting := {name: known.stamp for name, known in self._known.items() if not known.facts.checked}:
                if self._over:
                    return
                left = dict(sorted(waiting.items()))
                words = await self._checked(left)
                if left:  # the first of these was being checked
                    name = next(iter(left))
                    self._put(name, left[name], CheckedMission(file=name, problems=(f"{name}: {words}",)))
            if self._over or not self._again:
                return
            self._again = False
            self._known.clear()
            self.look()

    async def _checked(self, left: dict[str, Stamp]) -> str:
        """Check those that are `left`, which become fewer; how the process ended."""
        process = await asyncio.create_subprocess_exec(
            *self._check,
            *left,
            cwd=self.folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            limit=1 << 20,
        )
        assert process.stdout is not None
        self._process = process
        if self._over:
            self._end_process()
        try:
            with suppress(ProcessLookupError):
                os.setpriority(os.PRIO_PROCESS, process.pid, _BESIDE)
            while left:
                try:
                    line = await asyncio.wait_for(process.stdout.readline(), PATIENCE)
                except TimeoutError:
                    return f"its check did not end within {PATIENCE:g} s"
                except ValueError:
                    return "its check printed too much"
                if not line:
                    return f"its check ended with status {await process.wait()} and without a word"
                with suppress(msgspec.DecodeError):  # printed by a plugin
                    facts = msgspec.json.decode(line, type=CheckedMission)
                    if (stamp := left.pop(facts.file, None)) is not None:
                        self._put(facts.file, stamp, facts)
            return ""
        finally:
            self._end_process()
            await process.communicate()
            self._process = None

    def _put(self, name: str, stamp: Stamp, facts: CheckedMission) -> None:
        """Note what was found, unless the file has changed meanwhile: then it is checked again."""
        if (known := self._known.get(name)) is not None and known.stamp == stamp:
            known.facts = msgspec.structs.replace(facts, problems=facts.problems[:MOST_PROBLEMS])
            self._changed()


def as_shown(missions: Sequence[CheckedMission]) -> list[Mapping[str, object]]:
    """Missions for a browser."""
    return [{**msgspec.structs.asdict(facts), "may_start": facts.may_start} for facts in missions]
