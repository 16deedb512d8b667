"""Where the map of a run is written, and that it never replaces a good one by less."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from command_line import MISSIONS, artemis_here, only_run

WALLS = [[-2, -1.5], [6, -1.5], [6, 1.5], [-2, 1.5], [-2, -1.5]]


def mission_in(folder: Path, *faults: dict[str, object]) -> Path:
    """1.5 m straight ahead, mapped into `hall.yaml`, too."""
    shutil.copytree(MISSIONS / "robots", folder / "robots")
    path = folder / "mission.yaml"
    words = {
        "mission": "mapped",
        "robot": "robots/artemis_lms100.yaml",
        "bus": "simulation",
        "mapping": {"file": "hall.yaml", "replace": True},
        "steps": [
            {"calibrate": {"steering": "from_potentiometers"}},
            {"follow": {"path": {"waypoints": [[0, 0], [1.5, 0]]}, "follower": {"speed_m_s": 0.3}}},
        ],
        "simulation": {"world": {"walls": [{"points": WALLS}]}, "faults": list(faults)},
    }
    path.write_text(json.dumps(words))
    return path


def maps_told(output: str) -> list[str]:
    return [line[14:] for line in output.splitlines() if line.startswith("map           ")]


@pytest.mark.slow
def test_a_run_that_is_done_writes_its_map_to_both_places_and_names_them(tmp_path: Path) -> None:
    ran = artemis_here("run", mission_in(tmp_path))

    assert ran.returncode == 0
    assert maps_told(ran.stdout) == [str(only_run(tmp_path) / "map.yaml"), str(tmp_path / "hall.yaml")]
    assert (tmp_path / "hall.pgm").read_bytes() == (only_run(tmp_path) / "map.pgm").read_bytes()


@pytest.mark.slow
def test_a_run_that_failed_or_was_resumed_keeps_the_map_that_was_there(tmp_path: Path) -> None:
    """In its folder its own is; a resumed one has zero where it resumed."""
    mission = mission_in(tmp_path, {"at_s": 9.0, "inject": "DRV-25", "node": "steer-left"})
    for suffix in (".yaml", ".pgm"):
        shutil.copy(MISSIONS / f"maps/hall{suffix}", tmp_path)
    before = (tmp_path / "hall.pgm").read_bytes()

    failed = artemis_here("run", mission)
    first = only_run(tmp_path)
    resumed = artemis_here("run", mission, "--resume", first)

    second = max((tmp_path / "runs").iterdir())
    file = tmp_path / "hall.yaml"
    assert (failed.returncode, resumed.returncode) == (1, 1)  # the fault comes again
    assert maps_told(failed.stdout) == [
        str(first / "map.yaml"),
        f"NOT WRITTEN: {file}: kept as it was, for the run did not end in order",
    ]
    assert maps_told(resumed.stdout) == [
        str(second / "map.yaml"),
        f"NOT WRITTEN: {file}: a resumed run maps only its own part; "
        f"to make one map of both: artemis map build {first} {second} -o {file}",
    ]
    assert (tmp_path / "hall.pgm").read_bytes() == before
    assert f"map not written: {file}: kept as it was" in (first / "journal.jsonl").read_text()
