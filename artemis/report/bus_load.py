"""How busy the CAN bus was."""

from __future__ import annotations

import numpy as np

from artemis.devices.can_bus import most_bits
from artemis.motion.arrays import Array
from artemis.recording.schemas import FRAME_RECORD

BUS_BIN = 0.2
"""Shortest time over which the load is averaged [s]."""
BINS = 500
"""At most about."""
_OFFSET = 11
"""Of the length in a packed frame."""
_BITS = [most_bits(length) for length in range(256)]


class BusLoad:
    """Counts frames and their bits tick by tick, in bins of whole ticks: one of fixed time would hold now one more."""

    def __init__(self, ticks: int, duration: float) -> None:
        """So many `ticks` will come, in `duration` [s]."""
        period = duration / (ticks - 1) if ticks > 1 else 0.0
        self._per_bin = max(1, round(max(BUS_BIN, duration / BINS) / (period or BUS_BIN)))
        self._ticks = 0
        self._edges: list[float] = []
        self._bits: list[int] = []
        self._last = 0.0, 0
        """Time of the last tick, and bits of its bin before it."""
        self.frames = 0

    def tick(self, time: float) -> None:
        """The next tick, at run time `time` [s]."""
        if self._ticks % self._per_bin == 0:
            self._edges.append(time)
            self._bits.append(0)
        self._ticks += 1
        self._last = time, self._bits[-1]

    def add(self, packed: bytes, *, of_tick: bool) -> None:
        """Frames, packed as `FRAME_RECORD`s; only those of the last tick count as load."""
        lengths = packed[_OFFSET :: FRAME_RECORD.itemsize]
        self.frames += len(lengths)
        if of_tick:
            self._bits[-1] += sum(map(_BITS.__getitem__, lengths))

    def shares(self, bitrate: int) -> tuple[Array, Array]:
        """Middles of the bins that are full [s], and the load in them; shape (n,)."""
        edges, bits = np.array(self._edges), np.array(self._bits[:-1], dtype=np.float64)
        if len(edges) == 1 and self._ticks > 1:
            edges, bits = np.array([edges[0], self._last[0]]), np.array([self._last[1]], dtype=np.float64)
        begin, end = edges[:-1], edges[1:]
        return (begin + end) / 2, bits / ((end - begin) * bitrate)
