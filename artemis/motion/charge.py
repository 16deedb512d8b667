"""How full the battery is, by a Kalman filter of what was taken of it and of its voltage; and how far that reaches.

Its state is the charge, and what the robot truly takes as a multiple of what the model says (the robot file's
`idle_w`, and force times speed of the driven wheels by their currents). A battery is a voltage that rises with the
charge behind a resistance (Plett 2004, "Extended Kalman filtering for battery management systems", part 2, the simple
model, doi 10.1016/j.jpowsour.2004.02.032).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import sqrt

from artemis.battery import HOUR, Battery, BatteryState
from artemis.motion.totals import smoothed, total
from artemis.values import DriveFeedback
from artemis.vehicle import RobotFile

FIRST_SCALE = 0.15
"""Standard deviation of what the robot truly takes, as a share of the model's."""
DRIFT = 0.02
"""How much that changes in an hour of driving, a standard deviation."""
CURVE = 0.1
"""The curve of the robot file is that uncertain [V]: an error that no number of measurements averages away."""
NOISE, EVERY = 0.06, 5.0
"""One measured voltage, of the mean of so long [s], says so much [V]: loads, and the battery's own slow recovery."""
UNDER_LOAD = 2.0
"""The voltage that is told, and that shows a low battery, is a mean of so long [s]: a start takes more for less."""
RECENT_M, RECENT_S = 100.0, 120.0
"""What a metre takes is learned over so long a distance [m]; the mean power over so long a time [s]."""


class ChargeEstimate:
    """Carries the charge on from tick to tick. Deterministic."""

    def __init__(self, battery: Battery, robot: RobotFile) -> None:
        """Begin; the battery is that of the robot."""
        self._battery, force = battery, battery.newtons_per_ampere
        self._forces = {
            name: -force if drive.mirrored else force
            for name, drive in robot.drives.items()
            if drive.role == "traction"
        }
        self._least_per_metre = max(battery.idle_w / robot.limits.speed_m_s, 1e-3)
        """At the robot's highest speed, driven by nothing [J/m]: what drives feed back on a slope does not last."""
        self._coulombs = HOUR * battery.capacity_ah
        self._charge, self._scale = -1.0, 1.0
        self._var, self._mixed, self._scale_var = 0.0, 0.0, FIRST_SCALE**2
        self._under_load = 0.0
        self._joules, self._per_metre, self._watts = 0.0, battery.joules_per_metre, battery.idle_w
        self._seen, self._sum = 0.0, 0.0

    def update(self, volts: float, drives: Iterable[DriveFeedback], speed: float, dt: float) -> BatteryState:
        """The state after `dt` [s] at a supply voltage [V] and a speed [m/s, either way]."""
        battery, volts = self._battery, max(volts, 1.0)
        modelled = battery.idle_w + taken(drives, self._forces)
        watts, amperes = self._scale * modelled, modelled / volts
        if self._charge < 0.0:
            self._charge = battery.charge_at(volts + battery.resistance_ohm * amperes)
            self._under_load = volts
            _, slope = battery.voltage_at(self._charge)
            self._var = (NOISE / slope) ** 2
        self._predict(amperes * dt / self._coulombs, dt)
        self._joules += watts * dt
        self._watts = smoothed(self._watts, modelled, dt, RECENT_S)
        self._under_load = smoothed(self._under_load, volts, dt, UNDER_LOAD)
        driven = abs(speed) * dt
        if driven > 0.0:
            self._per_metre += (modelled * dt - self._per_metre * driven) / RECENT_M
        self._take(volts, amperes, dt)
        return self._state(volts, watts)

    def _predict(self, used: float, dt: float) -> None:
        """Take a share of the capacity, as the model says it."""
        self._charge = min(max(self._charge - self._scale * used, 0.0), 1.0)
        self._var += used * used * self._scale_var - 2.0 * used * self._mixed
        self._mixed -= used * self._scale_var
        self._scale_var += DRIFT * DRIFT * dt / HOUR

    def _take(self, volts: float, amperes: float, dt: float) -> None:
        """Use the mean of a few seconds of what the battery would show without its load."""
        self._sum += (volts + self._scale * amperes * self._battery.resistance_ohm) * dt
        self._seen += dt
        if self._seen < EVERY:
            return
        mean, self._sum, self._seen = self._sum / self._seen, 0.0, 0.0
        expected, slope = self._battery.voltage_at(self._charge)
        spread = slope * slope * self._var + NOISE * NOISE
        gain, gain_scale = slope * self._var / spread, slope * self._mixed / spread
        off = mean - expected
        self._charge = min(max(self._charge + gain * off, 0.0), 1.0)
        self._scale = min(max(self._scale + gain_scale * off, 0.3), 3.0)
        self._scale_var -= gain_scale * slope * self._mixed
        self._var, self._mixed = self._var * (1.0 - gain * slope), self._mixed * (1.0 - gain * slope)

    def _state(self, volts: float, watts: float) -> BatteryState:
        battery = self._battery
        reserve = battery.reserve_percent / 100.0
        usable = max(self._charge - reserve, 0.0)
        middle, _ = battery.voltage_at(reserve + usable / 2.0)
        joules = usable * self._coulombs * middle
        _, slope = battery.voltage_at(self._charge)
        std = sqrt(max(self._var, 0.0) + (CURVE / slope) ** 2)
        all_of_it = self._coulombs * middle / (self._scale * max(self._per_metre, self._least_per_metre))
        reach = usable * all_of_it
        return BatteryState(
            volts=self._under_load,
            charge=self._charge,
            charge_std=std,
            watts=watts,
            joules=self._joules,
            range_m=reach,
            range_std_m=sqrt((std * all_of_it) ** 2 + reach * reach * self._scale_var),
            time_left_s=joules / max(self._scale * self._watts, 1e-3),
        )


def taken(drives: Iterable[DriveFeedback], forces: Mapping[str, float]) -> float:
    """What the drives of the driven wheels take [W]; negative: they feed back.

    Args:
        drives: all of them.
        forces: of each driven wheel per ampere of its motor's current [N/A], by the names of their drives.
    """
    return total(force * drive.current * drive.velocity for drive in drives if (force := forces.get(drive.name)))
