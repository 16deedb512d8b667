"""The battery: what its file may say, what is estimated of it, and what the robot does when it runs low."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from math import sqrt
from pathlib import Path
from random import Random
from typing import Any

import pytest
import yaml
from core_builders import ROBOT
from pydantic import ValidationError

from artemis.battery import HOUR, Battery, BatteryState
from artemis.config import Inconsistent
from artemis.mission.loading import load_mission
from artemis.motion.charge import ChargeEstimate
from artemis.supervision.supply import SupplyMeasures
from artemis.values import DriveFeedback, Sensed

TELLS = 0.12
"""Below this charge a tenth of what is left above the reserve is less than 20 mV: no voltage that is measured in steps
of 0.1 V tells that."""
FILE = Path(__file__).parents[2] / "missions" / "robots" / "artemis_battery.yaml"
BATTERY: dict[str, Any] = yaml.safe_load(FILE.read_text())["battery"]


def battery(**changes: Any) -> Battery:  # noqa: ANN401 (as a file writes them)
    return Battery.model_validate({**BATTERY, **changes})


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"curve_v": [[0, 21.5]]}, "curve_v: expected pairs from 0 to 100 percent"),
        ({"curve_v": [[0, 21.5], [90, 25.0]]}, "curve_v: expected pairs from 0 to 100 percent"),
        ({"curve_v": [[0, 21.5], [50, 25.0], [100, 25.0]]}, "curve_v: expected charges that rise, and voltages"),
        ({"curve_v": [[0, 21.5], [0, 22.0], [100, 25.0]]}, "curve_v: expected charges that rise, and voltages"),
        ({"critical_v": 23.0}, "critical_v: expected less than low_v (22.3 V), found 23 V"),
        ({"low_v": 25.6}, "low_v: expected less than a full battery has (25.6 V), found 25.6 V"),
        ({"critical_v": 17.1}, "critical_v: expected at least 17.2 V, 80% of what an empty battery has, found 17.1 V"),
    ],
)
def test_what_cannot_be_a_battery_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError) as refused:
        battery(**changes)
    problem = refused.value.errors()[0]["ctx"]["error"]
    assert isinstance(problem, Inconsistent)
    assert str(problem).startswith(words)


def test_a_battery_is_told_when_nobody_measures_what_the_wheels_take(tmp_path: Path) -> None:
    words = yaml.safe_load(FILE.with_name("artemis_cia402.yaml").read_text())
    analog = [{"index": index, "type": "i16", "units_per_v": 1000.0} for index in (0x2401, 0x2402)]
    words["drives"]["traction-left"]["cia402"] = {**words["drives"]["traction-left"]["cia402"], "analog_inputs": analog}
    words["battery"] = {**BATTERY, "measured": {"drive": "traction-left", "input": 1, "divider": 6.0}}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(words))
    (tmp_path / "m.yaml").write_text("{mission: m, robot: robot.yaml, bus: simulation, steps: [{wait: {seconds: 1}}]}")
    assert load_mission(tmp_path / "m.yaml").remarks == ()
    del words["drives"]["traction-left"]["cia402"]["current"]
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(words))
    (remark,) = load_mission(tmp_path / "m.yaml").remarks
    assert remark.startswith("nobody measures the current of traction-left (`cia402.current`): what they take of the ")
    words["battery"]["measured"] = None
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(words))
    assert load_mission(tmp_path / "m.yaml").remarks == (), "nobody says anything of the battery then"


@pytest.mark.parametrize(("empty", "least"), [(24.0, 19.2), (23.0, 18.4), (21.8, 17.4)])
def test_the_least_voltage_that_a_message_names_is_taken(empty: float, least: float) -> None:
    assert battery(curve_v=[[0, empty], [100, 26.0]], critical_v=least).critical_v == least
    with pytest.raises(ValidationError):
        battery(curve_v=[[0, empty], [100, 26.0]], critical_v=least - 0.1)


def test_voltage_and_charge_are_each_others_inverse() -> None:
    for percent in range(101):
        voltage, slope = battery().voltage_at(percent / 100.0)
        assert battery().charge_at(voltage) == pytest.approx(percent / 100.0)
        assert slope > 0.0
    assert (battery().charge_at(10.0), battery().charge_at(30.0)) == (0.0, 1.0)


# ------------------------------------------------------------------------------------------------ what is estimated


@dataclasses.dataclass
class Plant:
    """A battery and a robot that are not as the robot file says, stepped once a second; drives at random.

    Nor are they of its kind: the battery recovers slowly, what measures its voltage has steps, and something takes
    power that no motor current of a driven wheel tells.
    """

    dice: Random
    charge: float = 1.0
    joules: float = 0.0
    metres: float = 0.0
    recovering: float = 0.0
    """By so much the voltage is lower than it will be [V]."""

    def __post_init__(self) -> None:
        self.known = battery(capacity_ah=5.0, joules_per_metre=95.0 * self.dice.uniform(0.7, 1.3))
        self.capacity = self.known.capacity_ah * HOUR * self.dice.uniform(0.9, 1.1)
        self.idle = self.known.idle_w * self.dice.uniform(0.85, 1.15)
        self.force = self.known.newtons_per_ampere * self.dice.uniform(0.9, 1.1)
        self.resistance = self.known.resistance_ohm * self.dice.uniform(0.8, 1.2)
        self.slow_resistance = 0.02 * self.dice.random()
        self.speed = 0.5

    def stand(self, charged: float = 0.0) -> tuple[float, tuple[DriveFeedback, ...], float]:
        """The same of a robot that stands while a charger gives so much [A]."""
        rest, _ = self.known.voltage_at(self.charge)
        amperes = self.idle / rest - charged
        self.charge -= amperes / self.capacity
        self.joules += self.idle
        self.recovering -= self.recovering / 300.0
        return round(rest - self.resistance * amperes - self.recovering + self.dice.gauss(0.0, 0.02), 1), (), 0.0

    def second(self) -> tuple[float, tuple[DriveFeedback, ...], float]:
        """Measured voltage, what the drives say, and the way driven."""
        if self.dice.random() < 0.05:
            self.speed = self.dice.uniform(0.4, 0.6)
        amperes = self.dice.uniform(0.8, 1.6)
        watts = self.idle + 2.0 * (self.force * amperes + 0.02 * amperes**2) * self.speed + self.dice.uniform(0.0, 2.0)
        rest, _ = self.known.voltage_at(self.charge)
        volts = (rest + sqrt(rest * rest - 4.0 * self.resistance * watts)) / 2.0
        self.recovering += (self.slow_resistance * watts / volts - self.recovering) / 300.0
        volts -= self.recovering
        self.charge -= watts / volts / self.capacity
        self.joules, self.metres = self.joules + watts, self.metres + self.speed
        drives = tuple(
            DriveFeedback(name=name, current=sign * amperes, velocity=self.speed)
            for name, sign in (("traction-left", 1.0), ("traction-right", -1.0))  # this one is mirrored
        )
        return round(volts + self.dice.gauss(0.0, 0.02), 1), drives, self.speed


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(40))
def test_the_range_is_right_within_a_tenth_from_half_charge_on(seed: int) -> None:
    plant = Plant(Random(seed))
    estimate = ChargeEstimate(plant.known, ROBOT)
    told: list[tuple[float, float, BatteryState]] = []
    while plant.charge > plant.known.reserve_percent / 100.0:
        metres, charge = plant.metres, plant.charge
        told.append((metres, charge, estimate.update(*plant.second(), 1.0)))
    later = told[60:]
    assert all(abs(state.charge - true) < 2.0 * state.charge_std for _, true, state in later)
    late = [(plant.metres - metres, true, state) for metres, true, state in told if true < 0.5]
    assert len(late) > 1000
    for left, true, state in late:
        if true > TELLS:
            assert state.range_m == pytest.approx(left, rel=0.1)
        else:
            assert state.range_m == pytest.approx(left, abs=0.003 * plant.metres)
        assert abs(state.range_m - left) < 2.5 * state.range_std_m
    assert told[-1][2].joules == pytest.approx(plant.joules, rel=0.15)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("rate", "seconds"), [(0.1, 7200), (0.3, 3600), (1.0, 1200), (0.0, 3600)])
@pytest.mark.parametrize("seed", range(4))
def test_a_charger_teaches_nothing_but_the_charge(seed: int, rate: float, seconds: int) -> None:
    """At so much of the capacity in an hour, more than the robot takes; 0: it holds the charge."""
    plant = Plant(Random(seed))
    estimate = ChargeEstimate(plant.known, ROBOT)
    before = [estimate.update(*plant.second(), 1.0) for _ in range(2400)][-1]
    assert plant.charge < 0.8
    amperes = rate * plant.known.capacity_ah + plant.idle / 25.0
    for _ in range(seconds):
        charged = estimate.update(*plant.stand(amperes if plant.charge < 0.95 else plant.idle / 25.0), 1.0)
        assert abs(charged.charge - plant.charge) < 2.0 * charged.charge_std
    assert charged.watts == pytest.approx(plant.idle, rel=0.25)
    whole = before.range_m / (before.charge - 0.1)
    assert charged.range_m / (charged.charge - 0.1) == pytest.approx(whole, rel=0.05)
    told: list[tuple[float, float, BatteryState]] = []
    while plant.charge > TELLS:
        metres, charge = plant.metres, plant.charge
        told.append((metres, charge, estimate.update(*plant.second(), 1.0)))
    reserve = plant.known.reserve_percent / 100.0
    end = plant.metres + (plant.charge - reserve) * (plant.metres - told[-600][0]) / (told[-600][1] - plant.charge)
    for metres, _, state in told[60:]:
        assert state.range_m == pytest.approx(end - metres, rel=0.15)
        assert abs(state.range_m - (end - metres)) < 2.5 * state.range_std_m


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("drives", "stands"), [(30, 10), (60, 60), (300, 150)])
@pytest.mark.parametrize("seed", range(6))
def test_the_range_is_right_within_a_tenth_where_driving_and_standing_take_turns(
    seed: int, drives: int, stands: int
) -> None:
    plant = Plant(Random(seed))
    estimate = ChargeEstimate(plant.known, ROBOT)
    told: list[tuple[float, float, float, BatteryState]] = []
    taken = 0.0  # by driving alone
    while plant.charge > 0.1:
        metres, charge, driving = plant.metres, plant.charge, len(told) % (drives + stands) < drives
        state = estimate.update(*(plant.second() if driving else plant.stand()), 1.0)
        told.append((metres, charge, taken, state))
        taken += charge - plant.charge if driving else 0.0
    late = [each for each in told if TELLS < each[1] < 0.5]
    assert len(late) > 1000
    for metres, charge, before, state in late:
        left = (charge - 0.1) * (plant.metres - metres) / (taken - before)
        assert state.range_m == pytest.approx(left, rel=0.1)
        assert abs(state.range_m - left) < 2.0 * state.range_std_m


@pytest.mark.parametrize("curve_v", [-0.1, 0.0, 0.1])
@pytest.mark.parametrize("rate", [0.05, 0.3, 0.5])
def test_the_charge_at_a_charger_is_as_certain_as_it_says(rate: float, curve_v: float) -> None:
    """The run begins there: at constant current, then at the voltage of the full battery. Then it stands and drives.

    All that three times; the curve of the robot file is wrong by one standard deviation.
    """
    plant = Plant(Random(5), charge=0.6)
    estimate = ChargeEstimate(plant.known, ROBOT)

    def update(volts: float, drives: tuple[DriveFeedback, ...], driven: float) -> None:
        state = estimate.update(volts + curve_v, drives, driven, 1.0)
        assert abs(state.charge - plant.charge) < 2.0 * state.charge_std

    for _ in range(3):
        for _ in range(1200):
            rest, _ = plant.known.voltage_at(plant.charge)
            most = max((25.6 - rest) / plant.resistance, 0.0)
            update(*plant.stand(plant.idle / 25.0 + min(rate * plant.known.capacity_ah, most)))
        for _ in range(300):
            update(*plant.stand())
        for _ in range(300):
            update(*plant.second())


def test_without_load_the_charge_is_that_of_the_voltage_and_time_is_left_by_what_is_taken() -> None:
    estimate = ChargeEstimate(battery(), ROBOT)
    state = [estimate.update(24.4 - 0.1 * 20.0 / 24.4, (), 0.0, 1.0) for _ in range(60)][-1]
    assert state.charge == pytest.approx(0.5, abs=0.01)
    joules = (state.charge - 0.1) * 17.0 * HOUR * battery().voltage_at((state.charge + 0.1) / 2.0)[0]
    assert state.time_left_s == pytest.approx(joules / 20.0, rel=0.02)
    assert state.range_m == pytest.approx(joules / 85.0, rel=0.02)


def test_what_drives_feed_back_for_a_while_makes_no_range_without_end() -> None:
    estimate = ChargeEstimate(battery(), ROBOT)
    down = tuple(
        DriveFeedback(name=name, current=-sign * 3.0, velocity=0.5)
        for name, sign in (("traction-left", 1.0), ("traction-right", -1.0))
    )
    state = [estimate.update(24.4, down, 0.5, 1.0) for _ in range(600)][-1]
    assert state.watts < 0.0
    joules = (state.charge - 0.1) * 17.0 * HOUR * 24.5
    assert state.range_m < 1.5 * joules / (20.0 / ROBOT.limits.speed_m_s)


# ------------------------------------------------------------------------------------------------ what is wrong


def seen(voltage: Callable[[float], float], seconds: float) -> dict[str, float]:
    """When each reading came first [s]."""
    measures, found = SupplyMeasures(battery()), dict[str, float]()
    for number in range(round(seconds * 50)):
        time = number / 50
        for id, _, value, _ in measures.read(Sensed(index=number, time=time, battery_v=voltage(time))):
            if value > (0.15 if id == "PWR-03" else 0.0):
                found.setdefault(id, time)
    return found


def test_a_short_dip_is_no_low_battery_and_a_long_one_is() -> None:
    assert seen(lambda time: 24.0, 10.0) == {}
    assert "PWR-01" not in seen(lambda time: 21.9 if 3.0 <= time < 3.5 else 24.0, 10.0)
    assert seen(lambda time: 22.0 if time >= 3.0 else 24.0, 10.0)["PWR-01"] == pytest.approx(3.0 + 3.8, abs=0.2)
    assert seen(lambda time: 21.0 if time >= 3.0 else 24.0, 10.0)["PWR-02"] == pytest.approx(3.0, abs=0.021)
    assert seen(lambda time: 20.0 if 3.0 <= time < 3.5 else 24.0, 10.0)["PWR-03"] == pytest.approx(3.0, abs=0.021)
    assert SupplyMeasures(battery()).read(Sensed(index=0, time=0.0)) == []
