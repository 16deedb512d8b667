"""A mission whose robot's gains are tried, and drives that store what they get: for tests of `calibrate gains`."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from artemis.commands import calibrate_gains as command
from artemis.drive_schema import Gains
from artemis.motion.step_response import StepResponse
from artemis.values import JobKind
from artemis.vehicle import RobotFile

ROBOT = Path(__file__).parents[2] / "missions" / "robots" / "artemis.yaml"
LEFT, RIGHT, DRIVEN = "steer-left", "steer-right", "traction-left"
POSITION = {"position": "600,10,200"}
NEW = Gains(current=(500, 150), velocity=(1000, 100), position=(600, 10, 200))
SETTLED = StepResponse(
    begin=0.0,
    step=5.0,
    ramp=0.15,
    watched=2.0,
    rise=0.1,
    overshoot=0.0,
    settled_5=0.2,
    settled_2=0.3,
    steady_error=0.0,
    largest_error=0.5,
    peak_current=1.0,
)


def mission(folder: Path, **keys: Any) -> Path:  # noqa: ANN401 (as in a mission)
    (folder / "robots").mkdir()
    shutil.copy(ROBOT, folder / "robots")
    content = {"mission": "m", "robot": "robots/artemis.yaml", "bus": "simulation", "steps": [{"wait": {"seconds": 1}}]}
    path = folder / "mission.yaml"
    path.write_text(json.dumps({**content, **keys}))
    return path


def robot_file(folder: Path) -> str:
    return (folder / "robots" / "artemis.yaml").read_text()


def storing(
    monkeypatch: pytest.MonkeyPatch, error: BaseException | None = None, after: int = 0
) -> list[Mapping[str, tuple[int, ...]]]:
    """Drives store what they get, the `after` first ones before an error; what it was comes into the list."""
    stored: list[Mapping[str, tuple[int, ...]]] = []

    class Bus:
        def close(self) -> None:
            pass

    async def store(
        robot: RobotFile, bus: Bus, kind: JobKind, wanted: Mapping[str, tuple[int, ...]], told: Callable[[str], None]
    ) -> None:
        assert kind is JobKind.WRITE_GAINS
        for index, (name, numbers) in enumerate(wanted.items()):
            if error is not None and index == after:
                raise error
            stored.append({name: numbers})
            told(name)

    monkeypatch.setattr(command, "open_bus", lambda *_, **__: Bus())
    monkeypatch.setattr(command, "store", store)
    return stored
