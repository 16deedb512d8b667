"""The operator from a file."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from artemis.errors import ConfigError
from artemis.plugins.contracts import InputDevice, PluginContext
from artemis.plugins.inputs.scripted import ScriptedConfig, ScriptedInput
from artemis.values import OperatorInput, Request
from artemis.vehicle import RobotFile
from artemis.yaml_file import load

MISSIONS = Path(__file__).parents[2] / "missions"
HEADER = "time_s,x,y,enable\n"


@pytest.fixture(scope="module")
def robot() -> RobotFile:
    return RobotFile.model_validate(load(MISSIONS / "robots" / "artemis.yaml").data)


def make(robot: RobotFile, text: str | bytes, **keys: object) -> ScriptedInput:
    raw = text if isinstance(text, bytes) else text.encode()
    context = PluginContext(name="stick", robot=robot, folder=MISSIONS, files={"s.csv": raw})
    return ScriptedInput(ScriptedConfig.model_validate({"file": "s.csv", **keys}), context)


def problems_of(robot: RobotFile, text: str | bytes) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        make(robot, text)
    return caught.value.problems


def play(device: ScriptedInput, end: float, start: float = 0.0, dt: float = 0.02) -> list[OperatorInput]:
    return [device.read(start + index * dt) for index in range(round((end - start) / dt) + 1)]


# ---------------------------------------------------------------------------------------------- levels


def test_rows_hold_until_the_next(robot: RobotFile) -> None:
    device = make(robot, HEADER + "0,0,0,0\n1,0,1,1\n2,0,0,1\n")
    samples = {round(t * 0.1, 1): device.read(100 + t * 0.1) for t in range(25)}
    assert [samples[t].speed for t in (0.0, 0.9, 1.0, 1.9, 2.0)] == [0, 0, 0.7, 0.7, 0]
    assert [samples[t].enabled for t in (0.9, 1.0, 2.4)] == [False, True, True]
    assert [samples[t].neutral for t in (0.9, 1.0, 2.4)] == [True, False, False]
    assert samples[1.0].axes == (0.0, 1.0)
    assert samples[1.0].buttons == (True,)
    assert {sample.age for sample in samples.values()} == {0.0}


def test_time_begins_at_the_first_read(robot: RobotFile) -> None:
    device = make(robot, HEADER + "0,0,0,0\n1,0,1,1\n5,0,0,0\n")
    assert device.read(40.0).speed == 0
    assert device.read(40.9).speed == 0
    assert device.read(41.0).speed == pytest.approx(0.7)


def test_before_the_first_row_nothing_was_heard(robot: RobotFile) -> None:
    device = make(robot, HEADER + "1,0,1,1\n2,0,0,0\n")
    sample = device.read(0.0)
    assert sample.age is None
    assert sample.neutral
    assert sample.speed == 0
    assert device.read(1.0).age == 0.0


def test_stick_to_the_left_steers_left(robot: RobotFile) -> None:
    device = make(robot, HEADER + "0,-0.5,0.5,1\n1,0.5,0.5,1\n", hysteresis_deg=0.0)
    assert math.degrees(device.read(0.0).steering) == pytest.approx(45)
    assert math.degrees(device.read(1.0).steering) == pytest.approx(-45)


def test_released_stick_is_straight_and_standing(robot: RobotFile) -> None:
    device = make(robot, HEADER + "0,0.5,0.5,1\n1,0.03,0.04,1\n", hysteresis_deg=5.0)
    assert device.read(0.0).steering < -0.6
    released = device.read(1.0)
    assert released.steering == 0
    assert released.speed == 0


def test_angle_trails_by_the_hysteresis(robot: RobotFile) -> None:
    rows = [math.radians(angle) for angle in (10, 13, 8, 20)]
    text = HEADER + "".join(f"{i},{-math.sin(a)},{math.cos(a)},1\n" for i, a in enumerate(rows))
    device = make(robot, text, hysteresis_deg=5.0)
    taken = [math.degrees(device.read(float(i)).steering) for i in range(4)]
    assert taken == pytest.approx([5, 8, 8, 15], abs=1e-3)


def test_speed_is_the_share_of_the_configured_top_speed(robot: RobotFile) -> None:
    text = HEADER + "0,0,1,1\n1,0,0.525,1\n"
    device = make(robot, text, max_speed_m_s=0.4, speed_range=0.5)
    assert device.read(0.0).speed == pytest.approx(0.2)
    assert device.read(1.0).speed == pytest.approx(0.1)


def test_range_buttons_count_presses(robot: RobotFile) -> None:
    text = "time_s,x,y,slower,faster\n0,0,1,0,0\n1,0,1,1,0\n2,0,1,1,0\n3,0,1,0,0\n4,0,1,1,0\n5,0,1,0,1\n"
    device = make(robot, text, max_speed_m_s=0.5)
    assert [device.read(float(t)).speed for t in range(6)] == pytest.approx([0.5, 0.45, 0.45, 0.45, 0.4, 0.45])


def test_reversing_waits_until_the_robot_can_have_stopped(robot: RobotFile) -> None:
    device = make(robot, HEADER + "0,0,1,1\n1,0,-1,1\n9,0,0,0\n")
    samples = play(device, 3.0)
    after = [sample.speed for sample in samples[50:]]
    waited = after.count(0.0) * 0.02
    assert min(after[:30]) == 0.0
    assert waited == pytest.approx((0.7 - 0.05) / 1.0, abs=0.05)
    assert after[-1] == pytest.approx(-0.7)


# ---------------------------------------------------------------------------------------------- requests


def test_presses_are_reported_once(robot: RobotFile) -> None:
    text = "time_s,x,y,quickstop,arm\n0,0,0,0,0\n1,0,0,1,0\n2,0,0,1,1\n3,0,0,0,0\n4,0,0,1,0\n9,0,0,0,0\n"
    found = [(index, sample.requests) for index, sample in enumerate(play(make(robot, text), 8.0, dt=0.5))]
    assert [(index, requests) for index, requests in found if requests] == [
        (2, (Request.QUICKSTOP,)),
        (4, (Request.ARM,)),
        (8, (Request.QUICKSTOP,)),
    ]


def test_presses_between_two_reads_are_not_lost(robot: RobotFile) -> None:
    text = "time_s,x,y,quickstop,acknowledge\n0,0,0,0,0\n0.1,0,0,1,0\n0.2,0,0,0,1\n0.3,0,0,0,0\n9,0,0,0,0\n"
    device = make(robot, text)
    device.read(0.0)
    assert device.read(0.5).requests == (Request.QUICKSTOP, Request.ACKNOWLEDGE)
    assert device.read(0.52).requests == ()


def test_button_pressed_from_the_start_counts(robot: RobotFile) -> None:
    device = make(robot, "time_s,x,y,end\n0,0,0,1\n5,0,0,0\n")
    assert device.read(3.0).requests == (Request.END,)


def test_end_of_the_file_asks_for_done_once_and_stays_alive(robot: RobotFile) -> None:
    samples = play(make(robot, HEADER + "0,0,1,1\n1,0,0,0\n"), 4.0)
    assert [index for index, sample in enumerate(samples) if Request.DONE in sample.requests] == [50]
    assert samples[-1].age == 0.0
    assert samples[-1].neutral


def test_without_done_the_end_is_silence(robot: RobotFile) -> None:
    samples = play(make(robot, HEADER + "0,0,1,1\n1,0,0.5,1\n", done_at_end=False), 3.0)
    assert not any(sample.requests for sample in samples)
    assert samples[49].age == 0.0
    assert samples[-1].age == pytest.approx(2.0)
    assert samples[-1].speed > 0.3


# ---------------------------------------------------------------------------------------------- refusals


def test_every_problem_is_reported_with_its_place(robot: RobotFile) -> None:
    text = "time_s,x,y,enable\n0,0,2,0\n1,nan,0,0\n1,0,0,0.5\n0.5,0,0,1\n2,0,0\n"
    problems = problems_of(robot, text)
    assert [problem.split(": ")[0] for problem in problems] == [
        "s.csv:2:5",
        "s.csv:3:3",
        "s.csv:4:7",
        "s.csv:5:1",
        "s.csv:6:5",
    ]
    assert "y: expected -1 to 1, found 2" in problems[0]
    assert "enable: expected 0 or 1" in problems[2]
    assert "more than in the row before" in problems[3]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "no rows: expected a line with the columns, such as time_s,x,y,"),
        ("time_s,x,y\n", "no rows"),
        ("time_s,x,y,enabel\n0,0,0,0\n", "s.csv:1:12: unknown column 'enabel'; nearest is 'enable'"),
        ("time_s,x\n0,0\n", "no y"),
        ("time_s,x,y\n-1,0,0\n", "expected at least 0"),
        (b"time_s,x,y\n0,\xff,0\n", "byte 13 is not text in UTF-8"),
    ],
)
def test_what_is_no_script_is_refused(robot: RobotFile, text: str | bytes, expected: str) -> None:
    assert expected in "\n".join(problems_of(robot, text))


def test_missing_file_is_named(robot: RobotFile) -> None:
    with pytest.raises(ConfigError, match=r"stick: file: no 'other.csv'"):
        make(robot, HEADER, file="other.csv")


def test_a_speed_beyond_the_robots_is_refused(robot: RobotFile) -> None:
    with pytest.raises(ConfigError, match=r"max_speed_m_s: 0.8; the robot's limit is 0.7"):
        make(robot, HEADER + "0,0,0,0\n", max_speed_m_s=0.8)


# ---------------------------------------------------------------------------------------------- the shipped one


def test_shipped_loop_drives_both_ways_and_ends_neutral(robot: RobotFile) -> None:
    device: InputDevice = make(robot, (MISSIONS / "inputs" / "loop.csv").read_bytes())
    samples = [device.read(index * 0.02) for index in range(2000)]
    device.close()
    device.close()
    assert max(sample.speed for sample in samples) > 0.4
    assert min(sample.speed for sample in samples) < -0.2
    assert max(sample.steering for sample in samples) > 0.3
    assert min(sample.steering for sample in samples) < -0.3
    assert samples[0].neutral
    assert samples[-1].neutral
    assert sum(sample.requests.count(Request.DONE) for sample in samples) == 1
