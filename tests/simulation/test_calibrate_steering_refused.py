"""Where the potentiometers of a steered wheel cannot be measured, mode calibrate says why, and changes nothing."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from rig import Rig
from steering_rig import (
    LEFT,
    LEFT_ALONE,
    PLAIN,
    RIGHT,
    Act,
    assert_safe,
    calibrate,
    jogs,
    memory,
    reading,
)

from artemis.drive_states import DriveState
from artemis.sim.wheels import PotentiometerFailure
from artemis.values import Mode

pytestmark = pytest.mark.short_alignment


# ---------------------------------------------------------------------------------------------- what is wrong


def stuck(rig: Rig) -> None:
    assert rig.world is not None
    rig.world.steered[LEFT].freeze()


def one_stuck(rig: Rig) -> None:
    assert rig.world is not None
    rig.world.steered[LEFT].failures[0] = PotentiometerFailure(stuck=2.5)


def swapped(rig: Rig) -> None:
    """The plugs of both potentiometers of a wheel."""
    assert rig.world is not None
    wheel = rig.world.steered[LEFT]
    wheel._zero_v = wheel._zero_v[1], wheel._zero_v[0]
    wheel._slope_1, wheel._slope_2 = wheel._slope_2, wheel._slope_1


def drifting(rig: Rig) -> None:
    assert rig.world is not None
    since = rig.bus.loop.time()
    rig.world.steered[LEFT].failures[1] = PotentiometerFailure(since=since, drift=0.002)


def drifting_away(rig: Rig) -> None:
    assert rig.world is not None
    since = rig.bus.loop.time()
    rig.world.steered[LEFT].failures[1] = PotentiometerFailure(since=since, drift=0.05)


def slips(degrees: float) -> Act:
    def slip(rig: Rig) -> None:
        assert rig.world is not None
        rig.world.steered[LEFT].slip_coupling(math.radians(degrees))

    return slip


def stalls(rig: Rig) -> None:
    rig.drive(LEFT).axis.fail(blocked=True)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("act", "after", "faults"),
    [
        (stuck, 5.0, ("STE-05", "STE-07")),
        (one_stuck, 5.0, ("STE-03",)),
        (drifting, 1.0, ("CAL-01",)),
        (drifting_away, 1.0, ("STE-03",)),
        (slips(2.0), 5.0, ("CAL-01",)),
        (slips(9.0), 5.0, ("STE-05",)),
        (stalls, 5.0, ("STE-01", "STE-02", "DRV-25")),
    ],
    ids=["stuck", "one stuck", "drifting", "drifting far", "slipping", "slipping far", "stall"],
)
def test_what_goes_wrong_while_a_wheel_is_measured_is_named_and_changes_nothing(
    tmp_path: Path, act: Act, after: float, faults: tuple[str, ...]
) -> None:
    rig = calibrate(tmp_path, PLAIN, **LEFT_ALONE)
    rig.when(reading, lambda: act(rig), after=after)
    run = rig.run()

    assert run.faults[0].id in faults, run.faults[0].text
    assert run.faults[0].device == LEFT
    if faults == ("CAL-01",):
        assert "off its line: it drifts, or a coupling slips" in run.faults[0].text
    assert run.status == 1
    assert run.results.kept == {}
    assert memory(run.world.drive(LEFT)) == (0, 0, 0, 0)
    assert_safe(run)


def test_swapped_plugs_are_noticed_before_anything_is_measured(tmp_path: Path) -> None:
    rig = calibrate(tmp_path)
    rig.at(0.1, lambda: swapped(rig))
    run = rig.run()

    assert (run.faults[0].id, run.faults[0].device) == ("STE-05", LEFT)
    assert Mode.CALIBRATE not in run.modes
    assert run.world.truth.states == (DriveState.SWITCH_ON_DISABLED,) * 4


def test_potentiometers_of_the_other_wheel_are_noticed(tmp_path: Path) -> None:
    """New ones, and their cables go to the wrong drives: they follow a wheel that turns otherwise."""
    rig = calibrate(tmp_path, potentiometers="new", reference_deg={"left": 7.0, "right": -4.0})

    def cross() -> None:
        assert rig.world is not None
        left, right = rig.world.steered[LEFT], rig.world.steered[RIGHT]
        left._axis, right._axis = _Crossed(left._axis, right._axis), _Crossed(right._axis, left._axis)  # type: ignore[assignment]

    rig.at(0.1, cross)
    run = rig.run()

    assert (run.faults[0].id, run.faults[0].device) == ("CAL-01", LEFT)
    assert "off its line" in run.faults[0].text


class _Crossed:
    """The position of one axis; what the potentiometers show goes to another."""

    def __init__(self, axis: Any, other: Any) -> None:  # noqa: ANN401
        self._axis, self._other = axis, other

    @property
    def position(self) -> float:
        return float(self._axis.position)

    @property
    def analog(self) -> object:
        return self._other.analog

    @analog.setter
    def analog(self, volts: tuple[float, float]) -> None:
        self._other.analog = volts


def test_slope_far_from_the_robot_file_is_refused(tmp_path: Path) -> None:
    """Where the wheels turn less, so that the supervisor sees less of it."""
    true = PLAIN.model_copy(update={"potentiometer_slopes_left": (1.12, 1.12)})
    rig = calibrate(tmp_path, true, limits={"steering_deg: 60": "steering_deg: 28"}, **LEFT_ALONE)
    run = rig.run()

    assert (run.faults[0].id, run.faults[0].device) == ("CAL-01", LEFT)
    assert "potentiometer 1: 80.6 degrees per volt, the robot file says 72.0" in run.faults[0].text
    assert_safe(run)


def test_potentiometers_far_apart_are_worth_a_warning(tmp_path: Path) -> None:
    rig = calibrate(tmp_path, PLAIN, **LEFT_ALONE)
    rig.when(reading, lambda: _shift(rig))
    run = rig.run()

    assert run.status == 0
    assert "by the robot file its potentiometers are 2." in run.faults[0].text


def _shift(rig: Rig) -> None:
    assert rig.world is not None
    rig.world.steered[LEFT].failures[0] = PotentiometerFailure(offset=0.028)


def test_wheel_that_is_straight_near_its_limit_is_not_turned(tmp_path: Path) -> None:
    run = calibrate(tmp_path, wheels="left", reference_deg={"left": 40.0}, save="nothing").run()

    assert (run.faults[0].id, run.faults[0].device) == ("CAL-01", LEFT)
    assert "at its limit" in run.faults[0].text
    turned = max(abs(math.degrees(s.tick.set_points.steering_left)) for s in run.in_mode(Mode.CALIBRATE))
    assert turned < 1.0


def test_angles_of_new_wheels_count_once(tmp_path: Path) -> None:
    """Somebody stopped the run: the wheels are not any more where they were measured from outside."""
    acts = jogs((8.0, "quickstop"), (10.0, "acknowledge"), (11.0, "arm"), (30.0, "end"))
    words: dict[str, Any] = {"potentiometers": "new", "reference_deg": {"left": 7.0, "right": -4.0}}
    run = calibrate(tmp_path, PLAIN, acts, **words).run()

    assert [fault.id for fault in run.faults] == ["CAL-01"]
    assert "start again" in run.faults[0].text
    assert run.results.kept == {}
    assert not [truth for truth in run.world.history if DriveState.OPERATION_ENABLE in truth.states[:2]]
