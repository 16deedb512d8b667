"""Fast DDS, the DDS of ROS 2's own default, hears and drives artemis; tshark reads what goes over.

`scripts/ros2_peers` installs both.
"""

from __future__ import annotations

import os
import queue
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

pytest.importorskip("rosbags", reason="needs the extra ros2: pip install 'artemis-robot[ros2]'")
pytest.importorskip("cyclonedds", reason="needs the extra ros2: pip install 'artemis-robot[ros2]'")
from lateness import skip_if_late
from ros2_rig import LONGEST, STEP, own_address, until

from artemis.bridges.ros2.settings import unicast_ports
from artemis.mapping.occupancy import OccupancyMap, ShownMap
from artemis.mission.loading import load_model
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.ros2 import Ros2Input, Ros2InputConfig
from artemis.plugins.observers.ros2 import Ros2Observer, Ros2ObserverConfig
from artemis.scan import Scan
from artemis.testing.observers import ObserverContract
from artemis.values import Pose, Request, Tick
from artemis.vehicle import RobotFile

MISSIONS = Path(__file__).parents[2] / "missions"
PEER = Path(__file__).parents[2] / "build" / "ros2_peers" / "peer"
ROBOT = load_model(MISSIONS / "robots/artemis_lms100.yaml", RobotFile)
(SCANNER,) = ROBOT.scanners
STEPS = """
steps:
  - teleop: {input: remote, until: {button: done}}
"""
WITHOUT_EXTRAS = """
import sys
sys.modules.update(dict.fromkeys(("cyclonedds", "rosbags")))
from artemis.cli import main
main()
"""
ODOMETRY, SCAN = "nav_msgs/msg/Odometry", "sensor_msgs/msg/LaserScan"
TF, GRID = "tf2_msgs/msg/TFMessage", "nav_msgs/msg/OccupancyGrid"
DIAGNOSTICS, INFORMATION = "diagnostic_msgs/msg/DiagnosticArray", "rmw_dds_common/msg/ParticipantEntitiesInfo"
TWIST, STEERED = "geometry_msgs/msg/Twist", "ackermann_msgs/msg/AckermannDriveStamped"
STAMPED, EMPTY = "geometry_msgs/msg/TwistStamped", "std_msgs/msg/Empty"

pytestmark = [
    pytest.mark.realtime,
    pytest.mark.skipif(not PEER.exists(), reason="Fast DDS: built by scripts/ros2_peers"),
]


class Lines:
    """A program, and every line that it printed."""

    def __init__(self, *command: str, environment: dict[str, str] | None = None) -> None:
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(
            command,
            stdin=pipe,
            stdout=pipe,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, **(environment or {})},
        )
        self.lines: list[str] = []
        self._new: queue.Queue[str] = queue.Queue()
        self._paced = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._new.put(line.rstrip("\n"))

    def order(self, text: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(text + "\n")
        self.process.stdin.flush()

    def look(self) -> None:
        """Wait a little, and take what it printed."""
        self._paced.wait(STEP)
        while not self._new.empty():
            self.lines.append(self._new.get())

    def until(self, words: str, step: Callable[[], object] = lambda: None) -> str:
        """The first line that matches, from the beginning."""
        seen = 0
        for _ in range(round(LONGEST / STEP)):
            for line in self.lines[seen:]:
                seen += 1
                skip_if_late(line)
                if re.search(words, line):
                    return line
            step()
            self.look()
        raise AssertionError(f"no {words} in\n" + "\n".join(line[:300] for line in self.lines))

    def close(self) -> None:
        self.process.terminate()
        self.process.wait(LONGEST)
        self._thread.join(LONGEST)
        for pipe in (self.process.stdin, self.process.stdout):
            assert pipe is not None
            pipe.close()


def peer(domain: int, closing: ExitStack, gid: int = 16) -> Lines:
    made = Lines(str(PEER), str(domain), str(gid))
    closing.callback(made.close)
    return made


class Seen:
    """An observer at work, on a run with scans and a map: each step shows it a tick."""

    def __init__(self, domain: int, closing: ExitStack, **options: object) -> None:
        cells = np.full((800, 800), -1, np.int8)
        cells[:, :3] = 100
        known = ShownMap(content=OccupancyMap(cells=cells, resolution=0.05, origin=(-20.0, -10.0, 0.0)))
        context = PluginContext(name="dds", robot=ROBOT, folder=Path(), map=lambda: known)
        config = Ros2ObserverConfig.model_validate({"domain": domain, **options})
        self.observer, self.problems = Ros2Observer(config, context), list[str]()
        closing.callback(self.observer.close)
        shown = ObserverContract()
        shown.duration = 10 * LONGEST
        self._ticks: Iterator[Tick] = shown.ticks()

    def tick(self) -> None:
        tick = next(self._ticks)
        scan = Scan(source=SCANNER, time=tick.snapshot.time, start_angle=-1.0, increment=0.5, ranges=bytes(10))
        sensed = replace(tick.snapshot.sensed, scans=(scan,))
        self.observer.see(replace(tick, snapshot=replace(tick.snapshot, sensed=sensed)), (), tick.snapshot.time)
        self.problems += [words for _, _, words in self.observer.take_problems()]


def test_fast_dds_hears_a_run_and_what_is_latched_as_a_late_joiner(domain: int, closing: ExitStack) -> None:
    seen, program = Seen(domain, closing, namespace="base"), peer(domain, closing)
    for topic, type in (("rt/base/odom", ODOMETRY), ("rt/tf", TF), ("rt/diagnostics", DIAGNOSTICS)):
        program.order(f"hear {topic} {type} reliable volatile")
    program.order(f"hear rt/base/scan {SCAN} best_effort volatile")
    program.order(f"hear ros_discovery_info {INFORMATION} reliable latched")
    assert re.search(r"odom base_link x \S+ speed 0\.2 rate 0", program.until("heard rt/base/odom", seen.tick))
    assert "odom>base_link" in program.until("heard rt/tf ", seen.tick)
    assert f"heard rt/base/scan {SCANNER} 5 beams" in program.until("heard rt/base/scan", seen.tick)
    assert "0 ARTEMIS: robot" in program.until("heard rt/diagnostics", seen.tick)
    program.order(f"hear rt/base/map {GRID} reliable latched")
    program.order(f"hear rt/tf_static {TF} reliable latched")
    words = "heard rt/base/map map 800x800 of 0.05 from -20 -10 cells 640000 occupied 2400"
    assert program.until("heard rt/base/map", seen.tick) == words
    assert f"base_link>{SCANNER}" in program.until("heard rt/tf_static", seen.tick)
    information = program.until("heard ros_discovery_info.*node /base artemis readers writers", seen.tick)
    writers = [line.split() for line in program.lines if line.startswith("writer ") and " rt/" in line]
    assert {line[1] for line in writers} == set(information.partition(" writers ")[2].split())
    assert information.split()[2] == program.until("participant .*enclave=/;").split()[1]
    told = {line[2]: line[3:] for line in writers}
    hashed = "typehash=RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0;"
    assert told["rt/base/odom"] == ["nav_msgs::msg::dds_::Odometry_", "reliable", "volatile", hashed]
    assert told["rt/base/map"][:3] == ["nav_msgs::msg::dds_::OccupancyGrid_", "reliable", "latched"]
    assert seen.problems == []
    seen.observer.close()
    program.until(r"heard ros_discovery_info  \w+$")  # no node any more


@pytest.mark.exhaustive
@pytest.mark.skipif(not own_address(), reason="this computer has no network")
def test_fast_dds_hears_a_run_by_the_multicast_of_another_address(domain: int, closing: ExitStack) -> None:
    seen, program = Seen(domain, closing, listen=own_address()), peer(domain, closing)
    program.order(f"hear rt/odom {ODOMETRY} reliable volatile")
    program.until("heard rt/odom", seen.tick)


@pytest.mark.exhaustive
def test_a_humble_program_is_told_long_gids_and_no_hashes(domain: int, closing: ExitStack) -> None:
    seen, program = Seen(domain, closing, distribution="humble"), peer(domain, closing, 24)
    program.order(f"hear ros_discovery_info {INFORMATION} reliable latched")
    information = program.until("node / artemis readers writers", seen.tick).partition(" writers ")[2].split()
    program.until("writer .* rt/odom", seen.tick)
    writers = [line.split() for line in program.lines if line.startswith("writer ") and " rt/" in line]
    assert {f"{line[1]}{8 * '00'}" for line in writers} <= set(information)
    assert not any("typehash" in line for line in program.lines)


@pytest.mark.parametrize(
    ("type", "topic", "numbers", "speed", "steering"),
    [
        pytest.param(TWIST, "cmd_vel", "0.25 0 0 0 0 0.2", 0.274, 0.4214, marks=pytest.mark.exhaustive),
        (STAMPED, "cmd_vel", "0.25 0 0 0 0 0.2", 0.274, 0.4214),
        (STEERED, "ackermann_cmd", "0.5 0 0.25 0 0", 0.2849, 0.5),
    ],
)
def test_fast_dds_drives(
    domain: int, closing: ExitStack, type: str, topic: str, numbers: str, speed: float, steering: float
) -> None:
    config = Ros2InputConfig.model_validate({"domain": domain, "type": type, "enabled_by": "command"})
    device = Ros2Input(config, PluginContext(name="remote", robot=ROBOT, folder=Path()))
    closing.callback(device.close)
    program = peer(domain, closing)
    program.order(f"say rt/{topic} {type} reliable {numbers}")
    now = 0.0
    while not (sample := device.read(now)).enabled:
        assert now < LONGEST
        program.look()
        now += STEP
    assert [sample.speed, sample.steering] == pytest.approx([speed, steering], abs=1e-3)


def test_what_fast_dds_has_kept_arms_nothing(domain: int, closing: ExitStack) -> None:
    config = Ros2InputConfig.model_validate({"domain": domain, "allow": ["arm"], "distribution": "jazzy"})
    device = Ros2Input(config, PluginContext(name="remote", robot=ROBOT, folder=Path()))
    closing.callback(device.close)
    program, requests, node = peer(domain, closing), list[Request](), device._node
    program.order(f"keep rt/arm {EMPTY} reliable 0")
    program.order(f"keep rt/stop {EMPTY} reliable 0")

    def meets_and_stops() -> bool:
        """Both topics are heard, and what is said now arrives."""
        requests.extend(device.read(0.0).requests)
        return Request.QUICKSTOP in requests and node.senders(arm) > 0

    (arm,) = [number for number, each in enumerate(node.parts().readers) if each.topic == "/arm"]
    for _ in range(2):
        requests.clear()
        until(lambda: device.read(0.0) and node.senders(arm) > 0)
        program.order(f"say rt/stop {EMPTY} reliable 0")
        until(meets_and_stops)
        program.order("quiet rt/stop")
        assert Request.ARM not in requests
        assert node.pid is not None
        os.kill(node.pid, signal.SIGKILL)  # and meet everybody anew
        killed = node.pid
        until(lambda: node.pid != killed)  # noqa: B023 (called here)


def test_fast_dds_gives_a_goal(domain: int, closing: ExitStack) -> None:
    config = Ros2InputConfig.model_validate({"domain": domain, "allow": ["goal_pose"]})
    device = Ros2Input(config, PluginContext(name="rviz", robot=ROBOT, folder=Path()))
    closing.callback(device.close)
    program = peer(domain, closing)
    program.order("say rt/goal_pose geometry_msgs/msg/PoseStamped reliable 1.5 2 0 0 0 0 1")
    now = 0.0
    while (goal := device.read(now).goal) is None:
        assert now < LONGEST
        program.look()
        now += STEP
    assert goal == Pose(x=1.5, y=2.0)
    assert device.take_problems() == []


def test_a_reliability_that_does_not_fit_is_refused_and_said_by_both(domain: int, closing: ExitStack) -> None:
    seen, program = Seen(domain, closing, scans="best_effort"), peer(domain, closing)
    program.order(f"hear rt/scan {SCAN} reliable volatile")
    program.until("refused rt/scan policy 11", seen.tick)
    for _ in range(round(LONGEST / STEP)):
        if seen.problems:
            break
        seen.tick()
        program.look()
    assert seen.problems == ["a subscriber of /scan is refused: more reliability is asked for than is offered"]
    assert not any("heard rt/scan" in line for line in program.lines)


@pytest.mark.skipif(shutil.which("tshark") is None, reason="tshark: installed by scripts/ros2_peers")
def test_tshark_reads_what_goes_over(domain: int, closing: ExitStack) -> None:
    first, last = unicast_ports(domain)
    fields = (
        "rtps.param.topicName",
        "rtps.param.typeName",
        "rtps.reliability_kind",
        "rtps.durability",
        "_ws.malformed",
    )
    chosen = [word for field in fields for word in ("-e", field)]
    shark = Lines("tshark", "-i", "lo", "-l", "-n", "-f", f"udp portrange {first}-{last}", "-T", "fields", *chosen)
    closing.callback(shark.close)
    if "permission" in shark.until("Capturing on|permission"):
        pytest.skip("tshark may not listen here")
    seen, program = Seen(domain, closing), peer(domain, closing)
    program.order(f"hear rt/odom {ODOMETRY} reliable volatile")
    program.until("heard rt/odom", seen.tick)
    shark.until(r"rt/odom.*nav_msgs::msg::dds_::Odometry_", seen.tick)
    line = shark.until(r"rt/map.*nav_msgs::msg::dds_::OccupancyGrid_", seen.tick)  # maybe with others in one packet
    _, _, reliability, durability, malformed = line.split("\t")
    reliable, transient_local = "0x00000002", "0x00000001"
    assert (set(reliability.split(",")), transient_local in durability, malformed) == ({reliable}, True, "")


@pytest.mark.exhaustive
def test_a_mission_is_driven_and_heard_by_fast_dds(domain: int, closing: ExitStack, tmp_path: Path) -> None:
    shutil.copytree(MISSIONS / "robots", tmp_path / "robots")
    head, _, rest = (MISSIONS / "ros2_teleop.yaml").read_text().partition("steps:")
    mission = tmp_path / "mission.yaml"
    mission.write_text(head + STEPS + rest[rest.index("simulation:") :])
    artemis = str(Path(sys.executable).with_name("artemis"))
    run = Lines(artemis, "run", str(mission), environment={"ROS_DOMAIN_ID": str(domain)})
    closing.callback(run.close)
    program = peer(domain, closing)
    program.order(f"hear rt/odom {ODOMETRY} reliable volatile")
    run.until("to drive", program.look)
    program.order(f"say rt/cmd_vel {TWIST} reliable 0.3 0 0 0 0 0.2")
    run.until("driving", program.look)
    program.until(r"heard rt/odom odom base_link x \S+ speed 0\.[0-9]*[1-9]", run.look)
    program.order("say rt/stop std_msgs/msg/Empty reliable 0")
    run.until("quick stop", program.look)
    program.order("quiet rt/cmd_vel")
    program.order("quiet rt/stop")
    run.until("stopped: arm to continue", program.look)
    program.order("say rt/arm std_msgs/msg/Empty reliable 0")
    run.until("armed again", program.look)
    program.order("quiet rt/arm")
    program.order("say rt/done std_msgs/msg/Empty reliable 0")
    assert run.until("^result", program.look).split() == ["result", "done"]
    assert run.process.wait(LONGEST) == 0
    (recording,) = (tmp_path / "runs").iterdir()
    command = [sys.executable, "-c", WITHOUT_EXTRAS, "replay", str(recording)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 0, done.stdout
