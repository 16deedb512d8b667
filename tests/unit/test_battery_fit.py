"""Numbers of a battery by what runs measured: found where they are determined, and only there."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest
from test_battery import battery

from artemis.battery import HOUR
from artemis.calibration.battery_fit import CAPACITY, FORCE, IDLE, PER_METRE, RESISTANCE, WIDEST, fit_battery
from artemis.calibration.battery_log import BatteryLog
from artemis.errors import CalibrationError

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
        assert abs(value.after - true) < 1.5 * value.half_width
    assert found.off < 0.05


def test_what_a_run_does_not_determine_is_left_as_it_is_and_said() -> None:
    """Driving alike all the time tells the sum of both powers, not which is which."""
    found = fit_battery(KNOWN, [log(1, 0.98, 3000.0, 30.0)])
    assert IDLE in found.undetermined
    assert IDLE not in found.values
    assert CAPACITY in found.values


def test_another_number_may_be_held() -> None:
    logs = [log(1, 0.98, 2400.0, 30.0, capacity_ah=2.0), log(2, 0.6, 2400.0, 0.0, capacity_ah=2.0)]
    found = fit_battery(KNOWN, logs, (CAPACITY,))
    assert CAPACITY not in found.values
    assert found.values[FORCE].after == pytest.approx(TRUE[FORCE], abs=1.5 * found.values[FORCE].half_width)


def test_runs_that_show_nothing_are_refused() -> None:
    with pytest.raises(CalibrationError, match="which determines nothing: drive longer"):
        fit_battery(KNOWN, [log(1, 0.9, 150.0, 0.0)], (FORCE, RESISTANCE))


def test_a_battery_that_was_charged_meanwhile_is_refused() -> None:
    logs = [log(1, 0.9, 1200.0, 30.0)]
    volts = logs[0].volts
    volts[len(volts) // 2 :] += 0.6
    with pytest.raises(CalibrationError, match="charged meanwhile"):
        fit_battery(KNOWN, logs)
