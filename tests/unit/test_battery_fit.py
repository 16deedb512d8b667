"""Numbers of a battery by what runs measured: found where they are determined, and only there."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest
from test_battery import battery

from artemis.battery import HOUR
from artemis.calibration.battery_fit import (
    CAPACITY,
    FORCE,
    IDLE,
    PER_METRE,
    QUANTILE,
    RESISTANCE,
    WIDEST,
    fit_battery,
)
from artemis.calibration.battery_log import BatteryLog
from artemis.commands import calibrate_battery
from artemis.errors import CalibrationError, ConfigError

SECONDS = 5.0
KNOWN = battery(capacity_ah=2.0)
TRUE = {CAPACITY: 1.7, IDLE: 25.0, FORCE: KNOWN.newtons_per_ampere, RESISTANCE: 0.13}


def log(seed: int, charge: float, seconds: float, drives: float, **true: float) -> BatteryLog:
    """A stretch from a charge on, in which the wheels take so much by the file [W], a fifth more or less each time."""
    dice, numbers = Random(seed), {**TRUE, **true}
    rows = []
    for _ in range(round(seconds / SECONDS)):
        told = drives * dice.uniform(0.8, 1.2)
        watts = numbers[IDLE] + told * numbers[FORCE] / KNOWN.newtons_per_ampere
        rest, _ = KNOWN.voltage_at(charge)
        volts = rest - numbers[RESISTANCE] * watts / rest
        charge -= watts * SECONDS / volts / (numbers[CAPACITY] * HOUR)
        shown = round(volts + dice.gauss(0.0, 0.01), 1)
        moves = drives > 0.0
        rows.append(
            (
                SECONDS,
                shown,
                KNOWN.idle_w * SECONDS / shown,
                told * SECONDS / shown,
                2.0 * moves,
                KNOWN.idle_w * SECONDS * moves,
                told * SECONDS,
            )
        )
    columns = "seconds", "volts", "idle", "drive", "metres", "idle_joules", "drive_joules"
    return BatteryLog(name="a run", **dict(zip(columns, np.array(rows).T, strict=True)))


@pytest.mark.parametrize("seed", range(6))
def test_runs_that_drive_and_stand_determine_all_but_what_is_held(seed: int) -> None:
    logs = [log(seed, 0.98, 2400.0, 30.0), log(seed + 100, 0.6, 2400.0, 0.0)]
    found = fit_battery(KNOWN, logs)
    assert found.undetermined == {}
    assert set(found.values) == {CAPACITY, IDLE, RESISTANCE, PER_METRE}
    for key, value in found.values.items():
        true = TRUE.get(key, (25.0 + 30.0) / 0.4)
        assert value.half_width < WIDEST * value.after
        assert abs(value.after - true) < 1.96 * value.half_width / QUANTILE
    assert found.off < 0.05


@pytest.mark.parametrize("seed", range(4))
def test_what_a_run_does_not_determine_is_said_and_makes_other_intervals_wider(seed: int) -> None:
    """Driving alike all the time hardly tells which of both powers is which."""
    found = fit_battery(KNOWN, [log(seed, 0.98, 2400.0, 30.0)])
    assert IDLE in found.undetermined
    assert not {IDLE, PER_METRE}.intersection(found.values)
    assert found.values
    for key, value in found.values.items():
        assert abs(value.after - TRUE[key]) < 1.96 * value.half_width / QUANTILE


@pytest.mark.parametrize(("seed", "seconds"), [(2, 600.0), (7, 600.0), (2, 900.0), (4, 900.0)])
def test_a_short_run_tells_nothing_that_is_wrong(seed: int, seconds: float) -> None:
    """The best fit of one of them is twenty times the true power."""
    try:
        values = fit_battery(KNOWN, [log(seed, 0.9, seconds, 30.0)]).values
    except CalibrationError:
        return
    for key, value in values.items():
        assert abs(value.after - TRUE[key]) < 1.96 * value.half_width / QUANTILE


def test_another_number_may_be_held() -> None:
    logs = [log(1, 0.98, 2400.0, 30.0, capacity_ah=2.0), log(2, 0.6, 2400.0, 0.0, capacity_ah=2.0)]
    found = fit_battery(KNOWN, logs, (CAPACITY,))
    assert CAPACITY not in found.values
    assert found.values[FORCE].after == pytest.approx(TRUE[FORCE], abs=1.5 * found.values[FORCE].half_width)


@pytest.mark.parametrize(
    ("key", "hold"),
    [("resistance_ohm", []), ("idle_w", []), ("idle_w", ["idle_w"]), ("idle_w", ["idle_w", "resistance_ohm"])],
)
def test_a_number_that_is_zero_in_the_file_is_refused(
    key: str, hold: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is zero stays zero, by whatever factor it is wrong; nor is zero a number that can be held for a scale."""
    known = battery(**{"capacity_ah": 2.0, key: 0.0})
    monkeypatch.setattr(calibrate_battery, "_read", lambda runs: (known, [log(1, 0.98, 2400.0, 30.0)]))
    with pytest.raises(ConfigError, match=f"battery.{key} is 0 in the robot file.*write an estimate first"):
        calibrate_battery.calibrate_battery([], hold, None, yes=False)


def test_a_resistance_of_zero_may_be_held(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    known = battery(capacity_ah=2.0, resistance_ohm=0.0)
    logs = [log(1, 0.98, 2400.0, 30.0, resistance_ohm=0.0), log(2, 0.6, 2400.0, 0.0, resistance_ohm=0.0)]
    monkeypatch.setattr(calibrate_battery, "_read", lambda runs: (known, logs))
    calibrate_battery.calibrate_battery([], [FORCE, RESISTANCE], None, yes=False)
    assert "capacity_ah" in capsys.readouterr().out


def test_runs_that_show_nothing_are_refused() -> None:
    with pytest.raises(CalibrationError, match="which determines nothing: drive longer"):
        fit_battery(KNOWN, [log(1, 0.9, 150.0, 0.0)], (FORCE, RESISTANCE))


def test_a_battery_that_was_charged_meanwhile_is_refused() -> None:
    logs = [log(1, 0.9, 1200.0, 30.0)]
    volts = logs[0].volts
    volts[len(volts) // 2 :] += 0.6
    with pytest.raises(CalibrationError, match="charged meanwhile"):
        fit_battery(KNOWN, logs)
