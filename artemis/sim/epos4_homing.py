"""Homing of a simulated EPOS4: to a switch, an index pulse, a hard stop, or where it stands.

Source: the methods that object 0x60E3 lists, as CiA 402 and the maker's negative numbers define them. Inferred: a
switch is left again at the speed of 0x6099:2, and its edge is the place; from a hard stop the index is sought
backwards.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from math import floor
from typing import NamedTuple

from artemis.sim.axis import Axis, Regulation
from artemis.sim.dictionary import Dictionary


class Mark(Enum):
    """What homing looks for first."""

    NOTHING = "the present place"
    NEGATIVE_LIMIT = 0
    POSITIVE_LIMIT = 1
    HOME = 2
    STOP = "a current above 0x30B2"


class Method(NamedTuple):
    """One homing method."""

    mark: Mark
    direction: int
    """In which the mark is sought, or the index, where there is no mark: 1 or -1; 0: nothing is."""
    to_index: bool
    """Then on to the next index pulse of the encoder."""


METHODS = {
    37: Method(Mark.NOTHING, 0, False),
    34: Method(Mark.NOTHING, 1, True),
    33: Method(Mark.NOTHING, -1, True),
    27: Method(Mark.HOME, -1, False),
    23: Method(Mark.HOME, 1, False),
    18: Method(Mark.POSITIVE_LIMIT, 1, False),
    17: Method(Mark.NEGATIVE_LIMIT, -1, False),
    11: Method(Mark.HOME, -1, True),
    7: Method(Mark.HOME, 1, True),
    2: Method(Mark.POSITIVE_LIMIT, 1, True),
    1: Method(Mark.NEGATIVE_LIMIT, -1, True),
    -1: Method(Mark.STOP, 1, True),
    -2: Method(Mark.STOP, -1, True),
    -3: Method(Mark.STOP, 1, False),
    -4: Method(Mark.STOP, -1, False),
}
"""By the number in object 0x6098."""


class Phase(Enum):
    """What a homing run is doing."""

    SEEK = "towards the mark"
    LEAVE = "off the switch"
    INDEX = "towards the index"
    MOVE = "by 0x30B1"


class Homing:
    """One homing run after the other."""

    def __init__(self, dictionary: Dictionary, axis: Axis, switched: Callable[[int], bool]) -> None:
        """`switched`: whether a digital input with this function (object 0x3142) is active."""
        self._number = dictionary.number
        self._axis = axis
        self._switched = switched
        self._phase: Phase | None = None
        self._method = METHODS[37]
        self._rpm = 1.0
        self._turn = 0

    @property
    def runs(self) -> bool:
        """A run is under way."""
        return self._phase is not None

    def stop(self) -> None:
        """Break it off."""
        self._phase = None

    def begin(self, method: int, rpm: float) -> None:
        """Begin with this method; `rpm`: unit of the drive's velocities."""
        self._method, self._rpm = METHODS[method], rpm
        axis = self._axis
        axis.acceleration = axis.deceleration = float(self._number(0x609A))
        if self._method.mark is Mark.NOTHING:
            if self._method.to_index:
                self._seek_index(self._method.direction)
            else:
                self._move()
        elif self._at_mark():
            self._leave()
        else:
            self._phase = Phase.SEEK
            self._turn_at(self._method.direction, self._number(0x6099, 1))

    def advance(self, position: float) -> bool:
        """After a step of the axis, which is at `position` [counts]: whether this is home now."""
        if self._phase is None:
            return False
        if self._phase is Phase.SEEK and self._at_mark():
            self._leave()
        elif self._phase is Phase.LEAVE and not self._at_mark():
            self._found()
        elif self._phase is Phase.INDEX and floor(position / self._axis.counts_per_turn) != self._turn:
            self._move()
        elif self._phase is Phase.MOVE and self._axis.arrived and abs(self._axis.lag) < 1.0:
            self._phase = None
            return True
        return False

    def _at_mark(self) -> bool:
        mark = self._method.mark
        if mark is not Mark.STOP:
            return self._switched(int(mark.value))
        axis = self._axis
        return axis.demand_velocity == axis.target and abs(axis.current) >= self._number(0x30B2)

    def _leave(self) -> None:
        """The mark is met: off the switch again; a hard stop is the place."""
        if self._method.mark is Mark.STOP:
            self._found()
            return
        self._phase = Phase.LEAVE
        self._turn_at(-self._method.direction, self._number(0x6099, 2))

    def _found(self) -> None:
        if self._method.to_index:
            self._seek_index(-self._method.direction)
        else:
            self._move()

    def _seek_index(self, direction: int) -> None:
        self._phase = Phase.INDEX
        self._turn = floor(self._axis.position / self._axis.counts_per_turn)
        self._turn_at(direction, self._number(0x6099, 2))

    def _move(self) -> None:
        """The place is found: by the distance of 0x30B1 away from it."""
        axis = self._axis
        self._phase = Phase.MOVE
        axis.profile_velocity = self._number(0x6099, 1) * self._rpm
        place = floor(axis.position + 0.5) + self._number(0x30B1)
        axis.halted = False
        axis.regulate(Regulation.PROFILE, float(place))

    def _turn_at(self, direction: int, speed: int) -> None:
        self._axis.regulate(Regulation.VELOCITY, direction * speed * self._rpm)
