"""Every mission that comes with artemis is valid and ends as it should, against simulated drives."""

from __future__ import annotations

import itertools
import math
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache

import pytest
from extras import load_or_skip
from rig import MISSIONS, Run, Seen, run

from artemis.mission.loading import load_mission
from artemis.motion.path import path_from_csv
from artemis.values import Mode

NAMES = sorted(path.name for path in MISSIONS.glob("*.yaml"))
Ran = Callable[[str], Run]
BY_KEYS = "  inputs: {keys: {plugin: scripted, file: inputs/loop.csv, max_speed_m_s: 0.5}}\n"
STAND_INS = {"teleop_keyboard.yaml": BY_KEYS}
"""Last lines of missions that need a person at the terminal."""


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    """A mission's run, made once."""
    folder = tmp_path_factory.mktemp("shipped") / "missions"
    shutil.copytree(MISSIONS, folder, ignore=shutil.ignore_patterns("runs"))
    for name, lines in STAND_INS.items():
        with (folder / name).open("a") as mission:
            mission.write(lines)
    return cache(lambda name: run(folder / name, longest=900.0))


def true_cross_track(seen: Run) -> float:
    """The largest distance [m] of the true rear axle from the path, in the frame of the start."""
    path = path_from_csv((MISSIONS / "paths/figure_eight.csv").read_text(), "figure_eight.csv")
    origin = seen.in_mode(Mode.READY)[0].pose
    assert math.hypot(origin.x, origin.y) < 0.05  # the wheels were steered straight where the robot stood
    return max(
        abs(path.project(*place, near=tick.tick.wish.tracking.arc_length).cross_track)
        for tick, place in places(seen)
        if tick.tick.wish.tracking is not None
    )


def places(seen: Run) -> Iterator[tuple[Seen, tuple[float, float]]]:
    """Each tick on the path, with where the robot truly was in the frame of the start."""
    origin = seen.first(lambda s: s.tick.wish.reset_pose).pose
    cos, sin = math.cos(origin.heading), math.sin(origin.heading)
    for tick in seen.in_mode(Mode.FOLLOW):
        x, y = tick.pose.x - origin.x, tick.pose.y - origin.y
        yield tick, (x * cos + y * sin, y * cos - x * sin)


def position_errors(seen: Run) -> list[float]:
    """Distance [m] between the true and the estimated position at each tick on the path."""
    errors = []
    for tick, (x, y) in places(seen):
        estimated = tick.tick.snapshot.odometry.pose
        errors.append(math.hypot(x - estimated.x, y - estimated.y))
    return errors


BY_HAND = "fault_recovery_by_hand.yaml"
"""Needs a person who acknowledges and arms."""
ELSEWHERE = (
    "follow_by_tracker.yaml",
    "map_hall.yaml",
    "patrol_hall.yaml",
    "ros_goto.yaml",
    "ros_teleop.yaml",
    "ros2_teleop.yaml",
    "rosbridge_teleop.yaml",
    "network_teleop.yaml",
    "page_goto.yaml",
    "page_teleop.yaml",
    "record_and_follow.yaml",
    "record_and_return.yaml",
    "three_point_turn.yaml",
    "calibration_pattern.yaml",
    "calibrate_scanner.yaml",
    *(f"return_to_start_{distance}.yaml" for distance in ("ccw", "cw")),
    *(f"thesis_{name}.yaml" for name in ("circles", "stop_and_steer", "slow", "fast", "every_angle", "hysteresis")),
    *(f"follow_{course}.yaml" for course in ("circle", "corner", "figure_eight", "slalom", "straight")),
)
"""test_localisation.py, test_scan_map_runs.py, test_record_and_follow.py, test_reversing.py, test_follow_missions.py,
../peers/test_ros1_tools.py, ../peers/test_ros2_fast_dds.py, ../peers/test_rosbridge_clients.py,
../e2e/test_operator.py, ../e2e/test_run_with_page.py, test_calibrate_scanner_runs.py,
test_calibration_missions.py and test_thesis_missions.py run them, or say of which other they are twins."""
TWIN, OTHER_TWIN = "figure_eight_socketcan.yaml", "figure_eight_udp.yaml"
"""The bus is all in which they differ, and in simulation neither has it: one of them is run."""
SCANNING = ("blocked_path", "follow_shown", "goto_blocked", "goto_workshop", "map_and_show", "person_crosses")
LONGEST = (TWIN, *(f"{name}.yaml" for name in SCANNING))
"""The first is in simulation the figure eight once more. Scanners take most of the others' time: `make test` drives by
scanners in test_obstacle_missions.py, test_goto_missions.py and test_scan_map_runs.py."""
FAULTS = {
    "fault_recovery.yaml": ["DRV-25"],
    "retry_after_fault.yaml": ["DRV-25"],
    "can_overrun.yaml": ["DRV-18"],
    "person_crosses.yaml": ["LAS-08"],
    "blocked_path.yaml": ["LAS-08"],
    "goto_blocked.yaml": ["LAS-08"],
    "follow_shown.yaml": ["LAS-08"],
}
"""What is made to go wrong in a mission, and what it recovers from."""


@pytest.mark.parametrize("name", NAMES)
def test_a_mission_that_comes_with_artemis_is_valid(name: str) -> None:
    assert load_or_skip(MISSIONS / name).mission.steps


def test_twins_differ_in_nothing_but_the_bus() -> None:
    one, other = (load_mission(MISSIONS / name).mission for name in (TWIN, OTHER_TWIN))
    names = {"mission", "bus"}
    assert one.bus != other.bus
    assert one.model_dump(exclude=names) == other.model_dump(exclude=names)


def test_missions_of_two_robots_differ_in_nothing_but_robot_and_arguments() -> None:
    one, other = (load_mission(MISSIONS / f"two_robots_{name}.yaml").mission for name in ("first", "second"))
    assert one.parts == other.parts, "one file"
    assert one.robot != other.robot
    names = {"mission", "robot", "steps"}
    assert one.model_dump(exclude=names) == other.model_dump(exclude=names)


SAID: Mapping[str, Sequence[str]] = {
    "patrol.yaml": ["battery low, to the charger", "patrol is over"],
    "retry_after_fault.yaml": ["aligning the wheels again"],
    "ask_which_way.yaml": ["good bye"],
    "endurance.yaml": ["the battery is low"],
    "two_robots_first.yaml": ["2 laps to the left"],
    "two_robots_second.yaml": ["2 laps to the right"],
}
"""What missions tell people on their way."""


@pytest.mark.sampled(3)
@pytest.mark.slow
@pytest.mark.parametrize("name", SAID)
def test_mission_tells_what_it_decides(ran: Ran, name: str) -> None:
    events = [event for tick in ran(name).ticks for event in tick.events]
    assert [event.text for event in events if event.kind == "said"] == SAID[name]


@pytest.mark.slow
def test_patrol_charges_at_the_place_where_its_lap_begins(ran: Ran) -> None:
    seen = ran("patrol.yaml")
    waiting = [each for each in seen.seen if each.phase == "waiting"]
    states = [each.tick.snapshot.battery for each in waiting]
    charges = [state.charge for state in states if state is not None]
    assert charges[0] < 0.3 < 0.4 < charges[-1]
    assert math.hypot(waiting[0].pose.x, waiting[0].pose.y) < 0.05
    assert seen.recompute().difference is None


@pytest.mark.sampled(2)
@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.exhaustive] if name in LONGEST else [])
        for name in NAMES
        if name not in (BY_HAND, *ELSEWHERE, OTHER_TWIN)
    ],
)
def test_a_mission_that_comes_with_artemis_runs_in_simulation_to_its_end(ran: Ran, name: str) -> None:
    seen = ran(name)
    assert (seen.status, seen.fault_ids) == (0, FAULTS.get(name, []))
    assert seen.is_done
    assert seen.ticks[-1].wish.finished


@pytest.mark.slow
def test_the_figure_eight_is_driven_to_the_centimetre(ran: Ran) -> None:
    seen = ran("figure_eight.yaml")
    assert true_cross_track(seen) < 0.05
    assert max(position_errors(seen)) < 0.05
    assert seen.ticks[-1].snapshot.odometry.distance > 10.0


@pytest.mark.slow
def test_hidden_errors_lead_the_robot_away_while_it_believes_to_be_on_the_path(ran: Ran) -> None:
    seen = ran("hidden_errors.yaml")
    assert seen.cross_track() < 0.05
    errors = position_errors(seen)
    assert max(errors) > 0.1  # not at the end: what the one loop adds, the other takes away
    assert true_cross_track(seen) > 2 * seen.cross_track()


@pytest.mark.slow
def test_the_scripted_stick_drives_as_its_table_says(ran: Ran) -> None:
    seen = ran("teleop_scripted.yaml")
    lines = (MISSIONS / "inputs/loop.csv").read_text().splitlines()
    rows = [[float(cell) for cell in line.split(",")] for line in lines if line[:1].isdigit()]
    begun = seen.in_mode(Mode.TELEOP)[0].time
    checked = []
    for (time, x, y, enable, *_), (end, *_) in itertools.pairwise(rows):
        if not enable or end - time < 1.5:
            continue
        assert time > begun, "the mission's table drives before the robot is ready"
        truth = next(truth for truth in seen.world.history if truth.time >= end - 0.05)
        expected = sign(y), sign(-x)  # x is positive to the right
        checked.append(expected)
        assert (sign(truth.speed), sign(sum(truth.wheel_angles))) == expected
    assert {(1, 1), (1, -1), (-1, -1)} <= set(checked)
    assert seen.in_mode(Mode.TELEOP)[-1].standing
    assert seen.seen[-1].time < rows[-1][0] + 2.0


def sign(number: float) -> int:
    """-1, 0 or 1; what is next to nothing counts as 0."""
    return 0 if abs(number) < 0.02 else round(math.copysign(1, number))
