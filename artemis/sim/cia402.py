"""A simulated drive of the profile CiA 402: the node of `epos` with what the profile has instead.

`cia402_objects` has its objects, `cia402_power` its device states and option codes, `cia402_motion` its modes. What the
profile leaves open is as the robot file says: identity, units, option codes, what it measures, what it is configured
with. Its motor and gains are taken as its maker's tool is to have set them. `epos4` makes an EPOS4 of it.

Sources: CiA 301, CiA 402. Inferred: which errors leave no power to brake with.
Not simulated: profile position, homing, torque; what the polarity (0x607E) does, which is there without effect on the
motor; inputs but for the home switch; any other object of its maker.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial

from artemis.drive_schema import Drive
from artemis.drive_states import Nmt
from artemis.families.family import HOME_INPUT
from artemis.sim.cia402_motion import Cia402Motion
from artemis.sim.cia402_objects import RULES, VOLATILE, objects402
from artemis.sim.cia402_power import Cia402Power
from artemis.sim.dictionary import SIGNED, SIZES, AbortCode, AccessRefused, Dictionary, Refusal, key_of
from artemis.sim.epos import SimEpos
from artemis.sim.epos_errors import (
    CAN_PASSIVE,
    FOLLOWING_ERROR,
    LIFE_GUARD,
    OVER_VOLTAGE,
    PDO_LENGTH,
    UNDER_VOLTAGE,
    EposError,
    ErrorMemory,
    Reaction,
)
from artemis.sim.epos_motion import Motion
from artemis.sim.epos_objects import INVALID
from artemis.sim.epos_parameters import ParameterMemory
from artemis.sim.epos_pdo import judge_identifier, pdos_of
from artemis.sim.epos_power import PowerStage

COMMUNICATION = range(0x1000, 0x2000)
"""What a communication reset loads again."""
BUS_OFF = 0x81FD
"""Error code of maxon's drives."""
AMBIENT = 25.0
"""Of its power stage [°C]: how it warms up is not simulated, nor are open inputs for safe torque off."""
LEAVES_FOR = {0: Nmt.PRE_OPERATIONAL, 2: Nmt.STOPPED}
"""NMT state after a communication error, by the value of 0x1029:1; 1 changes none (CiA 301)."""
_OFF, _FAULT = Reaction.POWER_OFF, Reaction.FAULT_OPTION
ERRORS_402 = {
    0x1000: EposError(0x01, _OFF),
    0x2310: EposError(0x02, _OFF),
    OVER_VOLTAGE: EposError(0x04, _OFF),
    UNDER_VOLTAGE: EposError(0x04, _OFF),
    0x4210: EposError(0x08, _OFF),
    0x4310: EposError(0x08, _OFF),
    0x5113: EposError(0x04, _OFF),
    0x6100: EposError(0x01, _OFF),
    0x6320: EposError(0x01, _FAULT),
    0x7320: EposError(0x20, _OFF),
    0x8110: EposError(0x10, _FAULT),
    CAN_PASSIVE: EposError(0x10, _FAULT),
    LIFE_GUARD: EposError(0x10, Reaction.ABORT_OPTION),
    0x8150: EposError(0x10, _FAULT),
    PDO_LENGTH: EposError(0x10, _FAULT),
    FOLLOWING_ERROR: EposError(0x20, _FAULT),
}
"""By code: the error register (CiA 301, object 0x1001; 0x20: as the profile defines), and the reaction."""


class SimCia402(SimEpos):
    """One simulated drive of the profile."""

    # ------------------------------------------------------------------------------------------ of its generation

    def _make_dictionary(self, drive: Drive) -> Dictionary:
        assert drive.cia402 is not None  # the robot file was checked
        self._words = drive.cia402
        dictionary = Dictionary(objects402(drive, drive.cia402), power_off=lambda: self._power.power_off, rules=RULES)
        for entry in dictionary.entries.values():
            if entry.index in drive.cia402.absent:  # what it does all the same, as its maker has set it
                dictionary.refusals[entry.key] = Refusal(code=AbortCode.NO_OBJECT, left=None)
        return dictionary

    def _make_parts(self, drive: Drive) -> tuple[ErrorMemory, Motion, PowerStage]:
        dictionary, words = self._dictionary, self._words
        waits = (LIFE_GUARD,) if words.reset_after_lost_heartbeat else ()
        errors = ErrorMemory(dictionary, ERRORS_402, until_bus_reset=waits, until_node_reset=())
        motion = Cia402Motion(dictionary, self.axis, drive, words)
        power = Cia402Power(
            motion,
            errors,
            dictionary,
            measure=self.settings.measure_s,
            cause_remains=lambda: self._voltage_error() != 0,
            brake=words.brake,
        )
        self._measure()
        return errors, motion, power

    def _measure(self) -> None:
        """Tie the objects with which the robot file says that it measures."""
        axis, words = self.axis, self._words
        self._dictionary.getters[key_of(0x60FD, 0)] = lambda: HOME_INPUT if axis.home else 0
        for place, each in enumerate(words.analog_inputs or ()):
            self._show(each.index, each.subindex, partial(self._volts, place, each.units_per_v))
        if words.current is not None:
            scale = 1e-3 * words.current.units_per_a
            self._show(words.current.index, words.current.subindex, lambda: axis.current_averaged * scale)
        if words.absolute_encoder is not None:
            encoder = words.absolute_encoder
            self._show(encoder.index, encoder.subindex, lambda: float(axis.encoder[0] if axis.encoder else 0))
        if words.supply is not None:
            volt = words.supply.units_per_v
            self._show(words.supply.index, words.supply.subindex, lambda: axis.supply_voltage * volt)
        if words.temperature is not None:
            shown = AMBIENT * words.temperature.units_per_degree
            self._show(words.temperature.index, words.temperature.subindex, lambda: shown)
        if words.sto is not None:
            closed = float(words.sto.closed)
            self._show(words.sto.index, words.sto.subindex, lambda: closed)

    def _volts(self, place: int, units_per_v: float) -> float:
        return self.axis.analog[place] * units_per_v

    def _show(self, index: int, subindex: int, measured: Callable[[], float]) -> None:
        """An object holds what is measured, as far as its type can."""
        entry = self._dictionary.find(index, subindex)
        bits = 8 * SIZES[entry.type]
        low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if entry.type in SIGNED else (0, (1 << bits) - 1)
        self._dictionary.getters[entry.key] = lambda: max(low, min(high, round(measured())))

    def _make_memory(self) -> ParameterMemory:
        return self._memory_of(VOLATILE)

    def _memory_of(self, volatile: Collection[int], restores: Collection[int] = (1,)) -> ParameterMemory:
        return ParameterMemory(
            self._dictionary,
            volatile=volatile,
            communication=COMMUNICATION,
            restores=restores,
            restore_at_once=False,
        )

    def _describe(self) -> None:
        """Tie the objects that belong to the node as a whole."""
        checks = self._dictionary.checks
        for parameters in (0x1400, 0x1800):
            for number in range(pdos_of(self._dictionary)):
                key = key_of(parameters + number, 1)
                checks[key] = partial(self._judge_identifier, key)
        self._describe_device()

    # ------------------------------------------------------------------------------------------ what is different

    def _judge_identifier(self, key: int, cob_id: int) -> None:
        """The identifier changes only from one that is not valid to another that is not, either."""
        judge_identifier(cob_id)
        present = self._dictionary.values[key]
        both_invalid = bool(present & cob_id & INVALID)
        if (present ^ cob_id) & 0x7FF and not both_invalid:
            raise AccessRefused(AbortCode.UNSUPPORTED_ACCESS)

    def _raise_error(self, code: int) -> None:
        super()._raise_error(code)
        if code in (LIFE_GUARD, BUS_OFF) and self.nmt is Nmt.OPERATIONAL:
            following = LEAVES_FOR.get(self._dictionary.number(0x1029, 1))
            if following is not None:
                self.change_nmt(following, self._now)
