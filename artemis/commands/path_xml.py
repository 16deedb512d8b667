"""Points of a path from XML: GPX (tracks, routes, waypoints) and KML (lines, tracks, points)."""

from __future__ import annotations

import math
from xml.parsers import expat

from artemis.commands.path_given import Given, Place, from_places
from artemis.errors import ConfigError, shown
from artemis.motion.table import raise_first


class _Places:
    """Collects places while the parser reads; a document type is refused before any entity could be declared in it."""

    root = ""
    """Name of the outermost element."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.problems: list[str] = []
        self.segments: dict[str, list[list[Place]]] = {}
        """By the kind of the places."""
        self.counts: dict[str, int] = {}
        """How often elements were met."""
        self._within: list[str] = []
        self._parser = expat.ParserCreate(namespace_separator=" ")
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text
        self._parser.StartDoctypeDeclHandler = self._doctype
        self._parser.buffer_text = True

    def read(self, raw: bytes) -> None:
        """Read the file.

        Raises:
            ConfigError: it is not XML, or another kind of it.
        """
        try:
            self._parser.Parse(raw, True)
        except expat.ExpatError as error:
            words = expat.ErrorString(error.code)
            raise ConfigError(f"{self.source}:{error.lineno}:{error.offset + 1}: not XML: {words}") from None
        except (LookupError, ValueError) as error:  # an encoding that Python does not know, or cannot use here
            raise ConfigError(f"{self._place()}: not XML that can be read: {error}") from None

    def begun(self, name: str, attributes: dict[str, str]) -> None:
        """An element begins."""

    def ended(self, name: str, text: str) -> None:
        """An element ends, with its own text."""

    def add(self, kind: str, latitude: str | None, longitude: str | None, place: str) -> None:
        """A place of the last segment of its kind."""
        angles = self._angle("lat", latitude, 90.0, place), self._angle("lon", longitude, 180.0, place)
        if angles[0] is not None and angles[1] is not None:
            self.segments.setdefault(kind, [[]])[-1].append((angles[0], angles[1], place))

    def _place(self) -> str:
        return f"{self.source}:{self._parser.CurrentLineNumber}:{self._parser.CurrentColumnNumber + 1}"

    def _doctype(self, *_: object) -> None:
        name = self.root.upper()
        raise ConfigError(f"{self._place()}: a document type (<!DOCTYPE) is refused: {name} has none; remove it")

    def _start(self, element: str, attributes: dict[str, str]) -> None:
        name = element.rpartition(" ")[2]
        if not self._within and name != self.root:
            expected = f"expected a {self.root.upper()} file, which begins with <{self.root}>"
            raise ConfigError(f"{self._place()}: {expected}; found <{shown(name)}>")
        self._within.append(name)
        self._words: list[str] = []
        self.counts[name] = self.counts.get(name, 0) + 1
        self.begun(name, attributes)

    def _end(self, element: str) -> None:
        self.ended(self._within.pop(), "".join(self._words))
        self._words = []

    def _text(self, text: str) -> None:
        self._words.append(text)

    def _angle(self, name: str, written: str | None, bound: float, place: str) -> float | None:
        try:
            value = float(written) if written is not None else math.nan
        except ValueError:
            value = math.nan
        if abs(value) <= bound:
            return value
        found = "none" if written is None else shown(written)
        self.problems.append(f"{place}: {name}: expected -{bound:g} to {bound:g} degrees, found {found}")
        return None


class _Gpx(_Places):
    root = "gpx"

    def begun(self, name: str, attributes: dict[str, str]) -> None:
        if name in ("trkpt", "rtept", "wpt"):
            self.add(name, attributes.get("lat"), attributes.get("lon"), self._place())
        elif name == "trkseg":
            self.segments.setdefault("trkpt", []).append([])


class _Kml(_Places):
    """Coordinates are `longitude,latitude,altitude` between blanks, those of a track one in each `<gx:coord>`."""

    root = "kml"

    def begun(self, name: str, _: dict[str, str]) -> None:
        if name in ("LineString", "Track"):
            self.segments.setdefault("line", []).append([])

    def ended(self, name: str, text: str) -> None:
        around = self._within[-1] if self._within else ""
        if name == "coord":
            longitude, latitude, *_ = [*text.split(), None, None]
            self.add("line", latitude, longitude, self._place())
        elif name == "coordinates" and around in ("LineString", "Point"):
            for cell in text.split():
                longitude, latitude, *_ = [*cell.split(","), None, None]
                self.add("line" if around == "LineString" else "point", latitude, longitude, self._place())


def read_gpx(raw: bytes, source: str) -> Given:
    """The only track of a GPX file, else its only route, else its waypoints: metres from the first point.

    Raises:
        ConfigError: no GPX, a document type, no points or several tracks; with file:line:column.
    """
    gpx = _Gpx(source)
    gpx.read(raw)
    kinds = [kind for kind in ("trkpt", "rtept", "wpt") if any(gpx.segments.get(kind, ()))]
    problems = list(gpx.problems)
    if not kinds and not problems:
        problems.append(f"{source}:1:1: no track, no route and no waypoints with points (<trkpt>, <rtept>, <wpt>)")
    elif kinds and kinds[0] != "wpt":
        count, what = (gpx.counts.get("trk", 0), "tracks") if kinds[0] == "trkpt" else (gpx.counts["rte"], "routes")
        if count > 1:
            problems.append(f"{source}:1:1: {count} {what}: one file becomes one path; leave one in it")
    raise_first(problems, source)
    return from_places(gpx.segments[kinds[0]])


def read_kml(raw: bytes, source: str) -> Given:
    """The lines and tracks of a KML file in their order, else its points: metres from the first point.

    Raises:
        ConfigError: no KML, a document type, no points; with file:line:column.
    """
    kml = _Kml(source)
    kml.read(raw)
    kinds = [kind for kind in ("line", "point") if any(kml.segments.get(kind, ()))]
    if not kinds and not kml.problems:
        kml.problems.append(f"{source}:1:1: no line, no track and no point (<LineString>, <gx:Track>, <Point>)")
    raise_first(kml.problems, source)
    return from_places(kml.segments[kinds[0]])
