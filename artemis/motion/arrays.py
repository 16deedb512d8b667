"""What curves and samples are made of."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[np.float64]
"""Numbers for each point of a curve, shape (n,), or coordinates x, y [m], shape (n, 2)."""
Indices: TypeAlias = npt.NDArray[np.int64]
"""Numbers of points, beams or cells."""
