"""The files that a mission names: tables, and earlier runs; and what a misspelt name may have meant."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path as FilePath

from artemis.errors import ConfigError, RecordingError
from artemis.yaml_file import read

MAX_DATA_BYTES = 100_000_000
"""Of a path or another table."""
_MAX_CANDIDATES = 1000
_MAGIC = b"\x89MCAP0\r\n"
"""An MCAP file begins so (MCAP specification, "Magic")."""


def read_table(path: FilePath) -> bytes:
    """Content of a file of at most `MAX_DATA_BYTES`. ConfigError where it cannot be read."""
    return read(path, MAX_DATA_BYTES)


def read_data(path: FilePath) -> bytes:
    """The same; but of a run's folder, or its recording, what its inputs gave, as a file of these.

    Raises:
        ConfigError: it cannot be read, or the recording is not whole.
    """
    if not _is_run(path):
        return read_table(path)
    from artemis.plugins.inputs.recorded import InputTick, content_of
    from artemis.recording.mcap_reader import Recording

    try:
        recording = Recording(path)
        if recording.missing:
            raise ConfigError(f"{path}: the recording is not whole: {recording.missing}")
        content = content_of(InputTick(tick.snapshot.time, tick.snapshot.sensed.inputs) for tick in recording.ticks())
    except RecordingError as error:
        reason = str(error).removeprefix(f"{path}: ")
        raise ConfigError(f"{path}: {reason}") from error
    if not content:
        raise ConfigError(f"{path}: the run has no tick")
    if len(content) > MAX_DATA_BYTES:
        raise ConfigError(f"{path}: what its inputs gave is larger than {MAX_DATA_BYTES} bytes")
    return content


def files_like(folder: FilePath, name: str) -> list[str]:
    """Files near the mission that end like `name`, as the mission would name them."""
    found = islice(_near(folder), _MAX_CANDIDATES)
    suffix = FilePath(name).suffix
    return sorted(file.relative_to(folder).as_posix() for file in found if file.suffix == suffix and file.is_file())


def _near(folder: FilePath) -> Iterator[FilePath]:
    yield from folder.glob("*")
    yield from folder.glob("*/*")


def _is_run(path: FilePath) -> bool:
    if path.is_dir():
        return (path / "recording.mcap").is_file()
    if not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except OSError:  # who reads it says why
        return False
