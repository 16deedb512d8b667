"""What a simulated EPOS4 has around its motor: digital and analog inputs, outputs, STO, supply and temperature.

Sources: the EPOS4's EDS; hardware references of the 50/5 and 50/8. Inferred: an open STO input reads 0 in object
0x3202; the heating of the power stage, of which nothing is published.
"""

from __future__ import annotations

from collections.abc import Callable, Set
from functools import partial

from artemis.sim.axis import Axis
from artemis.sim.dictionary import Dictionary, key_of
from artemis.sim.epos4_objects import millivolts

INPUTS, OUTPUTS = 8, 3
HOME_PIN = 2
"""Of the digital input, counted from 0, that has the function home switch from the factory (object 0x3142:3)."""
DRIVE_ENABLE = 27
"""Function of a digital input, object 0x3142."""
UNUSED = 255
READY_OUTPUT, BRAKE_OUTPUT = 25, 24
"""Functions of a digital output, object 0x3151."""
GENERAL_OUTPUTS = range(16, 19)
STO_CLOSED = 0x03
"""Object 0x3202: both inputs have their voltage."""
WARMING = 45.0
"""How much warmer than its surroundings the power stage becomes at its nominal current [K]; an assumption."""
WARMING_TIME = 60.0
"""Time constant of that [s]; an assumption."""
INTEGRAL_MOST = 200
"""Highest value of 0x3200 [%]."""
_POLARITY = key_of(0x3141, 2)
_USES = tuple(key_of(0x3142, pin + 1) for pin in range(INPUTS))
_TOO_HOT = key_of(0x3201, 4)
_ANALOG = tuple((key_of(0x3163, 2 * number + 1), key_of(0x3163, 2 * number + 2)) for number in (0, 1))


class Periphery:
    """Inputs and outputs of one EPOS4. The world sets `levels`, `sto_open` and `ambient`; the node looks after them."""

    def __init__(
        self, dictionary: Dictionary, axis: Axis, *, nominal_current: float, brake_closed: Callable[[], bool]
    ) -> None:
        """`nominal_current`: of the power stage [mA]."""
        self._levels = 0
        self._active: set[int] = set()
        self.active: Set[int] = self._active
        """Functions of the digital inputs that are active (object 0x3142): always the same set."""
        self.sto_open = False
        """The safe torque off inputs have no voltage."""
        self.ambient = 25.0
        """Temperature of the surroundings [°C]."""
        self.warmth = 0.0
        """How much warmer than these the power stage is [K]."""
        self._number, self._values = dictionary.number, dictionary.values
        self._axis = axis
        self._nominal = nominal_current
        self._brake_closed = brake_closed
        getters = dictionary.getters
        getters[key_of(0x2200, 1)] = lambda: max(0, min(0xFFFF, round(axis.supply_voltage * 10.0)))
        getters[key_of(0x2200, 2)] = lambda: 1
        getters[key_of(0x3141, 1)] = self.logic_levels
        getters[key_of(0x60FD, 0)] = self.functions
        getters[key_of(0x3150, 1)] = self.outputs
        for number in (0, 1):
            getters[key_of(0x3160, number + 1)] = partial(self.analog, number)
            getters[key_of(0x3162, number + 1)] = partial(self._general_purpose, number)
        getters[key_of(0x3200, 1)] = lambda: self._load(axis.continuous_current)
        getters[key_of(0x3200, 2)] = lambda: self._load(self._nominal)
        getters[key_of(0x3201, 1)] = lambda: round(10.0 * self.temperature)
        getters[key_of(0x3202, 1)] = lambda: 0 if self.sto_open else STO_CLOSED
        getters[key_of(0x3203, 1)] = self._duty
        for key in (_POLARITY, *_USES):
            dictionary.written[key] = lambda _: self.refresh()
        axis.on_home = self.refresh
        self.refresh()

    @property
    def levels(self) -> int:
        """Digital inputs: bit 0 is the first one's; 1: high."""
        return self._levels

    @levels.setter
    def levels(self, levels: int) -> None:
        self._levels = levels
        self.refresh()

    def refresh(self) -> None:
        """Look up anew what the inputs do: after each change of a level, and of the objects that say it."""
        levels = self.logic_levels()
        self._active.clear()
        self._active.update(self._values[use] for pin, use in enumerate(_USES) if levels >> pin & 1)

    @property
    def temperature(self) -> float:
        """Of the power stage [°C]."""
        return self.ambient + self.warmth

    @property
    def too_hot(self) -> bool:
        """The power stage is hotter than object 0x3201:4 allows."""
        return 10.0 * (self.ambient + self.warmth) > self._values[_TOO_HOT]

    @property
    def allow(self) -> bool:
        """The inputs allow torque: STO has its voltage, and so has a drive-enable input, where there is one."""
        return not self.sto_open and (DRIVE_ENABLE in self._active or not self._uses(DRIVE_ENABLE))

    def warm(self, dt: float) -> bool:
        """A step of `dt` [s] at the present motor current; whether the power stage is `too_hot` then."""
        share = self._axis.current / self._nominal
        self.warmth += (WARMING * share * share - self.warmth) * dt / WARMING_TIME
        return 10.0 * (self.ambient + self.warmth) > self._values[_TOO_HOT]

    def logic_levels(self) -> int:
        """Object 0x3141:1: the pins, those with a bit in 0x3141:2 inverted."""
        levels = self._levels | self._axis.home << HOME_PIN
        return (levels ^ self._values[_POLARITY]) & ((1 << INPUTS) - 1)

    def functions(self) -> int:
        """Object 0x60FD: a bit for each function of an active input."""
        found = 0
        for function in self._active:
            if function != UNUSED:
                found |= 1 << function
        return found

    def outputs(self) -> int:
        """Object 0x3150:1: the pins, those with a bit in 0x3150:2 inverted."""
        asked, pins = self._number(0x60FE, 1), 0
        for pin in range(OUTPUTS):
            function = self._number(0x3151, pin + 1)
            if function in GENERAL_OUTPUTS:
                on = bool(asked >> function & 1)
            elif function == BRAKE_OUTPUT:
                on = not self._brake_closed()
            else:
                on = function == READY_OUTPUT and self.allow
            pins |= on << pin
        return pins ^ self._number(0x3150, 2) & ((1 << OUTPUTS) - 1)

    def analog(self, number: int) -> int:
        """Object 0x3160: analog input 0 or 1, with its offset and gain [mV]."""
        offset_key, gain_key = _ANALOG[number]
        offset, gain = self._values[offset_key], self._values[gain_key]
        if not offset and gain == 10000:
            return millivolts(self._axis.analog[number])
        return max(-0x8000, min(0x7FFF, round((millivolts(self._axis.analog[number]) + offset) * gain / 10000)))

    def _general_purpose(self, function: int) -> int:
        for number in (0, 1):
            if self._number(0x3161, number + 1) == function:
                return self.analog(number)
        return 0

    def _uses(self, function: int) -> bool:
        return any(self._values[use] == function for use in _USES)

    def _load(self, continuous_current: float) -> int:
        """How far the I²t model is, of the current that may last [mA]: percent."""
        square = continuous_current * continuous_current
        return min(INTEGRAL_MOST, round(100.0 * self._axis.heat / square)) if square else INTEGRAL_MOST

    def _duty(self) -> int:
        """Object 0x3203: the motor's voltage as a share of the highest one, in thousandths."""
        axis = self._axis
        return min(1000, round(1000.0 * abs(axis.velocity) / axis.top_rpm)) if axis.top_rpm > 0.0 else 0
