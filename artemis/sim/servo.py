"""An axis whose regulators compute with the gains that they have, on a load that nobody knows: inertia, friction, play.

`axis` simulates loops as well tuned as the robot file has them; `regulators` makes bad gains bad. Neither knows a load
that differs from the nominal one. This one does: PI of the velocity and PID of the position, as often and with gains in
the units that the drive's family has (EPOS firmware specification 2010, figures of the regulators), the current as
demanded at once, the load as two masses with play between them. Feed-forward, filters and observer of an EPOS4 are not
simulated. It is used where `true_robot.loads` describes a load; others are simulated as before.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Annotated

from pydantic import Field

from artemis.config import Config, Quantity
from artemis.drive_schema import Drive
from artemis.sim.axis import LOADS, Axis, Load, Regulation, rolled
from artemis.sim.regulators import Regulators

ROTOR_FRICTION = 0.3
"""Share of the friction before the play; an assumption."""
_RPM = math.tau / 60.0
"""rad/s."""


class TrueLoad(Config):
    """What the drives of one role truly move; their regulators then compute with the gains that they have."""

    inertia_scale: Annotated[float, Quantity(0.05, 50.0, "")] = 1.0
    """As a multiple of the nominal load's, rotor included."""
    friction_scale: Annotated[float, Quantity(0.0, 20.0, "")] = 1.0
    play_deg: Annotated[float, Quantity(0.0, 10.0, "degrees")] = 0.0
    """Between motor and load, from end to end, at the wheel: the motor turns its rotor alone in it. What the wheel does
    in the play of a steering gear is `backlash_deg`."""
    rotor_share: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """Of the inertia: what is left of it in the play."""
    delay_ms: Annotated[float, Quantity(0.0, 50.0, "ms")] = 0.0
    """What the regulators measure is so old."""


class ServoAxis(Axis):
    """A motor shaft under regulators that compute with their gains."""

    def __init__(self, drive: Drive, true: TrueLoad) -> None:
        """At rest, in the middle of its play, with the gains of the robot file."""
        scale = drive.tables.gain_scale
        assert scale is not None  # the mission was checked
        self._scale = scale
        nominal = LOADS[drive.role]
        load = Load(
            inertia=nominal.inertia * true.inertia_scale,
            friction=nominal.friction * true.friction_scale,
            viscous=nominal.viscous,
        )
        super().__init__(drive, load)
        self._play = true.play_deg / 360.0 * drive.sensor.counts_per_turn * drive.gear_ratio
        self._place_in_play = 0.5 * self._play
        self._load_velocity = 0.0
        share = true.rotor_share
        self._rotor = Load(inertia=share * load.inertia, friction=ROTOR_FRICTION * load.friction, viscous=load.viscous)
        self._rest = Load(
            inertia=(1.0 - share) * load.inertia, friction=(1.0 - ROTOR_FRICTION) * load.friction, viscous=0.0
        )
        self._measured: deque[tuple[float, float]] = deque(maxlen=1 + round(1e-3 * true.delay_ms / scale.period))
        self._integral = 0.0
        self._last_error: float | None = None
        self.tune(drive.gain_numbers or (0,) * 7, None)

    def tune(self, gains: Sequence[int], regulators: Regulators | None) -> None:
        """Take over gains; what `regulators` assume of them is not needed."""
        scale = 1e3 * math.tau / self.counts_per_turn
        self._velocity_gains = tuple(
            1e3 * _RPM * unit * gain for unit, gain in zip(self._scale.velocity, gains[2:4], strict=True)
        )
        """[mA/rpm], [mA/(rpm s)]."""
        self._position_gains = tuple(
            scale * unit * gain for unit, gain in zip(self._scale.position, gains[4:], strict=True)
        )
        """[mA/count], [mA/(count s)], [mA s/count]."""

    def regulate(self, regulation: Regulation, target: float) -> None:
        """As every axis; a regulator that begins has no past."""
        if regulation is not self.regulation:
            self._integral, self._last_error = 0.0, None
        super().regulate(regulation, target)

    def step(self, dt: float) -> None:
        """Move on by `dt` seconds, as many regulator periods as that is."""
        periods = max(1, round(dt / self._scale.period))
        for _ in range(periods):
            super().step(dt / periods)

    def _regulated(self, before: float, wanted: float, blend: float, dt: float) -> tuple[float, float]:
        """Current and velocity after one period of the regulators; `wanted` counts where a velocity is regulated."""
        failure = self.failure
        self._measured.append((self.position, before))
        position, velocity = self._measured[0]
        if self.regulation is Regulation.VELOCITY:
            p, i = self._velocity_gains
            error = wanted * (1.0 if failure is None else failure.gain) - velocity
            demand = p * error
        else:
            p, i, d = self._position_gains
            error = self.demand_position - position
            demand = p * error + (d * (error - self._last_error) / dt if self._last_error is not None else 0.0)
        self._last_error = error
        demand += self._integral + i * error * dt
        current = self._within_limit(demand)
        if current == demand or error * demand < 0.0:  # a regulator at its limit does not integrate further
            self._integral += i * error * dt
        if failure is not None and failure.blocked:
            return current, 0.0
        after = self._moved(before, current, dt)
        top = self.top_rpm
        after = max(-top, min(top, after))
        return current, after if failure is None else failure.braked(before, after, dt)

    def _moved(self, before: float, current: float, dt: float) -> float:
        """Velocity of the motor after `dt`: alone in the play, with the load as one body at its ends."""
        if not self._play:
            return self._rolled(before, current, dt)
        alone = rolled(self._rotor, before, current, dt)
        rest = rolled(self._rest, self._load_velocity, -self.load_current, dt)
        place = self._place_in_play + (alone - rest) * self.counts_per_rpm_s * dt
        self._place_in_play = max(0.0, min(self._play, place))
        if place == self._place_in_play:
            self._load_velocity = rest
            return alone
        share = self._rotor.inertia / self.load.inertia
        together = self._rolled(share * before + (1.0 - share) * self._load_velocity, current, dt)
        self._load_velocity = together
        return together
