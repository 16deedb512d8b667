"""What does not depend on a run: queries of long paths, and how soon the command answers."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path as FilePath

import numpy as np

from artemis.clock import stopwatch
from artemis.motion.path import SPACING, Path

from .composition import FIGURE_EIGHT
from .measure import Row, interleaved, microseconds

SHORT, LONG = 1_000, 1_000_000
"""Samples of a path."""
ARTEMIS = FilePath(sys.executable).parent / "artemis"
TRIES = 5


def rows() -> list[Row]:
    """The rows of the table."""
    short, long = interleaved([_queries(SHORT), _queries(LONG)], rounds=25, calls=100)
    return [
        Row(
            name="path query (projection, curvature), 1e6 against 1e3 samples",
            measured=f"{microseconds(long)} against {microseconds(short)}: {long / short:.2f} x",
            budget="independent of length",
            held=long <= 1.5 * short,
        ),
        _answer("`artemis --help`", 0.2, "--help"),
        _answer("`artemis check` of the figure eight", 1.0, "check", str(FIGURE_EIGHT)),
    ]


def _queries(samples: int) -> Callable[[], object]:
    """One query after the other on a circle of so many samples, each a little further on."""
    radius = samples * SPACING / math.tau
    angle = np.linspace(0.0, math.tau, samples + 1)
    path = Path(
        radius * np.cos(angle),
        radius * np.sin(angle),
        angle + math.pi / 2,
        np.full(samples + 1, 1 / radius),
        spacing=SPACING,
        closed=True,
    )
    place = 0

    def query() -> object:
        nonlocal place
        place = (place + 7919) % samples
        at = place / samples * math.tau
        outside = radius + 0.05
        found = path.project(outside * math.cos(at), outside * math.sin(at), place * SPACING)
        return path.at(found.arc_length).curvature

    return query


def _answer(name: str, budget: float, *words: str) -> Row:
    """How soon the command has answered, the best of some tries."""
    times = []
    for _ in range(TRIES):
        before, begun = os.times(), stopwatch()
        subprocess.run([str(ARTEMIS), *words], check=True, capture_output=True, timeout=30)
        after = os.times()
        used = after.children_user + after.children_system - before.children_user - before.children_system
        times.append((stopwatch() - begun, used))
    took, used = min(times)
    return Row(
        name=name,
        measured=f"{took:.2f} s, {used:.2f} s by processor time",
        budget=f"< {budget:g} s",
        held=took < budget,
    )
