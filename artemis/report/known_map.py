"""The map that a run was localised on, or that it made."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from artemis.errors import ConfigError
from artemis.mapping.map_file import map_from, read_map
from artemis.mapping.occupancy import OccupancyMap
from artemis.mapping.se2 import Array, between, compose
from artemis.plugins.used import localizer_used
from artemis.recording.mcap_reader import Recording
from artemis.yaml_file import survey

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_UNKNOWN_GREY = 0.87


def known_map(recording: Recording) -> OccupancyMap | None:
    """Of its localizer, or on which it drove to places; None: none, or the recording does not hold it whole."""
    mission, files = recording.mission, recording.files
    simulated = mission.get("bus") == "simulation"  # a recording names it where `--simulate` was said, too
    name = (localizer_used(mission, simulated=simulated) or {}).get("map") or next(_gone_to(mission), None)
    if not isinstance(name, str) or name not in files:
        return None
    folder = PurePosixPath(name).parent
    try:
        document, problems = survey(files[name], name)
        return None if problems else map_from(document, Path(folder), lambda image: files[str(folder / image)])
    except (ConfigError, KeyError):
        return None


def _gone_to(part: object) -> Iterator[object]:
    """Maps of the steps `goto` in a part of a mission."""
    if isinstance(part, dict):
        if isinstance(goto := part.get("goto"), dict):
            yield goto.get("map")
        part = list(part.values())
    for each in part if isinstance(part, list) else ():
        yield from _gone_to(each)


def made_map(folder: Path, time: Array, estimated: Array) -> OccupancyMap | None:
    """The map in the folder of a run, laid under it: both agree where the robot was when it began to drive.

    Args:
        folder: of the run.
        time: of its ticks [s].
        estimated: where it believed to be then, from when it was placed; nan before, shape (n, 3).

    Raises:
        ConfigError: it cannot be read.
    """
    file = folder / "map.yaml"
    if not file.exists():
        return None
    from artemis.mapping.graph_file import SUFFIX, read_graph  # imports scipy, which few reports need

    trajectory, known = read_graph(file.with_suffix(SUFFIX)).trajectory, np.flatnonzero(np.isfinite(estimated[:, 0]))
    if not len(known) or not len(trajectory):
        return None
    at = int(np.abs(trajectory[:, 0] - time[known[0]]).argmin())
    content = read_map(file)
    to_run = compose(estimated[known[0]], between(trajectory[at, 1:], np.zeros(3)))
    x, y, heading = compose(to_run, np.array(content.origin)).tolist()
    return replace(content, origin=(x, y, heading))


def draw_cells(axes: Axes, content: OccupancyMap) -> None:
    """Cells in grey, in the frame of the map."""
    from matplotlib.transforms import Affine2D  # takes long, and who only reads a recording needs none

    cells = content.cells
    grey = np.where(cells < 0, _UNKNOWN_GREY, 1 - cells / 100)
    rows, columns = cells.shape
    x, y, heading = content.origin
    image = axes.imshow(
        grey,
        cmap="gray",
        vmin=0,
        vmax=1,
        origin="lower",
        interpolation="nearest",
        extent=(0, columns * content.resolution, 0, rows * content.resolution),
        zorder=0,
    )
    image.set_transform(Affine2D().rotate(heading).translate(x, y) + axes.transData)


def corners(content: OccupancyMap) -> tuple[tuple[float, float], tuple[float, float]]:
    """Least and largest x, least and largest y of a map [m]."""
    rows, columns = content.cells.shape
    x, y, heading = content.origin
    ends = np.array([(0, 0), (columns, 0), (columns, rows), (0, rows)]) * content.resolution
    turned = ends @ np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]]) + (x, y)
    low, high = turned.min(0), turned.max(0)
    return (float(low[0]), float(high[0])), (float(low[1]), float(high[1]))
