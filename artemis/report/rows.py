"""The numbers of a run: a row a tick; of a long run the rows that matter, so that it needs no more room than others.

What stays of a stretch of a long run: its first and its last row, those with the lowest and the highest value of each
column, those nearest behind moments that somebody names, and enough of them to draw the path.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from struct import Struct

import numpy as np
from numpy.typing import NDArray

from artemis.motion.arrays import Array

ALL = 60_000
"""Of a run with no more ticks every row stays: 20 minutes at 50 Hz."""
STRETCHES = 1500
"""Into so many a longer one is divided; figures show two points of each."""
PLACES, APART = 40, 0.05
"""While it is read, so many rows of a stretch stay at most, so far [m] apart at least."""


@dataclass(slots=True)
class Errors:
    """Size of an error over all ticks."""

    number: int = 0
    squares: float = 0.0
    largest: float = 0.0

    def add(self, errors: Array) -> None:
        """Some more, shape (n,); nan does not count."""
        known = errors[~np.isnan(errors)]
        if len(known):
            self.number += len(known)
            self.squares = float(np.cumsum(np.append(self.squares, known * known))[-1])  # as added one by one
            self.largest = max(self.largest, float(np.abs(known).max()))

    @property
    def rms(self) -> float | None:
        """Root of the mean square; None: there was none."""
        return (self.squares / self.number) ** 0.5 if self.number else None

    @property
    def max(self) -> float | None:
        """None: there was none."""
        return self.largest if self.number else None


class Rows:
    """Takes the rows one by one. The first column is the run time, `x` and `y` are those of the place."""

    def __init__(
        self,
        width: int,
        x: int,
        y: int,
        ticks: int | None,
        moments: Sequence[float] = (),
        errors: Mapping[int, Errors] | None = None,
    ) -> None:
        """`ticks`: about how many rows will come; None: each of them has to stay. `moments`: in run time [s].

        `errors`, by numbers of columns: they count all values of these.
        """
        self._width, self._x, self._y, self._errors = width, x, y, errors or {}
        self._all = ticks is None or ticks <= ALL
        self._row = Struct(f"{width}d")
        self._stretch = self._row.size * (4096 if ticks is None or ticks <= ALL else -(-ticks // STRETCHES))
        self._moments = np.sort(np.array(moments, dtype=np.float64))
        self._block, self._kept = bytearray(), bytearray()

    def add(self, row: Sequence[float]) -> None:
        """The next row; nan where there is no value."""
        self._block += self._row.pack(*row)
        if len(self._block) >= self._stretch:
            self._end_stretch()

    def table(self) -> Array:
        """What stays, shape (n, width)."""
        self._end_stretch()
        return np.frombuffer(self._kept, dtype=np.float64).reshape(-1, self._width)

    def _end_stretch(self) -> None:
        block = np.frombuffer(bytes(self._block)).reshape(-1, self._width)
        for column, errors in self._errors.items():
            errors.add(block[:, column])
        if len(block):
            self._kept += (block if self._all else block[self._mattering(block)]).tobytes()
        self._block.clear()

    def _mattering(self, block: Array) -> NDArray[np.int64]:
        known = ~np.isnan(block)
        lowest = np.argmin(np.where(known, block, np.inf), axis=0)
        highest = np.argmax(np.where(known, block, -np.inf), axis=0)
        ends = np.array([0, len(block) - 1])
        moments = np.searchsorted(block[:, 0], self._moments[self._moments <= block[-1, 0]])
        return np.unique(np.concatenate([ends, lowest, highest, moments, self._places(block)]))

    def _places(self, block: Array) -> NDArray[np.int64]:
        steps = np.hypot(np.diff(block[:, self._x]), np.diff(block[:, self._y]))
        distance = np.append(0.0, np.cumsum(np.where(np.isnan(steps), 0.0, steps)))
        return np.unique(distance // max(APART, float(distance[-1]) / PLACES), return_index=True)[1]
