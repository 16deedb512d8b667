"""A run that was driven by ROS 1 is replayed bit for bit where nothing of ROS is installed."""

from __future__ import annotations

import asyncio
import re
import sys
from pathlib import Path

import pytest
from rig import CALIBRATE, MISSIONS, TELEOP, Rig, write_mission

pytest.importorskip("rosbags", reason="needs the extra ros: pip install 'artemis-robot[ros]'")

from artemis.bridges.ros_types import Ros1Types
from artemis.build import install
from artemis.commands.replay import replay_run
from artemis.errors import ConfigError
from artemis.mission.loading import load_model
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.ros1 import Ros1Input, Ros1InputConfig
from artemis.values import Mode
from artemis.vehicle import RobotFile

pytestmark = pytest.mark.short_alignment

TWIST = "geometry_msgs/msg/Twist"
KEYS = {"enabled_by": "command", "allow": ["done"]}
BEGIN, END = 6.0, 8.0
"""Commands come between these run times [s]."""


class Commanded(Ros1Input):
    """One whose network is the test, in virtual time."""

    def _open(self) -> None:
        pass

    def _heard(self) -> tuple[bool, str]:
        return True, ""

    def _arrival(self) -> float:
        return self._clock()


def test_commands_are_replayed_without_the_packages_of_ros(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mission = write_mission(tmp_path, [CALIBRATE, TELEOP], inputs={"stick": {"plugin": "ros1", **KEYS}})
    robot = load_model(MISSIONS / "robots/artemis.yaml", RobotFile)
    context = PluginContext(name="stick", robot=robot, folder=tmp_path)
    config, types = Ros1InputConfig.model_validate(KEYS), Ros1Types()
    device = Commanded(config, context, lambda: asyncio.get_running_loop().time())
    take = {name: take for name, (_, take) in device._receiver.topics().items()}
    rig = Rig(mission, input=device)

    def say(speed: float, rate: float) -> None:
        take["cmd_vel"](types.pack(TWIST, {"linear": {"x": speed}, "angular": {"z": rate}}), "/peer")

    for number in range(round((END - BEGIN) / 0.05)):
        rig.at(BEGIN + 0.05 * number, lambda number=number: say(0.3, 0.01 * number))  # type: ignore[misc]
    rig.at(END, lambda: say(0.0, 0.0))
    rig.at(END + 2.0, lambda: (take["done"](b"", "/peer"), None)[1])
    ran = rig.run()
    assert max(seen.tick.set_points.speed for seen in ran.in_mode(Mode.TELEOP)) > 0.25
    assert ran.outcome is not None
    for name in [name for name in sys.modules if name.partition(".")[0] == "rosbags"] or ["rosbags"]:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ConfigError, match=f"needs the package rosbags: {re.escape(install('ros'))}"):
        Ros1Input(Ros1InputConfig(), context)
    assert replay_run(ran.outcome.run.path) == 0
