"""What gains do to a simulated drive's loops, told by how they stand to the gains of its robot file.

How a gain acts on a real machine depends on its motor, load and sensor; of this one only the nominal loops are
known. So all of the following are assumptions, made to show a bad gain as one, with no claim to its size:

- With the nominal gains each loop is what `axis` says: well tuned, without overshoot.
- A loop is as many times stiffer as its P is higher: the lag of the speed loop is divided by it, the gain of the
  position loop multiplied.
- What lacks damping swings: a speed loop by more I than P, or by more than `STIFFEST` times its P; a position loop by
  more P or I than D. Where that is r > 1 times as much as nominal, the loop answers its demand like a system of second
  order with the damping 1/r, the slower the more it swings.
- Without P there is no torque; nor without P and I of the current.
- Too little I or too much D shows nothing; nor do gains of the current other than none: a millisecond is not simulated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

STIFFEST = 4.0
"""A speed loop with so many times its nominal P begins to swing."""
SLOW, FAST, POSITION = 10.0, 60.0, 30.0
"""Natural frequencies of loops that swing without end [rad/s]: speed with too much I, with too much P, position."""
_MOST = 1e6


class Loop:
    """One loop with other than its nominal gains."""

    def __init__(self, stiffness: float, ratio: float, omega: float) -> None:
        """`ratio`: 1 or less does not swing. `omega`: natural frequency of one that swings without end [rad/s]."""
        self.stiffness = stiffness
        """P as a multiple of the nominal one; above 0."""
        self._damping = 1.0 / ratio
        self._omega = omega * ratio / (ratio - 1.0) if ratio > 1.0 else math.inf
        self._value: float | None = None
        self._rate = 0.0

    def forget(self) -> None:
        """The loop begins anew."""
        self._value, self._rate = None, 0.0

    def shaped(self, demand: float, present: float, dt: float) -> float:
        """What the loop answers to a demand after `dt` [s] (backward Euler); it begins at the `present` value."""
        if math.isinf(self._omega):
            return demand
        if self._value is None:
            self._value = present
        step = self._omega * dt
        pull = self._rate + step * self._omega * (demand - self._value)
        self._rate = pull / (1.0 + 2.0 * self._damping * step + step * step)
        self._value += self._rate * dt
        return self._value


class Regulators:
    """The loops of one drive whose gains are not the nominal ones."""

    def __init__(self, velocity: Loop | None, position: Loop | None) -> None:
        """None: the loop has no torque."""
        self.velocity, self.position = velocity, position

    def forget(self) -> None:
        """The power stage begins something else."""
        for loop in (self.velocity, self.position):
            if loop is not None:
                loop.forget()


def regulators_for(gains: Sequence[int], nominal: Sequence[int]) -> Regulators | None:
    """What the loops become with these gains; None: what they are with the nominal ones.

    Both in the order of the objects: current P, I; velocity P, I; position P, I, D.
    """
    if tuple(gains) == tuple(nominal):
        return None
    _, _, p, i, position_p, position_i, position_d = map(_multiple, gains, nominal)
    velocity = position = None
    torque = any(gains[:2])
    if torque and p > 0.0:
        swings, quivers = i / p, p / STIFFEST
        velocity = Loop(p, max(swings, quivers), SLOW if swings >= quivers else FAST)
    if torque and position_p > 0.0:
        most = max(position_p, position_i)
        position = Loop(position_p, most / position_d if position_d > 0.0 else _MOST, POSITION)
    return Regulators(velocity, position)


def _multiple(gain: int, nominal: int) -> float:
    if nominal:
        return gain / nominal
    return _MOST if gain else 1.0
