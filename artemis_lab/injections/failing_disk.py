"""A disk that refuses when a test says so."""

from __future__ import annotations

import os
from io import FileIO
from pathlib import Path
from typing import Literal

from artemis.recording.disk import Disk


class FailingDisk(Disk):
    """Files whose names begin with a given word fail, from now on; others, and until then, all is well."""

    def __init__(self, *, at_once: int | None = None, free: int = 10**12) -> None:
        """`at_once`: bytes that one write takes at most; `free`: bytes of room that the disk tells of."""
        self._at_once, self._free = at_once, free
        self._name, self._error, self._after = "", 0, 0

    def fail(self, name: str, error: int, after: int = 0) -> None:
        """Files that begin with `name` fail with errno `error`, once `after` bytes more were taken."""
        self._name, self._error, self._after = name, error, after

    def heal(self) -> None:
        """All is well again."""
        self._error = 0

    def open(self, path: Path, mode: Literal["w", "x"]) -> FileIO:
        """A file that asks this disk."""
        return _File(path, mode, self)

    def free(self, folder: Path) -> int:
        """As the test says."""
        return self._free

    def take(self, name: str, data: memoryview) -> memoryview:
        """What is written of `data` to a file. Raises OSError: nothing."""
        taken = data if self._at_once is None else data[: self._at_once]
        if self._error and name.startswith(self._name):
            if self._after <= 0:
                raise OSError(self._error, os.strerror(self._error))
            taken = taken[: self._after]
            self._after -= len(taken)
        return taken


class _File(FileIO):
    def __init__(self, path: Path, mode: Literal["w", "x"], disk: FailingDisk) -> None:
        super().__init__(path, mode)
        self._disk, self._file_name = disk, path.name

    def write(self, data: memoryview) -> int:  # type: ignore[override]
        return super().write(self._disk.take(self._file_name, data))
