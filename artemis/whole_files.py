"""Files that are written whole or not at all: what was there stays where the disk refuses."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from pathlib import Path

from artemis.errors import ConfigError


def write_bytes(files: Mapping[Path, bytes]) -> None:
    """Write all of them or none: each is there whole, or as it was.

    Raises:
        ConfigError: one cannot be written.
    """
    file = Path()
    parts = {file: file.with_name(f"{file.name}.part") for file in files}
    try:
        for file, content in files.items():
            parts[file].write_bytes(content)
        for file, part in parts.items():
            part.replace(file)
    except OSError as error:
        for part in parts.values():
            with suppress(OSError):
                if part.is_file():
                    part.unlink()
        raise ConfigError(f"{file}: cannot be written: {error.strerror}") from error


def replace_content(path: Path, content: bytes) -> None:
    """Write a file that is there anew; either all of it or nothing.

    Raises:
        ConfigError: it cannot be written.
    """
    try:
        mode = path.stat().st_mode & 0o7777
        if not mode & 0o222:
            raise ConfigError(f"{path}: is read-only")
        with ExitStack() as undo:
            file = tempfile.NamedTemporaryFile(dir=path.resolve().parent, prefix=f".{path.name}.", delete=False)
            temporary = Path(file.name)
            undo.callback(temporary.unlink)
            with file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            temporary.chmod(mode)
            temporary.replace(path.resolve())
            undo.pop_all()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error
