"""The third process of a page: reads recordings and writes what is made of them, so that neither run nor page waits.

It is nice, and leaves when who began it does: then its standard input ends. What it says are lines of JSON on its
standard output; `zip` writes the archive there instead.
"""

from __future__ import annotations

import fcntl
import os
import sys
import threading
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

import msgspec

from artemis.errors import ArtemisError, RecordingError
from artemis.page.runs import REPLAY, RunFacts, facts_of, has_report
from artemis.recording.run_folder import RunFolder

NICE = 15
PIECE = 1 << 18
"""Bytes of a file that are packed at once."""
_STORED = {".mcap", ".png", ".gz", ".zip"}
"""Kinds of files that are packed already."""
_MAIN = "from artemis.page.runs_work import main; main()"


class Said(msgspec.Struct, omit_defaults=True):
    """One line: how far it is, what is wrong, or what is known of a run."""

    share: float | None = None
    problem: str = ""
    run: str = ""
    facts: RunFacts | None = None


def command(what: str, *arguments: str) -> list[str]:
    """The command line that does it: `facts FOLDER...`, `report FOLDER`, `replay FOLDER`, `zip FOLDER`."""
    return [sys.executable, "-P", "-c", _MAIN, what, *arguments]


def main() -> None:
    """Do the task that the arguments name."""
    os.nice(NICE)
    threading.Thread(target=_leave_at_end, daemon=True).start()
    what, folders = sys.argv[1], [Path(each) for each in sys.argv[2:]]
    with suppress(BrokenPipeError):
        if what == "zip":
            pack(folders[0], sys.stdout.buffer)
            return
        try:
            _WORKS[what](folders)
        except ArtemisError as error:
            say(Said(problem=str(error).replace(f"{folders[0]}{os.sep}", "")))  # where runs lie is nothing to browsers


def say(said: Said) -> None:
    """Print one line to the parent process."""
    sys.stdout.buffer.write(msgspec.json.encode(said) + b"\n")
    sys.stdout.buffer.flush()


def _leave_at_end() -> None:
    with suppress(OSError):
        os.read(0, 1)
    os._exit(0)


def _facts(folders: list[Path]) -> None:
    for folder in folders:
        say(Said(run=str(folder), facts=facts_of(folder)))


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Waits until no other page has something made of the run: that which waits and the run's own may be asked both.

    Raises:
        RecordingError: there is no such folder any more.
    """
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError as error:
        raise RecordingError(f"{folder.name}: {error.strerror}") from None
    try:
        with suppress(OSError):  # a network file system may have no locks of folders: then the process does not wait
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _report(folders: list[Path]) -> None:
    from artemis.recording.mcap_reader import Recording
    from artemis.report.page import write_report

    with _alone(folders[0]):
        if not has_report(folders[0]):
            write_report(Recording(folders[0]), RunFolder(path=folders[0]).report)
    say(Said(share=1.0))


def _replay(folders: list[Path]) -> None:
    from artemis.page.runs_replay import is_made, write_replay

    replay = folders[0] / REPLAY
    with _alone(folders[0]):
        if not is_made(replay, folders[0]):
            write_replay(folders[0], replay, lambda share: say(Said(share=round(share, 3))))
    say(Said(share=1.0))


_WORKS: dict[str, Callable[[list[Path]], None]] = {"facts": _facts, "report": _report, "replay": _replay}


def pack(folder: Path, out: IO[bytes]) -> None:
    """Write all files of a run as one zip archive, piece by piece; of a file that grows what it had at the beginning.

    Symbolic links, and what is only kept for replays, are left out.
    """
    with zipfile.ZipFile(out, "w") as archive:
        for file in _files(folder):
            inside = zipfile.ZipInfo.from_file(
                file, f"{folder.name}/{file.relative_to(folder).as_posix()}", strict_timestamps=False
            )
            inside.compress_type = zipfile.ZIP_STORED if file.suffix in _STORED else zipfile.ZIP_DEFLATED
            left = inside.file_size
            with file.open("rb") as source, archive.open(inside, "w", force_zip64=True) as target:
                while left > 0 and (piece := source.read(min(PIECE, left))):
                    target.write(piece)
                    left -= len(piece)


def _files(folder: Path) -> Iterator[Path]:
    for path in sorted(folder.iterdir()):
        if path.is_symlink() or path.name == REPLAY or path.name.startswith("."):
            continue
        if path.is_dir():
            yield from _files(path)
        elif path.is_file():
            yield path
