"""`artemis sim --scanner --world`: what may be written there."""

from __future__ import annotations

from pathlib import Path

import pytest

from artemis.commands.simulate import scanner_places, scenery_from
from artemis.errors import ConfigError
from artemis.mission.loading import load_model
from artemis.vehicle import RobotFile

ROBOTS = Path(__file__).parents[2] / "missions" / "robots"
ONE = load_model(ROBOTS / "artemis_lms100.yaml", RobotFile)
NONE = load_model(ROBOTS / "artemis.yaml", RobotFile)
TWO = ONE.model_copy(update={"scanners": {name: ONE.scanners["front"] for name in ("front", "rear")}})


def test_places() -> None:
    assert scanner_places(ONE, []) == {}
    assert scanner_places(ONE, ["127.0.0.1:2111"]) == {"front": ("127.0.0.1", 2111)}
    assert scanner_places(TWO, ["rear=::1:0", "front=localhost:2112"]) == {
        "rear": ("::1", 0),
        "front": ("localhost", 2112),
    }


@pytest.mark.parametrize(
    ("robot", "given", "problem"),
    [
        (ONE, "2111", "--scanner 2111: write host and port, as 127.0.0.1:2111"),
        (ONE, "localhost:70000", "write host and port"),
        (ONE, "localhost:x", "write host and port"),
        (NONE, "localhost:2111", "the robot file has no scanners"),
        (ONE, "rear=localhost:2111", "write which one, as front=localhost:2111"),
        (TWO, "localhost:2111", "write which one, as front=localhost:2111"),
    ],
)
def test_what_is_no_place_is_refused(robot: RobotFile, given: str, problem: str) -> None:
    with pytest.raises(ConfigError) as refused:
        scanner_places(robot, [given])
    assert problem in str(refused.value)


def test_one_scanner_has_one_place() -> None:
    with pytest.raises(ConfigError, match="front is given already"):
        scanner_places(ONE, ["a:1", "front=b:2"])


def test_a_world_with_a_map_beside_it(tmp_path: Path) -> None:
    world = tmp_path / "world.yaml"
    world.write_text("poles: [{x_m: 1, y_m: 2, diameter_m: 0.1}]\nmap_file: hall.yaml\n")
    words = (
        "image: hall.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    (tmp_path / "hall.yaml").write_text(words)
    (tmp_path / "hall.pgm").write_text("P2 2 1 255 0 254")
    scenery, grid = scenery_from(world)
    assert len(scenery.poles) == 1
    assert grid is not None
    (tmp_path / "hall.pgm").unlink()
    with pytest.raises(ConfigError, match=r"hall\.pgm"):
        scenery_from(world)
    world.write_text("poles: []\n")
    assert scenery_from(world)[1] is None
