"""How the rows LAS-.. are made to happen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from every_row import Scene

from artemis.values import Severity

SCENE = Scene(device="front", scanner=True)
TURN = 0.02
"""The scanner tells one a turn, so something may show up to one later [s]."""


def scene(severity: Severity | None = None, effect: float = TURN, seen: Sequence[str] = (), **options: Any) -> Scene:  # noqa: ANN401
    return replace(SCENE, options=options, severity=severity, effect=effect, seen=seen)


SCANNER_SCENES: Mapping[str, Scene | Sequence[Scene]] = {
    "LAS-01": [scene(), scene(how="silent")],
    "LAS-02": scene(),
    "LAS-03": [
        scene(Severity.WARN, share=0.15, effect=0.3),
        scene(share=0.9, duration_s=2.0, effect=0.1),
        scene(how="cut", share=0.9, effect=0.1),
        scene(how="bit", share=0.9, effect=0.1),
        scene(how="lost", share=0.8, effect=0.3, seen=["LAS-03", "LAS-01"]),
    ],
    "LAS-05": [scene(Severity.LIMIT, status="dirty"), scene(status="error"), scene(status="too dirty")],
    "LAS-06": [
        scene(Severity.LIMIT, sector_deg=[70, 95], duration_s=0.5),
        scene(),
        scene(sector_deg=[70, 95]),
    ],
    "LAS-07": [
        scene(Severity.WARN, seconds=0.1, effect=1.1),
        scene(seconds=0.3, within_s=1.0, effect=0.5 + 0.3),
        scene(seen=["LAS-01"]),
    ],
}
