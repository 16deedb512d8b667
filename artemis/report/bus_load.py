"""How busy the CAN bus was."""

from __future__ import annotations

import numpy as np

from artemis.devices.can_bus import most_bits
from artemis.motion.spline import Array
from artemis.recording.mcap_reader import Recording

BUS_BIN = 0.2
"""Shortest time over which the load is averaged [s]."""


def measure_bus_load(recording: Recording, time: Array, indices: list[int]) -> tuple[int, Array, Array]:
    """Number of frames, and the load of the bus in bins of equally many ticks: their middles [s], and shares."""
    frames = 0
    bits = dict.fromkeys(indices, 0.0)
    for index, packed in recording.frame_arrays():
        frames += len(packed)
        if index in bits:
            bits[index] += float(np.sum(most_bits(packed["length"].astype(np.int64))))
    if len(time) < 2:
        return frames, np.empty(0), np.empty(0)
    ticks = max(1, round(max(BUS_BIN, float(time[-1] - time[0]) / 500) / float(np.median(np.diff(time)) or BUS_BIN)))
    edges = np.arange(0, len(time), ticks)  # whole ticks: a bin of fixed time would hold now one more, now one less
    if len(edges) < 2:
        edges = np.array([0, len(time) - 1])
    totals = np.add.reduceat(np.array(list(bits.values())), edges)[:-1]
    begin, end = time[edges[:-1]], time[edges[1:]]
    return frames, (begin + end) / 2, totals / ((end - begin) * recording.robot.bitrate)
