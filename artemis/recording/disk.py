"""The disk that runs are recorded on: its files, its room, and what it means when it refuses."""

from __future__ import annotations

import errno
import os
import shutil
from io import FileIO
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

from artemis.errors import ConfigError, RecordingError
from artemis.whole_files import write_bytes

MIN_FREE = 500_000_000
"""With fewer free bytes a run is not begun where nobody watches it (DSK-01)."""
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class Disk:
    """The file system as a run uses it. A test hands in another one, whose files fail."""

    def open(self, path: Path, mode: Literal["w", "x"]) -> FileIO:
        """A file to write, unbuffered; `x`: that is not there yet.

        Raises:
            OSError: it cannot be made.
        """
        return FileIO(path, mode)

    def free(self, folder: Path) -> int:
        """Bytes that are free where `folder` is, or will be made."""
        folder = folder.absolute()
        return shutil.disk_usage(next(place for place in (folder, *folder.parents) if place.exists())).free


class Trouble(NamedTuple):
    """What a disk does to a recording."""

    id: str
    """Row of the fault table."""
    detail: str
    journal: bool = False
    """It is the journal that cannot be written."""


def trouble(error: OSError, file: Path, *, journal: bool = False) -> Trouble:
    """The fault that an error of the disk is: full (DSK-02), or broken (DSK-05)."""
    return Trouble("DSK-02" if error.errno in FULL else "DSK-05", f"{file.name}: {error.strerror}", journal)


class Writable(Protocol):
    """What bytes are written to."""

    def write(self, data: memoryview, /) -> int | None:
        """Write some of it; how many bytes."""


def write_all(file: Writable, data: bytes) -> None:
    """Write all of `data`, however little the disk takes at once.

    Raises:
        OSError: the disk refuses; some of it may be in the file.
    """
    left = memoryview(data)
    while left:
        written = file.write(left)
        if not written:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        left = left[written:]


def write_whole(file: Path, text: str) -> None:
    """Put a file there, whole or not at all: what was there stays if the disk refuses.

    Raises:
        RecordingError: it cannot be written.
    """
    try:
        write_bytes({file: text.encode()})
    except ConfigError as error:
        raise RecordingError(str(error)) from error


def low_disk(folder: Path, disk: Disk) -> str | None:
    """DSK-01: what is wrong with the room for a run's folder in `folder`; None: there is enough.

    Raises:
        RecordingError: the disk does not tell.
    """
    try:
        free = disk.free(folder)
    except OSError as error:
        raise RecordingError(f"{folder}: its free space cannot be read: {error.strerror}") from error
    if free >= MIN_FREE:
        return None
    return (
        f"DSK-01 disk nearly full: {free / 1e6:.0f} MB free for the recording in {folder}, {MIN_FREE / 1e6:.0f} MB are "
        "needed; free space, or name a folder on another disk with `record:`"
    )
