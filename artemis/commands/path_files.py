"""Path files are written whole or not at all, and never over others unasked; options that several commands have."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

from artemis.errors import ConfigError
from artemis.motion.path import Path as Curve
from artemis.motion.path import place_on
from artemis.whole_files import write_bytes


def write_files(files: Mapping[Path, str], force: bool) -> None:
    """Write all of them or none.

    Raises:
        ConfigError: one is there already (unless `force`), or cannot be written.
    """
    refuse_taken(files, force)
    write_bytes({file: text.encode() for file, text in files.items()})


def refuse_taken(files: Iterable[Path], force: bool) -> None:
    """Refuse files that are there already (unless `force`), and those that cannot be.

    Raises:
        ConfigError: all of them.
    """
    problems = []
    for file in files:
        if file.is_dir():
            problems.append(f"{file}: is a folder; name a file")
        elif not file.parent.is_dir():
            problems.append(f"{file.parent}: no such folder")
        elif file.exists() and not force:
            problems.append(f"{file}: exists already; choose another name or --force")
    if problems:
        raise ConfigError(list(dict.fromkeys(problems)))


def refuse_smoothing(smoothing: float | None) -> list[str]:
    """Why the wavelength [m] of a smoothing makes no sense."""
    return [] if smoothing is None or 0 <= smoothing <= 5 else [f"--smoothing {smoothing:g}: expected 0 to 5 m"]


def comments(lines: Iterable[str]) -> str:
    """Lines at the head of a table."""
    return "".join(f"# {printable(line)}\n" for line in lines)


def printable(text: str) -> str:
    """As it is, or with escapes."""
    return text if text.isprintable() else ascii(text)


def say(file: Path, words: Iterable[str]) -> None:
    """Print lines about a file."""
    sys.stdout.writelines(f"{file}: {line}\n" for line in words)


def keeps_up(path: Curve, highest: float, bounded_at: int | None) -> str:
    """Words for the result of `highest_speed`; rounded down, so that it holds."""
    place = "" if bounded_at is None else f"; tightest for it is {place_on(path, bounded_at)}"
    return f"the steering keeps up to {math.floor(100 * highest) / 100:.2f} m/s{place}"
