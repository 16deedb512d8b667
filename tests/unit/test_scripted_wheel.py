"""The operator from a file at a steering wheel: its columns, and what is refused."""

from __future__ import annotations

import math

import pytest
from pad import MISSIONS, ROBOT

from artemis.errors import ConfigError
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.scripted import ScriptedConfig, ScriptedInput
from artemis.values import Request

HEADER = "time_s,steering,gas,brake,enable,reverse\n"


def make(text: str) -> ScriptedInput:
    context = PluginContext(name="wheel", robot=ROBOT, folder=MISSIONS, files={"w.csv": text.encode()})
    return ScriptedInput(ScriptedConfig(file="w.csv", hysteresis_deg=0.0), context)


def test_columns_of_a_wheel_drive_and_steer() -> None:
    device = make(HEADER + "0,0,0,0,0,0\n1,-0.5,1,0,1,0\n2,-0.5,1,0.43,1,0\n3,0,0,0,0,0\n")
    assert device.read(0.0).neutral
    sample = device.read(1.0)
    assert (sample.enabled, sample.neutral, sample.axes) == (True, False, (-0.5, 1.0, 0.0))
    assert sample.speed == pytest.approx(0.7)
    assert math.degrees(sample.steering) == pytest.approx(30)
    assert device.read(2.0).speed == pytest.approx(0.35)
    assert device.read(3.0).speed == 0.0


def test_hard_brake_and_reverse_come_from_the_table() -> None:
    device = make(HEADER + "0,0,1,0,1,0\n1,0,1,1,1,0\n2,0,0,0,1,0\n3,0,0,0,1,1\n4,0,1,0,1,0\n9,0,0,0,0,0\n")
    assert device.read(0.0).speed > 0
    assert device.read(1.0).requests == (Request.QUICKSTOP,)
    assert device.read(2.0).requests == ()
    assert device.read(3.0).speed == 0.0
    assert device.read(4.0).speed == pytest.approx(-0.7)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("time_s,steering\n0,0\n", "expected the columns time_s, steering, gas, brake; no gas, brake"),
        (HEADER + "0,0,-0.1,0,0,0\n", "w.csv:2:5: gas: expected 0 to 1, found -0.1"),
        (HEADER + "0,1.1,0,0,0,0\n", "w.csv:2:3: steering: expected -1 to 1, found 1.1"),
        (HEADER + "0,0,0,0,0,2\n", "reverse: expected 0 or 1, found 2"),
        ("time_s,x,y,gas\n0,0,0,0\n", "unknown column 'x'"),
        ("time_s,x,y,reverse\n0,0,0,0\n", "unknown column 'reverse'"),
    ],
)
def test_what_is_no_wheel_is_refused(text: str, expected: str) -> None:
    with pytest.raises(ConfigError) as caught:
        make(text)
    assert expected in str(caught.value)
