"""Logs of the CARMEN toolkit: lines `ODOM` and `FLASER`, as of C. Stachniss' data sets and many public ones."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from artemis.errors import ConfigError
from artemis.mapping.laser import Reading, surface_points
from artemis.mapping.se2 import Array
from artemis.mapping.settings import MapSettings

_AFTER_RANGES = 9
"""Fields of `FLASER` behind its ranges: x, y, theta, odometry x, y, theta, time, host, logger's time."""


def read_carmen(path: Path, settings: MapSettings) -> Iterator[Reading]:
    """Readings in the order of the file; other lines are passed over.

    `FLASER n r_1 ... r_n x y theta odom_x odom_y odom_theta time host logger_time`: n beams over half a turn, from the
    right to the left; `ODOM x y theta tv rv accel time host logger_time`.

    Args:
        path: `.clf` or `.log`, also as `.gz`.
        settings: which returns count.

    Raises:
        ConfigError: it cannot be read, or a line is not as it should be.
    """
    try:
        with gzip.open(path, "rt") if path.suffix == ".gz" else path.open() as lines:
            for number, line in enumerate(lines, start=1):
                try:
                    if line.startswith("FLASER "):
                        yield _scan(line.split(), settings)
                    elif line.startswith("ODOM "):
                        fields = line.split()
                        yield Reading(time=float(fields[7]), odometry=_finite(fields[1:4]))
                except (ValueError, IndexError) as error:
                    raise ConfigError(f"{path}:{number}: {line[:12].split()[0]}: {error}") from None
    except (OSError, EOFError, zlib.error) as error:
        words = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise ConfigError(f"{path}: cannot be read: {words}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: byte {error.start + 1} is not text") from None


def _scan(fields: list[str], settings: MapSettings) -> Reading:
    count = int(fields[1])
    if count < 2:
        raise ValueError(f"a scan of {count} beams; expected 2 at least")
    if len(fields) < 2 + count + _AFTER_RANGES:
        raise ValueError(f"{len(fields)} fields; {count} beams need {2 + count + _AFTER_RANGES}")
    ranges, rest = np.array(fields[2 : 2 + count], float), fields[2 + count :]
    step = np.pi / (count - count % 2)  # 180 beams: 1 degree; 181: also, both ends measured
    points = surface_points(ranges, -np.pi / 2 + step * np.arange(count), settings)
    return Reading(time=float(rest[6]), odometry=_finite(rest[3:6]), points=points)


def _finite(fields: list[str]) -> Array:
    pose = np.array(fields, float)
    if len(pose) != 3 or not np.isfinite(pose).all():
        raise ValueError(f"{' '.join(fields)} is no pose")
    return pose
