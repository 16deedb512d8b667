"""`artemis sim --serial` and the commands that use a serial line, as processes that share a pseudo-terminal."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from command_line import ROBOT, artemis, read_until, started, write_mission

pytestmark = [pytest.mark.realtime, pytest.mark.exhaustive]


def test_drives_are_asked_and_configured_and_not_driven(tmp_path: Path) -> None:
    with started("sim", ROBOT, "--serial", "epos1", "--latency-ms", "1") as process:
        line = read_until(process, "Ctrl-C ends")
        (terminal,) = set(re.findall(r"/dev/\S+(?=,)", line))
        mission = write_mission(tmp_path, bus=f"{{serial: {terminal}}}")
        asked = artemis("devices", "--mission", mission)
        assert asked.returncode == 0, asked.stderr
        assert len(re.findall(r"vendor 0x000000FB.*serial 0x0000000[1-4]", asked.stdout)) == 4
        configured = artemis("configure", mission, "--store")
        assert configured.returncode == 0, configured.stdout
        assert configured.stdout.count("configured, each setting read back, stored") == 4
        gains = artemis("calibrate", "gains", mission)
        assert gains.returncode == 0
        assert "*" not in gains.stdout, "the drives have the robot file's now"
        driven = artemis("run", mission)
        assert driven.returncode == 2
        assert "nothing is driven over a serial line" in driven.stderr
        assert driven.stdout == ""
