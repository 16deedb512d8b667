"""A simulated EPOS4: the node of `cia402` with the parts in which this family differs.

`epos4_objects` has its objects, `epos4_errors` its errors, `epos4_power` its device states and option codes,
`epos4_motion` its cyclic modes, `epos4_homing` its homing methods, `epos4_periphery` inputs, outputs, supply and
temperature. What it shares with all is that of `epos`: SDO server, PDOs, NMT, heartbeats, memory.

Not simulated: LSS, block transfers, USB and RS232, auto-tuning, a second encoder in the regulators, analog set-points,
touch probes.
"""

from __future__ import annotations

from collections.abc import Callable

from artemis.drive_schema import Drive
from artemis.drive_states import POWERED, DriveState, Nmt
from artemis.sim.axis import Axis
from artemis.sim.cia402 import SimCia402
from artemis.sim.dictionary import AbortCode, AccessRefused, Dictionary, key_of
from artemis.sim.epos4_errors import HOT, SSI_FRAME, STO_OPEN, UNREFERENCED, Epos4Errors
from artemis.sim.epos4_motion import Epos4Motion
from artemis.sim.epos4_objects import ABORTS, HARDWARE, VOLATILE, objects4
from artemis.sim.epos4_periphery import Periphery
from artemis.sim.epos4_power import Epos4Power
from artemis.sim.epos_errors import ErrorMemory
from artemis.sim.epos_motion import Motion
from artemis.sim.epos_parameters import ParameterMemory
from artemis.sim.epos_power import PowerStage
from artemis.sim.epos_settings import SimSettings

WARNING = 0x0080
"""Statusword bit 7."""
QUICK_STOP_INPUT = 28
"""Function of a digital input, object 0x3142."""
RESTORES = (1, 4)
"""Sub-indices of object 0x1011 that restore everything: the documented one, and the maker's own."""


class SimEpos4(SimCia402):
    """One simulated EPOS4."""

    def __init__(self, drive: Drive, axis: Axis, *, name: str, settings: SimSettings | None = None) -> None:
        super().__init__(drive, axis, name=name, settings=settings)
        self.boot_time = self.settings.epos4.boot_time_s
        self._read_supply_limits()

    # ------------------------------------------------------------------------------------------ of its generation

    def _make_dictionary(self, drive: Drive) -> Dictionary:
        serial = self.node_id if drive.serial_number is None else drive.serial_number
        firmware = self.settings.epos4.firmware
        entries = objects4(self.node_id, drive.hardware_version, firmware, serial)
        dictionary = Dictionary(entries, power_off=lambda: self._power.power_off, rules=ABORTS)
        hardware = HARDWARE.get(drive.hardware_version, HARDWARE[0x6150])
        self.periphery = Periphery(
            dictionary,
            self.axis,
            nominal_current=float(hardware.nominal_current),
            brake_closed=lambda: self._device.brake_closed,
        )
        return dictionary

    def _make_parts(self, drive: Drive) -> tuple[ErrorMemory, Motion, PowerStage]:
        dictionary = self._dictionary
        self._memory = Epos4Errors(dictionary, overload_warns=self.settings.epos4.overload_warns)
        self._drive_function = Epos4Motion(
            dictionary,
            self.axis,
            tolerance=self.settings.epos4.late_set_points,
            active=self.periphery.active,
            nominal_gains=drive.gain_numbers or None,
        )
        self._device = Epos4Power(
            self._drive_function,
            self._memory,
            dictionary,
            measure=self.settings.measure_s,
            cause_remains=self._cause_remains,
            may_power=lambda: self.periphery.allow,
        )
        return self._memory, self._drive_function, self._device

    def _make_memory(self) -> ParameterMemory:
        memory = self._memory_of(VOLATILE, RESTORES)
        for sub in RESTORES:
            key = key_of(0x1011, sub)
            self._dictionary.checks[key] = self._only_pre_operational(self._dictionary.checks[key])
        return memory

    def _only_pre_operational(self, judge: Callable[[int], None]) -> Callable[[int], None]:
        def judge_both(value: int) -> None:
            if self.nmt is not Nmt.PRE_OPERATIONAL:
                raise AccessRefused(AbortCode.NMT_STATE)
            judge(value)

        return judge_both

    def _describe(self) -> None:
        """Tie the objects that belong to the node as a whole."""
        super()._describe()
        for sub in (1, 2):
            self._dictionary.written[key_of(0x2201, sub)] = lambda _: self._read_supply_limits()

    def _read_supply_limits(self) -> None:
        number = self._dictionary.number
        self._lowest_voltage, self._highest_voltage = number(0x2201, 1) * 1e-3, number(0x2201, 2) * 1e-3

    def _reset_node(self, now: float, state: DriveState) -> None:
        super()._reset_node(now, state)
        self._read_supply_limits()
        self.periphery.refresh()

    # ------------------------------------------------------------------------------------------ for the owner

    def open_sto(self, opened: bool, now: float) -> None:
        """The safe torque off inputs lose their voltage, or have it again."""
        self.periphery.sto_open = opened
        self._judge_inputs(now)

    def set_input(self, pin: int, high: bool, now: float) -> None:
        """A digital input, counted from 0, gets this level."""
        bit = 1 << pin
        self.periphery.levels = self.periphery.levels | bit if high else self.periphery.levels & ~bit
        self._judge_inputs(now)

    def _judge_inputs(self, now: float) -> None:
        """What inputs do by themselves: STO cuts the torque; drive enable and quick stop act like commands."""
        if self.nmt is None or self.nmt is Nmt.INITIALISING:
            return
        self._now = now
        device = self._device
        if not self.periphery.allow:
            device.disallow()
            if self.state in POWERED:
                if self.periphery.sto_open:
                    self._raise_error(STO_OPEN)
                else:
                    device.force(DriveState.SWITCH_ON_DISABLED)
        elif self.state is DriveState.OPERATION_ENABLE and QUICK_STOP_INPUT in self.periphery.active:
            device.force(DriveState.QUICK_STOP_ACTIVE)
        self._settle()

    # ------------------------------------------------------------------------------------------ what is different

    def _statusword(self) -> int:
        status = super()._statusword()
        return status | WARNING if self._memory.active and self._memory.warns else status

    def _cause_remains(self) -> bool:
        active = self._errors.active
        if STO_OPEN in active and self.periphery.sto_open:
            return True
        return self._voltage_error() != 0 or (HOT in active and self.periphery.too_hot)

    def _supervise(self, dt: float) -> None:
        super()._supervise(dt)
        if self.periphery.warm(dt) and HOT not in self._errors.active:
            self._alarms.append(HOT)
            self._wake(self._now)
        if self._drive_function.reads_ssi and self.axis.encoder is None and SSI_FRAME not in self._errors.active:
            self._alarms.append(SSI_FRAME)
            self._wake(self._now)

    def _raise_error(self, code: int) -> None:
        super()._raise_error(code)
        if code in UNREFERENCED and code in self._errors.active:
            self._drive_function.lose_reference()
