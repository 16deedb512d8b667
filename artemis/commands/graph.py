"""`artemis graph`: the robot's modes, or a mission, as a state diagram."""

from __future__ import annotations

import sys
from pathlib import Path

from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.recording.disk import write_whole
from artemis.report.mission_boxes import boxes_of
from artemis.report.mission_chart import chart
from artemis.report.mission_mermaid import mermaid_of
from artemis.states.machine import mermaid


def graph(mission: Path | None, svg: Path | None) -> None:
    """Print the modes, or a mission, as a Mermaid diagram; or draw the mission as `svg`.

    Raises:
        ConfigError: the mission is refused, or there is none to draw.
        RecordingError: the picture cannot be written.
    """
    if mission is None:
        if svg is not None:
            raise ConfigError("--svg draws a mission: write artemis graph MISSION --svg FILE")
        sys.stdout.write(f"{mermaid()}\n")
        return
    if svg is not None and svg.suffix != ".svg":
        raise ConfigError(f"--svg {svg}: the picture is SVG; name the file {svg.stem or 'mission'}.svg")
    loaded = load_mission(mission)
    box = boxes_of(loaded.mission.model_dump(mode="json", by_alias=True), loaded.robot)
    if svg is None:
        sys.stdout.write(f"{mermaid_of(box)}\n")
        return
    write_whole(svg, chart(box))
    sys.stdout.write(f"{svg}\n")
