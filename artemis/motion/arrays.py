"""What curves and samples are made of, and the angles among it."""

from __future__ import annotations

from math import pi, tau
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[np.float64]
"""Numbers for each point of a curve, shape (n,), or coordinates x, y [m], shape (n, 2)."""
Indices: TypeAlias = npt.NDArray[np.int64]
"""Numbers of points, beams or cells."""


def wrapped(angles: npt.ArrayLike) -> Array:
    """The same directions in [-pi, pi) [rad]; of one angle `angles.wrap` does so, in (-pi, pi]."""
    return np.asarray((np.asarray(angles, float) + pi) % tau - pi)
