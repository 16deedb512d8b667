"""The map of a report: paths, and what robots drove, seen from above. An SVG element without a program for it."""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Iterator, Sequence
from html import escape
from math import degrees, log10

import numpy as np

from artemis.mapping.occupancy import OccupancyMap
from artemis.motion.arrays import Array
from artemis.report.chart_data import ShownRun
from artemis.report.series import Series

WIDTH = 1000.0
LOWEST, HIGHEST = 360.0, 760.0
"""Of the picture [px]; as its width it is scaled to the page's."""
MARGIN = 0.05
"""Around what is drawn, as a share of its larger side."""
LEAST = 0.5
"""A robot that stood is shown with so much around it [m]."""
LEFT, BELOW = 62.0, 44.0
"""Room for the numbers of the axes [px]."""
APART = 1.2
"""Points of a line are so far apart at least [px]."""
JUMP, FASTEST = 0.25, 3.0
"""A pose that moves farther [m], at more than this speed [m/s], was corrected."""
LINES = 7
"""Of the grid in each direction, about."""
PLACE = "M11 0L-8 7L-4 0L-8-7z"
"""An arrow that looks to the right [px]."""


class PathMap:
    """The picture of some runs in one frame.

    Attributes:
        svg: The element.
        names: Of everything that is drawn, in order, its class and that of its run, by its name.
    """

    def __init__(self, runs: Sequence[ShownRun]) -> None:
        """Of several runs each has its colour; of one each signal."""
        self._runs = [each.series for each in runs]
        self._view = _MapView(list(self._extent()))
        self.names: dict[str, tuple[str, str]] = {}
        parts = [self._view.grid()]
        parts += [self._view.cells(run.map) for run in self._runs[:1] if run.map is not None]
        for number, each in enumerate(runs):
            self._which = f"r{number}" if len(runs) > 1 else "single"
            parts += [
                f'<g class="{self._which}">',
                *self._run(each.series, f"{each.name}: " if each.name else ""),
                "</g>",
            ]
        kinds = [f"here r{number}" for number in range(len(runs))] if len(runs) > 1 else ["here"]
        parts += [f'<path class="{kind}" data-run="{number}" d="{PLACE}"/>' for number, kind in enumerate(kinds)]
        label = "; ".join(self.names)
        self.svg = (
            f'<svg class="map" viewBox="0 0 {WIDTH:g} {self._view.height:g}" role="img" '
            f'aria-label="Seen from above: {escape(label)}">{"".join(parts)}</svg>'
        )

    def places(self) -> list[Array]:
        """Of each run: time [s], x, y in the picture [px], heading there [deg, clockwise]; shape (n, 4)."""
        tables = []
        for run in self._runs:
            known = np.isfinite(run.estimated[:, 0])
            x, y = self._view.placed(run.estimated[known, :2]).T
            tables.append(np.column_stack([run.time[known], x, y, -np.degrees(run.estimated[known, 2])]))
        return tables

    def _extent(self) -> Iterator[Array]:
        for run in self._runs:
            yield from (run.estimated[:, :2], run.true[:, :2], *run.around.routes, *run.around.seen)
            yield from (np.column_stack([path.x, path.y]) for path in run.paths)
            if run.map is not None:
                yield run.map.points()

    def _run(self, run: Series, name: str) -> Iterator[str]:
        """Below each other: what should be driven, what was, and what happened."""
        for path in run.paths:
            yield self._line(np.column_stack([path.x, path.y]), "path", f"{name}path")
        for route in run.around.routes:
            yield self._line(route, "route", f"{name}planned route")
        yield self._dots(np.concatenate([np.empty((0, 2)), *run.around.seen]), "seen", f"{name}seen then", 1.5)
        if np.isfinite(run.true[:, 0]).any():
            yield self._line(run.true, "true", f"{name}driven (true)", run.time)
        if run.source != "odometry":
            yield self._line(run.odometry, "odometry", f"{name}by odometry alone", run.time)
        yield self._line(run.estimated, "estimated", f"{name}driven ({run.source or 'no pose'})", run.time)
        slowed = run.estimated[np.isfinite(run.slowed), :2]
        yield self._dots(slowed, "slowed", f"{name}slowed for an obstacle", 3.5)
        known = run.estimated[np.isfinite(run.estimated[:, 0])]
        if not len(known):
            return
        found = run.estimated[np.isfinite(run.std)] if run.source != "odometry" else known
        yield self._mark(PLACE, (found if len(found) else known)[0], "start", f"{name}start")
        yield self._mark("M-6-6H6V6H-6z", known[-1] * (1, 1, 0), "end", f"{name}end")
        times = [entry.time for entry in run.entries if entry.kind == "fault"]
        rows = np.unique(np.searchsorted(run.time, times).clip(0, len(run.time) - 1))
        for x, y, _ in run.estimated[rows[np.isfinite(run.estimated[rows, 0])]]:
            yield self._mark("M-7-7L7 7M-7 7L7-7", (x, y, 0.0), "fault", f"{name}fault")

    def _line(self, points: Array, kind: str, name: str, time: Array | None = None) -> str:
        """With the time of each point [s] it is broken where no robot drove, but the pose was corrected."""
        known = np.isfinite(points[:, 0])
        points = points[known, :2]
        if not len(points):
            return ""
        self.names.setdefault(name, (kind, self._which))
        pieces = [points]
        if time is not None:
            steps = np.hypot(*np.diff(points, axis=0).T)
            pieces = np.split(points, np.flatnonzero(steps > JUMP + FASTEST * np.diff(time[known])) + 1)
        drawn = "".join(_path(self._view.thinned(piece)) for piece in pieces)
        return f'<path class="{kind}" d="{drawn}"/>'

    def _dots(self, points: Array, kind: str, name: str, size: float) -> str:
        if not len(points):
            return ""
        self.names.setdefault(name, (kind, self._which))
        shown = np.unique(np.rint(self._view.placed(points)), axis=0)
        ends = "".join(f"M{x:g} {y:g}h0" for x, y in shown.tolist())
        return f'<path class="{kind}" stroke-linecap="round" stroke-width="{2 * size:g}" d="{ends}"/>'

    def _mark(self, shape: str, pose: Sequence[float] | Array, kind: str, name: str) -> str:
        self.names.setdefault(name, (kind, self._which))
        x, y = self._view.placed(np.array([pose[:2]]))[0].tolist()
        turn = f" rotate({-degrees(pose[2]):.1f})" if pose[2] else ""
        return f'<path class="{kind}" transform="translate({x:.1f} {y:.1f}){turn}" d="{shape}"/>'


class _MapView:
    """Metres of a frame to pixels of the picture, y upwards to y downwards."""

    def __init__(self, drawn: Sequence[Array]) -> None:
        known = np.concatenate([np.empty((0, 2)), *(each[:, :2] for each in drawn)])
        known = known[np.isfinite(known).all(axis=1)]
        low, high = (known.min(axis=0), known.max(axis=0)) if len(known) else (np.zeros(2), np.zeros(2))
        side = max(float((high - low).max()), LEAST)
        middle, size = (low + high) / 2, np.maximum(high - low, LEAST) + 2 * MARGIN * side
        room = WIDTH - LEFT
        self.height = float(np.clip(room * size[1] / size[0], LOWEST, HIGHEST)) + BELOW
        self._scale = min(room / size[0], (self.height - BELOW) / size[1])
        """[px/m]"""
        self._low = middle - np.array([room, self.height - BELOW]) / 2 / self._scale
        self._high = middle + np.array([room, self.height - BELOW]) / 2 / self._scale

    def placed(self, points: Array) -> Array:
        """Pixels of points [m], shape (n, 2)."""
        x, y = ((points[:, :2] - self._low) * self._scale).T
        return np.column_stack([LEFT + x, self.height - BELOW - y])

    def thinned(self, points: Array) -> Array:
        """Pixels of a line, without points that nobody could tell apart."""
        shown = self.placed(points)
        distance = np.append(0.0, np.cumsum(np.hypot(*np.diff(shown, axis=0).T)))
        kept = np.unique(np.append(np.unique(distance // APART, return_index=True)[1], len(shown) - 1))
        thin: Array = shown[kept]
        return thin

    def grid(self) -> str:
        """Lines at round numbers, the numbers, and the names of the axes."""
        step = _round_step(float((self._high - self._low).max()) / LINES)
        bottom, texts, ends = self.height - BELOW, [], ""
        for x in _multiples(self._low[0], self._high[0], step):
            at = LEFT + (x - self._low[0]) * self._scale
            ends += f"M{at:.1f} 0V{bottom:.1f}"
            texts.append(f'<text x="{at:.1f}" y="{bottom + 18:.1f}" class="x">{x:g}</text>')
        for y in _multiples(self._low[1], self._high[1], step):
            at = bottom - (y - self._low[1]) * self._scale
            ends += f"M{LEFT:g} {at:.1f}H{WIDTH:g}"
            texts.append(f'<text x="{LEFT - 8:g}" y="{at + 4:.1f}" class="y">{y:g}</text>')
        texts.append(f'<text x="{(LEFT + WIDTH) / 2:g}" y="{self.height - 4:.1f}" class="x axis">x [m]</text>')
        texts.append(f'<text transform="translate(14 {bottom / 2:.1f}) rotate(-90)" class="x axis">y [m]</text>')
        return f'<path class="grid" d="{ends}"/>{"".join(texts)}'

    def cells(self, content: OccupancyMap) -> str:
        """A map, faintly, with nothing where nothing is known or all is free."""
        x, y, heading = content.origin
        rows, columns = content.cells.shape
        ((px, py),) = self.placed(np.array([[x, y]])).tolist()
        side = content.resolution * self._scale
        # The picture's rows go down and ours go up, so it is laid with its lower left corner at the origin.
        move = f"translate({px:.2f} {py:.2f}) rotate({-degrees(heading):.4f}) scale({side:.5f})"
        return (
            f'<svg x="{LEFT:g}" y="0" width="{WIDTH - LEFT:g}" height="{self.height - BELOW:.1f}" '
            f'viewBox="{LEFT:g} 0 {WIDTH - LEFT:g} {self.height - BELOW:.1f}">'
            f'<image class="cells" transform="{move}" y="{-rows}" width="{columns}" height="{rows}" '
            f'preserveAspectRatio="none" href="data:image/png;base64,{_png(content)}"/></svg>'
        )


def _path(points: Array) -> str:
    """A line of an SVG path, in tenths of pixels of which only the differences are written."""
    steps = np.diff(np.rint(10 * points), axis=0) / 10
    rest = " ".join(f"{x:g} {y:g}" for x, y in steps.tolist())
    return f"M{points[0, 0]:.1f} {points[0, 1]:.1f}l{rest or '0 0'}"


def _png(content: OccupancyMap) -> str:
    """Occupied cells black, others as clear as they are free or unknown; base64."""
    shade = np.maximum(content.cells[::-1], 0).astype(np.float64) / 100
    grey_alpha = np.zeros((*shade.shape, 2), dtype=np.uint8)
    grey_alpha[..., 0] = 110
    grey_alpha[..., 1] = np.rint(255 * shade)
    lines = np.column_stack([np.zeros(len(shade), dtype=np.uint8), grey_alpha.reshape(len(shade), -1)]).tobytes()

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", shade.shape[1], shade.shape[0], 8, 4, 0, 0, 0)
    parts = chunk(b"IHDR", head), chunk(b"IDAT", zlib.compress(lines, 9)), chunk(b"IEND", b"")
    return base64.b64encode(b"\x89PNG\r\n\x1a\n" + b"".join(parts)).decode()


def _round_step(about: float) -> float:
    """The next larger of 1, 2, 5 times a power of ten."""
    power = 10.0 ** np.floor(log10(about))
    return next(float(factor * power) for factor in (1, 2, 5, 10) if factor * power >= about)


def _multiples(low: float, high: float, step: float) -> list[float]:
    numbers = np.arange(np.ceil(low / step), np.floor(high / step) + 1)
    return [float(f"{number * step:.9g}") + 0.0 for number in numbers.tolist()]
