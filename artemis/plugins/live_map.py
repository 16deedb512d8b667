"""A map that is made while the robot drives: beside the ticks, and its loops beside the scans."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import ClassVar

from artemis.config import Config
from artemis.devices.can_bus import Traffic
from artemis.errors import ConfigError
from artemis.localisation.warming import warm_up
from artemis.mapping.graph_file import MapGraph, saved_files
from artemis.mapping.mapper import Mapper
from artemis.mapping.occupancy import OccupancyMap, ShownMap, coarser, occupancy
from artemis.mapping.readings import ScanReadings
from artemis.mapping.se2 import Array, between, compose
from artemis.mapping.tracking import NewKey
from artemis.plugins.observing import Beside
from artemis.values import Pose, Tick
from artemis.whole_files import write_bytes

NAME = "map"
"""Of the thread, and of the files in the run's folder."""
SHOWN_EVERY = 5.0
"""Whoever watches is shown a new map so often [s], as long as something new is seen."""
SHOWN_PER_KEY = 0.02
"""And no more often than this for each key scan [s]: every one of them is drawn anew."""


class LiveMap:
    """An observer that maps what one scanner sees, and writes the map when it is closed.

    In real time its thread matches the scans, and another one looks for loops, solves, and never holds the first one
    up. The map is that which `artemis map build` makes of the run's recording, unless ticks were missed.

    Key scans that wait for their loops are never dropped, nor is their number limited: the map keeps each of them
    anyway, so those that wait need no memory that it would not need once they are done.
    """

    Config: ClassVar[type[Config]] = Config

    def __init__(
        self,
        readings: ScanReadings,
        files: Sequence[Path],
        resolution: float,
        say: Callable[[str], None],
        *,
        threaded: bool,
        refused: Callable[[Path], str] = lambda file: "",
    ) -> None:
        """Begin.

        Args:
            readings: make readings of the ticks.
            files: the YAML files to write.
            resolution: side of the cells [m].
            say: is called with what was made.
            threaded: look for loops in a thread of its own.
            refused: asked at the end why one of them is not to be written; empty: it is.
        """
        self._readings, self._files, self._resolution = readings, files, resolution
        self._say, self._refused = say, refused
        self.made, self.unmade = list[str](), list[str]()
        """The files that were written, and of the others why not."""
        self._broken: BaseException | None = None
        self._shown: ShownMap | None = None
        self._watched, self._show_waits, self._next, self._station = False, False, 0.0, -1
        self._closing: Beside[None] = Beside(
            f"{NAME} loops", lambda nothing: None, threaded=threaded, failed=self._failed
        )
        if threaded:
            warm_up()
        self._mapper = Mapper(later=self._later)

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        """Take the scans of a tick."""
        if self._broken is not None:
            raise self._broken
        for reading in self._readings.see(tick):
            self._mapper.add(reading)
            station = self._mapper.station
            due = self._watched and not self._show_waits and reading.time >= self._next
            if due and station != self._station:
                pause = max(SHOWN_EVERY, SHOWN_PER_KEY * len(self._mapper.keys))
                self._next, self._station, self._show_waits = reading.time + pause, station, True
                self._closing.order(self._show, station, reading.odometry)

    def take_problems(self) -> list[tuple[str, str, str]]:
        """None: what goes wrong is raised."""
        return []

    def close(self) -> None:
        """Finish the map and write it."""
        self._closing.close()
        if self._broken is not None:
            raise self._broken
        mapper = self._mapper
        if not mapper.keys:
            self.unmade.append("no scan was seen")
            return
        mapper.finish()
        graph = mapper.result()
        try:
            content = occupancy(mapper.keys, self._resolution)
        except ValueError as error:
            self.unmade += [f"{file}: {error}" for file in self._files]
        else:
            self._write(content, graph)
            if note := coarser(content, self._resolution):
                self._say(f"map: {note}")
        counts = mapper.counts
        self._say(
            f"map: {counts.scans} scans, {counts.unmatched} matched nowhere; {len(mapper.keys)} make it up, with "
            f"{len(mapper.graph.loops)} loops: {', '.join(self.made) or 'no file'}"
        )

    def _write(self, content: OccupancyMap, graph: MapGraph) -> None:
        for file in self._files:
            if why := self._refused(file):
                self.unmade.append(f"{file}: {why}")
                continue
            try:
                write_bytes(saved_files(file, content, graph))
                self.made.append(str(file))
            except ConfigError as error:
                self.unmade.append(f"{file}: {error}")

    def shown(self) -> ShownMap | None:
        """The map as it is about now; None: not yet. Who has asked once is shown a new one again and again."""
        self._watched = True
        return self._shown

    def _show(self, station: int, odometry: Array) -> None:
        """Where the loops are found, behind the key scan of the station: the poses stay as they are meanwhile."""
        self._show_waits = False
        try:
            content = occupancy(self._mapper.keys, self._resolution)
        except ValueError:  # `close` says what is wrong
            return
        x, y, heading = compose(self._mapper.pose_of(station), between(odometry, [0.0, 0.0, 0.0])).tolist()
        self._shown = ShownMap(content=content, odometry=Pose(x=x, y=y, heading=heading))

    def _later(self, work: Callable[[NewKey], None], key: NewKey) -> None:
        self._closing.order(work, key)

    def _failed(self, error: BaseException) -> None:
        self._broken = error
