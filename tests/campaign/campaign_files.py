"""Campaign files for tests."""

from __future__ import annotations

import shutil
from pathlib import Path

ROBOT = Path(__file__).parents[2] / "missions" / "robots" / "artemis.yaml"


def write_campaign(folder: Path, **keys: object) -> Path:
    """A small campaign with the robot beside it; its path."""
    shutil.copy(ROBOT, folder / "robot.yaml")
    words = {"campaign": "small", "robot": "robot.yaml", "runs": 3, **keys}
    path = folder / "campaign.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in words.items()))
    return path
