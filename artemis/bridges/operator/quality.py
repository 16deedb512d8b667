"""How good a link is, from when frames came and which are missing: jitter (NET-03) and loss (NET-05)."""

from __future__ import annotations

from collections import deque

WINDOW, LOSS_WINDOW = 2.0, 1.0
"""Jitter and loss are judged over this time [s]."""
JITTER = 0.1
"""Highest 95th percentile of the gaps between two frames [s]."""
LOSS = 0.2
"""Highest share of missing frames."""
LEAST = 8
"""Fewer frames are not judged."""


class LinkQuality:
    """Remembers the frames of the last two seconds."""

    def __init__(self, now: float) -> None:
        """The link began at `now` [s]."""
        self._begun = self._last = now
        self._gaps: deque[tuple[float, float]] = deque()
        self._seen: deque[tuple[float, int]] = deque()

    def saw(self, now: float, missing: int) -> None:
        """A frame came, after `missing` others that did not."""
        self._gaps.append((now, now - self._last))
        self._seen.append((now, missing))
        self._last = now

    def problems(self, now: float) -> list[tuple[str, str]]:
        """What is wrong with the link: rows of the fault table, and what was seen."""
        _drop(self._gaps, now - WINDOW)
        _drop(self._seen, now - LOSS_WINDOW)
        problems = []
        gaps = sorted(gap for _, gap in self._gaps)
        if len(gaps) >= LEAST and now - self._begun >= WINDOW and (p95 := gaps[int(0.95 * len(gaps))]) > JITTER:
            problems.append(("NET-03", f"gaps of {p95 * 1e3:.0f} ms between two commands"))
        missing = sum(count for _, count in self._seen)
        expected = missing + len(self._seen)
        if len(self._seen) >= LEAST and missing > LOSS * expected:
            problems.append(("NET-05", f"{missing} of {expected} commands are missing"))
        return problems


def _drop(entries: deque[tuple[float, float]] | deque[tuple[float, int]], before: float) -> None:
    while entries and entries[0][0] < before:
        entries.popleft()
