"""Maps as map_server and Nav2 keep them: a YAML file beside an image (PGM).

Keys and meaning: documentation of ROS' map_server and of Nav2's map_io. Image rows run from the top, row 0 is the
largest y. Of values on a bound of a threshold the two readers disagree, so none is written.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from artemis.errors import ConfigError, shown
from artemis.mapping.occupancy import FREE, MOST_CELLS, OCCUPIED, UNKNOWN, OccupancyMap
from artemis.yaml_file import Data, Document, load, read

GREY_FREE, GREY_OCCUPIED, GREY_UNKNOWN = 254, 0, 205
FREE_UP_TO, OCCUPIED_FROM = 25, 65
"""Percent, as the savers of ROS write."""
_UNKNOWN_PROBABILITY = (255 - GREY_UNKNOWN) / 255
"""As readers take what savers write for unknown: 0.1961, just above the 0.196 that belongs to it."""
MODES = ("trinary", "scale", "raw")
KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode")
_TOKEN = re.compile(rb"(?:\s|#[^\n]*\n)*([^\s#]+)")
_MOST_BYTES = 4 * MOST_CELLS
_MOST_BEHIND = 4
"""Blanks and line ends that an editor wrote behind the last pixel [bytes]."""


def map_files(path: Path, content: OccupancyMap) -> dict[Path, bytes]:
    """The YAML file `path` and the image beside it, to be written."""
    image = path.with_suffix(".pgm")
    cells = content.cells
    grey = np.full(cells.shape, GREY_UNKNOWN, np.uint8)
    grey[(cells >= 0) & (cells <= FREE_UP_TO)] = GREY_FREE
    grey[cells >= OCCUPIED_FROM] = GREY_OCCUPIED
    rows, columns = cells.shape
    head = f"P5\n# artemis {content.resolution:.3f} m/pix\n{columns} {rows}\n255\n".encode()
    x, y, heading = (float(f"{each:.9g}") for each in content.origin)
    text = (
        f"image: {image.name}\nmode: trinary\nresolution: {content.resolution:.9g}\n"
        f"origin: [{x!r}, {y!r}, {heading!r}]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return {image: head + grey[::-1].tobytes(), path: text.encode()}


def read_map(path: Path) -> OccupancyMap:
    """The map of a YAML file and its image.

    Raises:
        ConfigError: everything that is wrong, each with file, line and column.
    """
    return map_from(load(path), path.parent, lambda image: read_image(path.parent / image))


def map_from(document: Document, folder: Path, content: Callable[[str], bytes]) -> OccupancyMap:
    """The map that a YAML file describes.

    Args:
        document: of the file.
        folder: where it is.
        content: of the image, by the name that the file gives it.

    Raises:
        ConfigError: everything that is wrong, each with file, line and column.
    """
    keys = MapKeys(document)
    if keys.problems:
        raise ConfigError(keys.problems)
    return keys.map_of(content(keys.image), str(folder / keys.image))


def read_image(path: Path) -> bytes:
    """The image of a map as it is in its file.

    Raises:
        ConfigError: it cannot be read, or is too large.
    """
    return read(path, _MOST_BYTES)


@dataclass(frozen=True, slots=True)
class _Thresholds:
    free: float
    occupied: float


class MapKeys:
    """What a map's YAML file says.

    Attributes:
        problems: what is wrong, each with file, line and column; if there is any, nothing else counts.
        image: name of the image, from the folder of the file.
        resolution: side of a cell [m].
        origin: as that of `OccupancyMap`.
    """

    def __init__(self, document: Document) -> None:
        self._document, self.problems = document, list[str]()
        data = document.data if isinstance(document.data, dict) else {}
        image = data.get("image")
        self.image = image if isinstance(image, str) else ""
        if data.keys().isdisjoint(KEYS):
            self._complain((), f"expected {', '.join(KEYS)}; is it the YAML file of a map?")
            return
        for key in data:
            if key not in KEYS:
                self._complain((key,), f"unknown key; a map has {', '.join(KEYS)}")
        self._data = data
        if not self.image:
            self._expected("the name of a PGM file", image, ("image",))
        self.resolution = self._number("resolution", 1e-4, 100.0)
        self.origin = self._origin()
        self._limits = _Thresholds(self._number("free_thresh", 0, 1), self._number("occupied_thresh", 0, 1))
        if not self.problems and self._limits.free > self._limits.occupied:
            self._complain(("free_thresh",), "is above occupied_thresh")
        negate = data.get("negate", 0)
        if negate not in (0, 1):
            self._complain(("negate",), f"expected 0 or 1, not {shown(negate)}")
        self._negate = bool(negate)
        self._mode = data.get("mode", MODES[0])
        if self._mode not in MODES:
            self._complain(("mode",), f"expected {', '.join(MODES)}, not {shown(self._mode)}")

    def map_of(self, image: bytes, source: str) -> OccupancyMap:
        """The map, with the content of its image.

        Raises:
            ConfigError: it is no image, or is cut off, or the thresholds make unknown cells free.
        """
        cells = self._cells(read_pgm(image, source)[::-1])
        return OccupancyMap(cells=cells, resolution=self.resolution, origin=self.origin)

    def _cells(self, grey: NDArray[np.uint8]) -> NDArray[np.int8]:
        """Probabilities [%] of an image whose row 0 is the lowest."""
        value = np.arange(256)
        if self._mode == "raw":
            raw = value[::-1] if self._negate else value
            return np.where(raw > OCCUPIED, UNKNOWN, raw).astype(np.int8)[grey]
        probability = (value if self._negate else value[::-1]) / 255
        free, occupied = self._limits.free, self._limits.occupied
        if self._mode == MODES[0]:
            self._refuse_unknown_as_free(int(np.count_nonzero((probability == _UNKNOWN_PROBABILITY)[grey])), grey.size)
        cells = np.full(256, UNKNOWN, np.int8)
        if self._mode == "scale":
            between = (probability - free) / max(occupied - free, 1e-9)
            cells = np.rint(100 * between.clip(0, 1)).astype(np.int8)
        cells[probability <= free] = FREE
        cells[probability >= occupied] = OCCUPIED
        return cells[grey]

    def _refuse_unknown_as_free(self, unknown: int, cells: int) -> None:
        """Refuse a threshold by which cells that the savers of ROS wrote as unknown would be free."""
        if unknown and self._limits.free >= _UNKNOWN_PROBABILITY:
            text = (
                f"{self._limits.free:g} makes free what savers write for unknown, {unknown} of {cells} cells "
                "(Nav2's wrote 0.25 beside such images until 2025); write free_thresh: 0.196, or mode: scale "
                "if the greys of the image are probabilities"
            )
            raise ConfigError([self._document.problem(("free_thresh",), text)])

    def _complain(self, path: tuple[str | int, ...], text: str) -> None:
        self.problems.append(self._document.problem(path, text))

    def _expected(self, what: str, value: Data, path: tuple[str | int, ...]) -> None:
        """Complain about a key's value, or that the file does not have the key."""
        missing = len(path) == 1 and path[0] not in self._data
        found = "nothing" if value is None else shown(value)
        self._complain(path, "this key is missing" if missing else f"expected {what}, not {found}")

    def _number(self, key: str, least: float, most: float) -> float:
        return self._checked(self._data.get(key), (key,), least, most)

    def _checked(self, value: Data, path: tuple[str | int, ...], least: float, most: float) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
            self._expected(f"a number from {least:g} to {most:g}", value, path)
            return least
        return float(value)

    def _origin(self) -> tuple[float, float, float]:
        value = self._data.get("origin")
        if not isinstance(value, list) or len(value) != 3:
            self._expected("[x, y, yaw]", value, ("origin",))
            return 0.0, 0.0, 0.0
        x, y, yaw = (self._checked(each, ("origin", number), -1e6, 1e6) for number, each in enumerate(value))
        return x, y, math.remainder(yaw, math.tau)


def read_pgm(raw: bytes, source: str) -> NDArray[np.uint8]:
    """The grey values of an image, 0 to 255, its top row first: PGM, as text (P2) or bytes (P5), with comments.

    Raises:
        ConfigError: it is no such image, or has not as many pixels as its header says.
    """
    position, words = 0, list[bytes]()
    for _ in range(4):
        found = _TOKEN.match(raw, position)
        if found is None:
            raise ConfigError(f"{source}:{_line(raw, len(raw))}: ends in its header")
        words.append(found[1])
        position = found.end()
        if words[0] not in (b"P2", b"P5"):
            raise ConfigError(f"{source}:1: begins with {shown(words[0][:8])}; {_converted(source)}")
    try:
        columns, rows, most = (int(word) for word in words[1:])
    except ValueError:
        raise ConfigError(f"{source}:{_line(raw, position)}: expected width, height and the highest value") from None
    if problem := _unlike_a_map(columns, rows, most, source):
        raise ConfigError(f"{source}:{_line(raw, position)}: {problem}")
    if words[0] == b"P5":
        values = np.frombuffer(raw, np.uint8, offset=min(position + 1, len(raw)))
        if len(values) <= rows * columns + _MOST_BEHIND and not raw[position + 1 + rows * columns :].strip():
            values = values[: rows * columns]
    else:
        values = _numbers(raw, position, source, most)
    if len(values) < rows * columns:
        raise ConfigError(f"{source}: cut off: {len(values)} of {rows * columns} pixels")
    if len(values) > rows * columns:
        raise ConfigError(
            f"{source}: {len(values)} pixels instead of {columns} x {rows}: are width and height in its header wrong?"
        )
    if int(values.max()) > most:
        raise _no_grey(source, int(values[values > most][0]), most)
    scaled = (np.arange(most + 1) * 255 // most).astype(np.uint8)
    return scaled[values].reshape(rows, columns)


def _unlike_a_map(columns: int, rows: int, most: int, source: str) -> str:
    """What is wrong with these numbers of a header; empty: nothing."""
    size = f"{shown(columns)} x {shown(rows)} pixels"
    if columns < 1 or rows < 1:
        return f"{size}; expected 1 x 1 at least"
    if columns * rows > MOST_CELLS:
        return f"{size}; expected {MOST_CELLS} at most"
    if 0 < most <= 255:
        return ""
    remedy = _converted(source) if 255 < most <= 65535 else "expected 1 to 255"
    return f"its highest value is {shown(most)}; {remedy}"


def _converted(source: str) -> str:
    """How another image becomes one that is read."""
    return (
        f"expected a PGM image (P2 or P5) of 8 bits: `convert {Path(source).name} -depth 8 NEW.pgm` (ImageMagick; from "
        "version 7: `magick`) writes one; name it in the map's YAML file"
    )


def _numbers(raw: bytes, position: int, source: str, most: int) -> NDArray[np.uint8]:
    """The pixels of an image as text."""
    try:
        numbers = [int(word) for word in re.sub(rb"#[^\n]*", b"", raw[position:]).split()]
    except ValueError:
        raise ConfigError(f"{source}:{_line(raw, position)}: pixels that are no numbers follow") from None
    for number in numbers:
        if not 0 <= number <= most:
            raise _no_grey(source, number, most)
    return np.array(numbers, np.uint8)


def _no_grey(source: str, value: int, most: int) -> ConfigError:
    return ConfigError(f"{source}: a pixel of {shown(value)}; the header says 0 to {most}")


def _line(raw: bytes, position: int) -> int:
    return raw.count(b"\n", 0, position) + 1
