"""A device's clock against ours, from when its telegrams arrive: late ones count for nothing."""

from __future__ import annotations

from collections import deque
from math import inf

WRAP = 1 << 32
"""The device counts microseconds in 32 bits: it begins anew after 71.6 min."""
DRIFT = 200e-6
"""Clocks of quartz differ by less than this share: 100 ppm each."""
JUMP, WINDOW, LEVEL = 0.05, 3.0, 0.01
"""What comes so much later [s] for so long [s], each time by the same but for `LEVEL` [s], shows that the device's
clock was set back; on a busy line delays vary more."""


class DeviceClock:
    """Maps times of the device to ours, by the least delay there was: the lower envelope of arrival minus device time.

    The envelope rises by `DRIFT`, so that it follows a device whose clock is slower than ours; one that is faster shows
    by itself. The constant part of the delay (a millisecond on a short line) stays in the result.
    """

    def __init__(self) -> None:
        self._last_us: int | None = None
        self._turns = 0
        self._offset = inf
        self._at = 0.0
        self._late: deque[tuple[float, float]] = deque()

    def to_ours(self, device_us: int, arrived: float) -> float:
        """A time of the device [us, 32 bits] on our clock [s], told in what arrived at `arrived` [s] of ours.

        The result is never later than `arrived`. Times may go back a little; by more than half a turn, they went on.
        """
        device = self._unwrapped(device_us)
        now = arrived - device
        grown = self._offset + DRIFT * max(0.0, arrived - self._at)
        self._at = max(self._at, arrived)
        if now <= grown:
            self._late.clear()
            self._offset = now
        else:
            self._offset = grown
            self._follow(arrived, now)
        return device + self._offset

    def _follow(self, arrived: float, now: float) -> None:
        """Take over an offset that is later than the envelope, and has been for long, always by the same."""
        late = self._late
        late.append((arrived, now))
        if arrived - late[0][0] < WINDOW:
            return
        least = min([offset for _, offset in late])
        most = max([offset for _, offset in late])
        if least - self._offset > JUMP and most - least < LEVEL:
            self._offset = least
            late.clear()
        else:
            late.popleft()

    def _unwrapped(self, device_us: int) -> float:
        last = self._last_us
        if last is not None:
            step = (device_us - last + WRAP // 2) % WRAP - WRAP // 2
            self._turns += (last + step) // WRAP
        self._last_us = device_us
        return (self._turns * WRAP + device_us) * 1e-6
