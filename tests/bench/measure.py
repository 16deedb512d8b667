"""One line of the table, and how numbers get into it."""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median

from artemis.clock import stopwatch


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """What was measured, in words; `held`: whether the budget was kept (None: there is none)."""

    name: str
    measured: str
    budget: str = ""
    held: bool | None = None
    peer: str = ""
    """What the peer needed in the same run, and our share of it."""


def percentile(values: Sequence[float], share: float) -> float:
    """The smallest value that is not exceeded by `share` of all."""
    ordered = sorted(values)
    return ordered[max(0, math.ceil(share * len(ordered)) - 1)]


def microseconds(seconds: float) -> str:
    return f"{seconds * 1e6:.0f} us"


def milliseconds(seconds: float) -> str:
    return f"{seconds * 1e3:.2f} ms"


def middle_and_tail(values: Sequence[float]) -> str:
    return f"{microseconds(median(values))}, p99 {microseconds(percentile(values, 0.99))}"


def interleaved(actions: Sequence[Callable[[], object]], rounds: int, calls: int) -> list[float]:
    """Least time of one call of each action [s]. They take turns: a machine does not always run at one speed."""
    times: list[list[float]] = [[] for _ in actions]
    gc.collect()
    for _ in range(rounds):
        for action, found in zip(actions, times, strict=True):
            begun = stopwatch()
            for _ in range(calls):
                action()
            found.append((stopwatch() - begun) / calls)
    return [min(found) for found in times]


def table(rows: Sequence[Row]) -> str:
    """All rows as text in columns."""
    heads = ("what", "measured", "budget", "", "peer")
    verdict = {True: "ok", False: "OVER", None: ""}
    lines = [heads, *((row.name, row.measured, row.budget, verdict[row.held], row.peer) for row in rows)]
    return columns(lines)


def written(page: str, name: str, text: str) -> str:
    """A page of the documentation with another text between its marks `<!-- NAME -->` and `<!-- end of NAME -->`."""
    begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    before, rest = page.split(begin)
    _, after = rest.split(end)
    return f"{before}{begin}```text\n{text}\n```\n{end}{after}"


def columns(lines: Sequence[Sequence[str]]) -> str:
    """Lines of cells as text."""
    widths = [max(map(len, cells)) for cells in zip(*lines, strict=True)]
    padded = ([cell.ljust(width) for cell, width in zip(line, widths, strict=True)] for line in lines)
    return "\n".join("  ".join(line).rstrip() for line in padded)
