"""How full the battery is, by a Kalman filter of what was taken of it and of its voltage; and how far that reaches.

Its state is the charge, three numbers by which the robot file is wrong, and the current of a charger. The three are
what is taken all the time (`idle_w`), what the driven wheels take (force times speed, by their motors' currents), both
as shares of a capacity that may be wrong too, and the resistance. A battery is a voltage that rises with the charge
behind a resistance (Plett 2004, "Extended Kalman filtering for battery management systems", part 2, the simple model,
doi 10.1016/j.jpowsour.2004.02.032; part 3 for parameters in the state).

What is learnt of each while the robot drives: the voltage falls as the charge is taken, which tells power by capacity;
where the wheels take more and less by turns, also of each alone; and it sags by what they take, which tells the
resistance. No voltage tells power and capacity apart: the range needs neither, watts and joules are those of the robot
file's capacity. While the robot stands, a charger may be connected: its current lifts the voltage at once, by the
resistance, and the charge with time. It is zero until the voltage is not explained without it; from then on charge and
current alone follow the voltage, and the other numbers keep their uncertainty (a consider filter: Schmidt 1966,
"Application of state-space methods to navigation problems"). When the robot drives, it is zero.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import product
from math import sqrt

from artemis.battery import HOUR, Battery, BatteryState
from artemis.motion.totals import smoothed, total
from artemis.values import DriveFeedback
from artemis.vehicle import RobotFile

OF_IDLE, OF_FORCE, OF_CAPACITY, OF_RESISTANCE = 0.15, 0.15, 0.15, 0.25
"""Standard deviations of these numbers of the robot file, as shares of them."""
DRIFT = 0.02
"""How much they change in an hour of driving, likewise."""
CURVE = 0.1
"""The curve of the robot file is that uncertain [V]: an error that no number of measurements averages away."""
NOISE, EVERY = 0.05, 5.0
"""One measured voltage, the mean of so long [s], says so much [V]: its steps, and the battery's own slow recovery."""
UNDER_LOAD = 2.0
"""The voltage that is told, and that shows a low battery, is a mean of so long [s]: a start takes more for less."""
FIRST_M, RECENT_M, RECENT_S = 20.0, 100.0, 120.0
"""What a metre takes is the mean of the robot file's, which counts as so much distance [m], and of what was driven, of
both at most the second [m]; the mean power is of so long a time [s]."""
STANDS, UNEXPLAINED = 0.01, 2.0
"""Slower than the first [m/s] the robot stands. Then a voltage that is off by more than so many standard deviations is
a charger's."""
LIFTED, CHANGES = 0.3, 0.3
"""Standard deviations: by how much a charger lifts the voltage when the run begins [V], as it may begin there; and how
much its current changes in an hour, as a share of the capacity per hour."""
LEAST_OHM = 0.01
"""Less resistance [ohm] than this has no battery with its wires, whatever the robot file says."""
PLACES = range(5)
CHARGE, IDLE, FORCE, OHM, CURRENT = PLACES
"""In the state."""

Row = list[float]


class ChargeEstimate:
    """Carries the charge on from tick to tick. Deterministic."""

    def __init__(self, battery: Battery, robot: RobotFile) -> None:
        """Begin; the battery is that of the robot."""
        self._battery, self._forces = battery, forces_of(robot, battery)
        self._least_per_metre = max(battery.idle_w / robot.limits.speed_m_s, 1e-3)
        """At the robot's highest speed, driven by nothing [J/m]: what drives feed back on a slope does not last."""
        self._coulombs = HOUR * battery.capacity_ah
        self._lifts = max(battery.resistance_ohm, LEAST_OHM) * self._coulombs
        """By how much a charger lifts the voltage at once [V] for a current of the whole capacity in a second."""
        self._begun = False
        self._state: Row = [0.0, 1.0, 1.0, 1.0, 0.0]
        """The charge, 0 to 1; three as multiples of the robot file's; a charger's current [1/s, of the capacity]."""
        both = (
            OF_CAPACITY**2
        )  # a smaller capacity is a larger share for the same power, and less drop for the same share
        self._var: list[Row] = [
            [0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, OF_IDLE**2 + both, both, -both, 0.0],
            [0.0, both, OF_FORCE**2 + both, -both, 0.0],
            [0.0, -both, -both, OF_RESISTANCE**2 + both, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0],
        ]
        usual = 0.5 * robot.limits.speed_m_s
        self._idle_per_metre = min(battery.idle_w / usual, 0.5 * battery.joules_per_metre)
        self._drive_per_metre = battery.joules_per_metre - self._idle_per_metre
        """Of the last metres, both as the robot file has them [J/m]."""
        self._recent = FIRST_M
        self._under_load = self._joules = self._drive_watts = 0.0
        self._seconds = self._stood = self._volts = self._idle_share = self._drive_share = 0.0
        """Since the last correction: time, also at standstill, voltage times time, shares of the capacity as the robot
        file has it."""

    def update(self, volts: float, drives: Iterable[DriveFeedback], driven: float, dt: float) -> BatteryState:
        """The state after `dt` [s] at a supply voltage [V], in which the rear axle's centre rolled `driven` [m].

        Either way counts as forwards.
        """
        battery, volts = self._battery, max(volts, 1.0)
        drive = taken(drives, self._forces)
        if not self._begun:
            self._begin(volts, drive)
        idle_share, drive_share = (watts * dt / (volts * self._coulombs) for watts in (battery.idle_w, drive))
        self._take(idle_share, drive_share, dt)
        self._joules += self._scaled(battery.idle_w, drive) * dt
        self._drive_watts = smoothed(self._drive_watts, drive, dt, RECENT_S)
        self._under_load = smoothed(self._under_load, volts, dt, UNDER_LOAD)
        if driven > 0.0:
            self._recent = min(self._recent + driven, RECENT_M)
            self._idle_per_metre += (battery.idle_w * dt - self._idle_per_metre * driven) / self._recent
            self._drive_per_metre += (drive * dt - self._drive_per_metre * driven) / self._recent
        self._seconds += dt
        self._stood += dt if driven <= STANDS * dt else 0.0
        self._volts += volts * dt
        self._idle_share += idle_share
        self._drive_share += drive_share
        if self._seconds >= EVERY:
            self._correct()
        return self._told(volts, drive)

    def _begin(self, volts: float, drive: float) -> None:
        battery = self._battery
        self._begun, self._under_load, self._drive_watts = True, volts, drive
        self._state[CHARGE] = battery.charge_at(volts + battery.resistance_ohm * (battery.idle_w + drive) / volts)
        _, slope = battery.voltage_at(self._state[CHARGE])
        current, charge = LIFTED / self._lifts, LIFTED / slope
        self._var[CURRENT][CURRENT] = current**2
        self._var[CHARGE][CHARGE] = (CURVE / slope) ** 2 + charge**2
        self._var[CHARGE][CURRENT] = self._var[CURRENT][CHARGE] = -current * charge

    def _scaled(self, idle: float, drive: float) -> float:
        """What is taken truly where the robot file says so much of each."""
        return self._state[IDLE] * idle + self._state[FORCE] * drive

    def _take(self, idle_share: float, drive_share: float, dt: float) -> None:
        charged = self._state[CURRENT] * dt - self._scaled(idle_share, drive_share)
        self._state[CHARGE] = min(max(self._state[CHARGE] + charged, 0.0), 1.0)

    def _correct(self) -> None:
        """Use the mean voltage of a few seconds: what is off of it changes the state as it is uncertain.

        Of a time in which the robot drives and stands it is not used: it may partly be that at a charger.
        """
        battery, state, var, seconds = self._battery, self._state, self._var, self._seconds
        idle_share, drive_share = self._idle_share, self._drive_share
        drives, stands = self._stood == 0.0, self._stood == seconds
        if not stands:
            state[CURRENT] = 0.0
            for place in PLACES:
                var[CURRENT][place] = var[place][CURRENT] = 0.0
        self._predict(idle_share, drive_share, seconds)
        taken = self._scaled(idle_share, drive_share) - state[CURRENT] * seconds
        rest, slope = battery.voltage_at(state[CHARGE] + 0.5 * taken)
        drop = battery.resistance_ohm * self._coulombs / seconds * taken
        ohms = state[OHM] * battery.resistance_ohm * self._coulombs / seconds  # volts for a share
        moves = [slope, -ohms * idle_share, -ohms * drive_share, -drop, state[OHM] * self._lifts]
        off = self._volts / seconds - (rest - state[OHM] * drop)
        towards = [total(a * b for a, b in zip(row, moves, strict=True)) for row in var]
        variance = total(a * b for a, b in zip(moves, towards, strict=True)) + NOISE**2
        if stands and off * off > UNEXPLAINED**2 * variance:  # as much as it is off is the charger's
            var[CURRENT][CURRENT] += (off / moves[CURRENT]) ** 2
            towards[CURRENT] += off * off / moves[CURRENT]
            variance += off * off
        charger = (CHARGE, CURRENT) if var[CURRENT][CURRENT] else ()
        learnt: Iterable[int] = (CHARGE, IDLE, FORCE, OHM) if drives else charger
        for place in learnt:
            state[place] += towards[place] / variance * off
        for place, column in product(PLACES, repeat=2):
            if place in learnt or column in learnt:
                var[place][column] -= towards[place] * towards[column] / variance
        state[CHARGE] = min(max(state[CHARGE], 0.0), 1.0)
        state[IDLE:CURRENT] = [min(max(multiple, 0.3), 3.0) for multiple in state[IDLE:CURRENT]]
        self._seconds = self._stood = self._volts = self._idle_share = self._drive_share = 0.0

    def _predict(self, idle_share: float, drive_share: float, seconds: float) -> None:
        """The charge becomes as uncertain as what was taken and charged; what the robot file says drifts."""
        var, moved = self._var, ((IDLE, -idle_share), (FORCE, -drive_share), (CURRENT, seconds))
        for place in PLACES:
            var[CHARGE][place] += total(share * var[of][place] for of, share in moved)
        for place in PLACES:
            var[place][CHARGE] += total(share * var[place][of] for of, share in moved)
        for place in (IDLE, FORCE, OHM):
            var[place][place] += DRIFT * DRIFT * seconds / HOUR
        if var[CURRENT][CURRENT]:
            var[CURRENT][CURRENT] += (CHANGES / HOUR) ** 2 * seconds / HOUR

    def _told(self, volts: float, drive: float) -> BatteryState:
        battery, charge, var = self._battery, self._state[CHARGE], self._var
        reserve = battery.reserve_percent / 100.0
        usable = max(charge - reserve, 0.0)
        middle, _ = battery.voltage_at(reserve + usable / 2.0)
        middle -= self._state[OHM] * battery.resistance_ohm * self._scaled(battery.idle_w, self._drive_watts) / volts
        joules = usable * self._coulombs * middle
        idle, force = self._idle_per_metre, self._drive_per_metre
        per_metre = max(self._scaled(idle, force), self._state[IDLE] * self._least_per_metre)
        all_of_it = self._coulombs * middle / per_metre
        _, slope = battery.voltage_at(charge)
        of_charge = max(var[CHARGE][CHARGE], 0.0) + (CURVE / slope) ** 2
        of_both = (idle * var[CHARGE][IDLE] + force * var[CHARGE][FORCE]) / per_metre
        of_distance = (
            idle * idle * var[IDLE][IDLE] + 2.0 * idle * force * var[IDLE][FORCE] + force * force * var[FORCE][FORCE]
        ) / (per_metre * per_metre)
        return BatteryState(
            volts=self._under_load,
            charge=charge,
            charge_std=sqrt(of_charge),
            watts=self._scaled(battery.idle_w, drive),
            joules=self._joules,
            range_m=usable * all_of_it,
            range_std_m=all_of_it * sqrt(max(of_charge - 2.0 * usable * of_both + usable * usable * of_distance, 0.0)),
            time_left_s=joules / max(self._scaled(battery.idle_w, self._drive_watts), 1e-3),
        )


def forces_of(robot: RobotFile, battery: Battery) -> dict[str, float]:
    """Of each driven wheel per ampere of its motor's current [N/A], by the names of their drives."""
    force = battery.newtons_per_ampere
    return {
        name: -force if drive.mirrored else force for name, drive in robot.drives.items() if drive.role == "traction"
    }


def taken(drives: Iterable[DriveFeedback], forces: Mapping[str, float]) -> float:
    """What the drives of the driven wheels take [W]; negative: they feed back.

    Args:
        drives: all of them.
        forces: of each driven wheel per ampere of its motor's current [N/A], by the names of their drives.
    """
    return total(force * drive.current * drive.velocity for drive in drives if (force := forces.get(drive.name)))
