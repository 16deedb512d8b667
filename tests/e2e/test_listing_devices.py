"""`artemis devices`: with whatever is plugged into this computer."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import artemis, artemis_here, write_mission


@pytest.mark.slow
def test_devices_of_this_computer_and_drives_of_a_mission_are_listed(tmp_path: Path) -> None:
    done = artemis("devices", "--mission", write_mission(tmp_path))
    assert (done.returncode, done.stderr) == (0, "")
    headings = [line for line in done.stdout.splitlines() if not line.startswith(" ")]
    assert headings == ["CAN adapters", "inputs", "drives of ARTEMIS (simulated)"]
    assert done.stdout.count("vendor 0x000000FB") == 4


def test_a_bus_that_cannot_be_opened_is_a_failure(tmp_path: Path) -> None:
    done = artemis_here("devices", "--mission", write_mission(tmp_path, bus="{interface: socketcan, channel: no-can}"))
    assert (done.returncode, done.stderr) == (1, "")
    assert "CAN socketcan no-can: " in done.stdout.splitlines()[-1]


def test_a_bad_mission_is_refused(tmp_path: Path) -> None:
    done = artemis_here("devices", "--mission", write_mission(tmp_path, bus="nonsense"))
    assert done.returncode == 2
    assert "mission.yaml:3:1: bus" in done.stderr
