"""A simulated EPOS: a CANopen node that is only frames in, frames out, and time; with the first generation's parts.

What its parts do: `dictionary` and `epos_objects` hold the objects, `epos_sdo` serves them, `epos_pdo` maps them,
`epos_power` is the device state machine, `epos_motion` the modes of operation, `epos_errors` the error memory,
`epos_error_control` heartbeats and guarding, `epos_parameters` the non-volatile memory; `axis` is what it moves;
`epos_failures` is what it can be made to do wrong. `cia402` makes a drive of that profile of it, `epos4` an EPOS4.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container

from artemis.devices.can_bus import Frame
from artemis.drive_schema import Drive
from artemis.drive_states import DriveState, Nmt
from artemis.sim.axis import Axis
from artemis.sim.dictionary import Dictionary, key_of
from artemis.sim.epos1_motion import Epos1Motion
from artemis.sim.epos_error_control import ErrorControl
from artemis.sim.epos_errors import ERRORS, LIFE_GUARD, OVER_VOLTAGE, PDO_LENGTH, UNDER_VOLTAGE, ErrorMemory
from artemis.sim.epos_failures import EposFailures, Post, Sending, Speech
from artemis.sim.epos_motion import Motion
from artemis.sim.epos_objects import VOLATILE, millivolts, objects
from artemis.sim.epos_parameters import ParameterMemory, judge_motor_and_sensor
from artemis.sim.epos_pdo import ON_REQUEST, ProcessData, ReceivePdo, TransmitPdo
from artemis.sim.epos_power import PowerStage
from artemis.sim.epos_sdo import SdoServer
from artemis.sim.epos_settings import SimSettings

NMT_ID = 0x000
EMCY_ID, SDO_ANSWER_ID, SDO_REQUEST_ID, ERROR_CONTROL_ID = 0x080, 0x580, 0x600, 0x700
START, STOP, ENTER_PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 0x01, 0x02, 0x80, 0x81, 0x82
REMOTE = 0x0200
"""Statusword bit 9: the node is operational."""

Handler = Callable[[Frame, float], None]

# Looking a member up in its class is slow.
_OPERATIONAL = Nmt.OPERATIONAL


class SimEpos:
    """One simulated drive. Its owner feeds it frames and time, steps its axis, and drains its outbox."""

    known_errors = ERRORS

    def __init__(self, drive: Drive, axis: Axis, *, name: str, settings: SimSettings | None = None) -> None:
        self.name = name
        self.node_id = drive.node_id
        self.axis = axis
        self.settings = SimSettings() if settings is None else settings
        self.outbox: list[Sending] = []
        """Frames to be sent, each with the time at which it is ready; the owner empties it."""
        self._post: Post = self.outbox.append
        self.nmt: Nmt | None = None
        """None: no power."""
        self.boot_time = self.settings.boot_time_s
        """From power-up or reset to the boot-up frame [s]."""
        self._lowest_voltage, self._highest_voltage = self.settings.under_voltage_v, self.settings.over_voltage_v
        self._now = 0.0
        self.next_due = math.inf
        """Time at which `advance` has something to do [s]; in the past: at once; inf: nothing is planned."""
        self._boot_end = self._changes_due = math.inf
        self._alarms: list[int] = []
        self._handlers: dict[int, Handler] = {}
        self.hears: Container[int] = self._handlers
        """Identifiers that mean something to the node in its present state."""
        self._dictionary = self._make_dictionary(drive)
        self._errors, self._motion, self._power = self._make_parts(drive)
        self._sdo = SdoServer(self._dictionary)
        self._pdos = ProcessData(
            self._dictionary, pre_operational=lambda: self.nmt is Nmt.PRE_OPERATIONAL, changed=self._route
        )
        self._control = ErrorControl(self._dictionary, clock=lambda: self._now, changed=self._route)
        parts = self._dictionary, self._motion, self._power, self._control, self._pdos
        self.failures = EposFailures(*parts, outbox=self.outbox, send_through=self._send_through)
        """What it can be made to do wrong."""
        self._describe()
        self._parameters = self._make_memory()

    # ------------------------------------------------------------------------------------------ of its generation

    def _make_dictionary(self, drive: Drive) -> Dictionary:
        serial = self.node_id if drive.serial_number is None else drive.serial_number
        return Dictionary(
            objects(self.node_id, drive.hardware_version, self.settings.firmware, serial),
            power_off=lambda: self._power.power_off,
        )

    def _make_parts(self, drive: Drive) -> tuple[ErrorMemory, Motion, PowerStage]:
        dictionary, settings = self._dictionary, self.settings
        errors = ErrorMemory(dictionary, self.known_errors)
        motion = Epos1Motion(dictionary, self.axis, clip_position=settings.position_limits_clip, gains=drive.gains)
        power = PowerStage(
            motion,
            errors,
            refresh=settings.refresh_s,
            measure=settings.measure_s,
            cause_remains=lambda: self._voltage_error() != 0,
        )
        return errors, motion, power

    def _make_memory(self) -> ParameterMemory:
        memory = ParameterMemory(self._dictionary, volatile=VOLATILE)
        memory.restore_identifiers(self._pdos, self.node_id)
        return memory

    def _describe(self) -> None:
        """Tie the objects that belong to the node as a whole."""
        getters, written = self._dictionary.getters, self._dictionary.written
        getters[key_of(0x207C, 1)] = lambda: millivolts(self.axis.analog[0])
        getters[key_of(0x207C, 2)] = lambda: millivolts(self.axis.analog[1])
        written[key_of(0x1005, 0)] = lambda _: self._route()
        judge_motor_and_sensor(self._dictionary)
        self._describe_device()

    # ------------------------------------------------------------------------------------------ for the owner

    @property
    def state(self) -> DriveState:
        """Device state."""
        return self._power.state

    def power_on(self, now: float) -> None:
        """Supply comes, or came back: everything not stored is lost, the boot-up frame follows after the boot time."""
        self._reset_node(now, DriveState.START)

    def power_off(self) -> None:
        """Supply goes: the node is silent and unresponsive, the shaft coasts."""
        self.nmt = self.axis.after_step = None
        self._power.start(DriveState.START)
        self.next_due = self._boot_end = math.inf
        self._alarms.clear()
        self._route()

    def receive(self, frame: Frame, now: float) -> None:
        """A frame was seen on the wire; all but those meant for this node are ignored."""
        handler = self._handlers.get(frame.id)
        if handler is None:
            return
        if now >= self.next_due:
            self.advance(now)
        self._now = now
        handler(frame, now)

    def advance(self, now: float) -> None:
        """Do everything that is due up to `now`: timers, automatic state changes, what the last axis step caused."""
        if now < self.next_due or self.nmt is None:
            return
        self._now = now
        if self._boot_end <= now:
            self._finish_boot()
        if self._alarms:
            alarms, self._alarms = self._alarms, []
            for code in alarms:
                self._raise_error(code)
        self._power.finish_ramp(now)
        if self._power.due <= now:
            self._after_command(*self._power.advance(now))
        if self._control.due <= now:
            self._run_error_control()
        self._send_changes()
        self.next_due = min(self._boot_end, self._power.due, self._control.due, self._changes_due)

    def emergency(self, code: int, now: float, *, heard: bool = True) -> None:
        """Raise a device error with its documented reaction; codes not in the table cut the power as 0x1000 does.

        A node without power, or one that is still initialising, has no errors. Not `heard`: its EMCY frame is lost.
        """
        self._now = now
        hear = None if heard else self.failures.impede(Speech.EMERGENCY)
        self._raise_error(code)
        if hear is not None:
            hear()
        self._settle()

    def say(self, identifier: int, data: bytes, now: float) -> None:
        """Failure: send a frame that nothing asked for, at once."""
        self._post((now, Frame(identifier, data)))
        self._wake(now)

    def read(self, index: int, sub: int = 0) -> int | bytes:
        """Present value of an object, whatever its access.

        Raises:
            Abort: no such object.
        """
        return self._dictionary.read(index, sub)

    def poke(self, index: int, sub: int, value: int) -> None:
        """Put a number into an object, past access, range and state, and let it act; measured objects stay as they are.

        Raises:
            Abort: no such object.
        """
        self._dictionary.poke(index, sub, value)
        self._settle()

    # ------------------------------------------------------------------------------------------ objects of the node

    def _describe_device(self) -> None:
        """Tie status and command."""
        self._dictionary.getters[key_of(0x6041, 0)] = self._statusword
        self._dictionary.written[key_of(0x6040, 0)] = self._obey

    def _statusword(self) -> int:
        status = self._power.pattern | self._motion.status_bits()
        return status | REMOTE if self.nmt is _OPERATIONAL else status

    def _obey(self, controlword: int) -> None:
        power = self._power
        error, fault_reset = power.command(controlword, self._now)
        if error or fault_reset:
            self._after_command(error, fault_reset)
        self._wake(power.due)

    def _after_command(self, error: int, fault_reset: bool) -> None:
        if error:
            self._raise_error(error)
        if fault_reset:
            self._send_emergency(0x0000)

    # ------------------------------------------------------------------------------------------ NMT

    def _reset_node(self, now: float, state: DriveState) -> None:
        self._parameters.load()
        self._errors.reset()
        self._alarms.clear()
        self._power.start(state)
        self._motion.start()
        self._boot(now)

    def _boot(self, now: float) -> None:
        self.nmt, self.axis.after_step = Nmt.INITIALISING, None
        self._now = now
        self._sdo.reset()
        self._control.stop()
        self._boot_end = self.next_due = now + self.boot_time
        self._route()

    def _finish_boot(self) -> None:
        """End of Initialising: boot-up frame, Pre-Operational; after a node reset the device states begin."""
        self._boot_end = math.inf
        self._send(ERROR_CONTROL_ID + self.node_id, bytes((Nmt.INITIALISING.value,)))
        if self._power.state in (DriveState.START, DriveState.NOT_READY):
            self._power.initialised()
        self.nmt = Nmt.PRE_OPERATIONAL
        self._pdos.start()
        self._control.start()
        self.axis.after_step = self._supervise

    def _command_nmt(self, frame: Frame, now: float) -> None:
        if frame.rtr or len(frame.data) < 2 or frame.data[1] not in (0, self.node_id):
            return
        command = frame.data[0]
        if command == START:
            self.change_nmt(Nmt.OPERATIONAL, now)
        elif command == STOP:
            self.change_nmt(Nmt.STOPPED, now)
        elif command == ENTER_PRE_OPERATIONAL:
            self.change_nmt(Nmt.PRE_OPERATIONAL, now)
        elif command == RESET_NODE:
            self._reset_node(now, DriveState.NOT_READY)
        elif command == RESET_COMMUNICATION:
            self._errors.note_bus_reset()
            self._parameters.load_communication()
            self._boot(now)

    def change_nmt(self, state: Nmt, now: float) -> None:
        """Enter an NMT state; nothing happens in the same one."""
        if self.nmt is state:
            return
        self.nmt, self._now = state, now
        self._sdo.reset()
        self._pdos.restart()
        self._route()
        self._settle()

    def _route(self) -> None:
        """Which identifiers mean something in the present NMT state."""
        if self.nmt is None or self.nmt is Nmt.INITIALISING:
            self._handlers = self.hears = {}
            return
        handlers: dict[int, Handler] = {}
        if self.nmt is Nmt.OPERATIONAL:
            handlers.update((pdo.id, self._transmit_handler(pdo)) for pdo in self._pdos.transmitted if pdo.valid)
            handlers.update((pdo.id, self._receive_handler(pdo)) for pdo in self._pdos.received if pdo.valid)
            handlers[self._dictionary.number(0x1005)] = self._take_sync
        if self.nmt is not Nmt.STOPPED:
            handlers[SDO_REQUEST_ID + self.node_id] = self._take_sdo
        handlers.update((ERROR_CONTROL_ID + producer, self._take_heartbeat) for producer in self._control.consumers)
        handlers[ERROR_CONTROL_ID + self.node_id] = self._take_guard
        handlers[NMT_ID] = self._command_nmt
        self._handlers = self.hears = handlers

    # ------------------------------------------------------------------------------------------ frames in

    def _take_sdo(self, frame: Frame, now: float) -> None:
        answer = None if frame.rtr else self._sdo.answer(frame.data)
        if answer is not None:
            self._post((now + self.settings.answer_time_s, Frame(SDO_ANSWER_ID + self.node_id, answer)))
        self._settle()

    def _take_sync(self, frame: Frame, now: float) -> None:
        if frame.rtr:
            return
        self._pdos.sync()
        for pdo in self._pdos.on_sync:
            self._post((now, pdo.sample()))
        if self._pdos.on_change:
            self._settle()

    def _receive_handler(self, pdo: ReceivePdo) -> Handler:
        def take(frame: Frame, _: float) -> None:
            if frame.rtr:
                return
            if not self._pdos.receive(pdo, frame.data):
                self._raise_error(PDO_LENGTH)
                self._settle()
            elif self._pdos.on_change:
                self._settle()

        return take

    def _transmit_handler(self, pdo: TransmitPdo) -> Handler:
        def take(frame: Frame, now: float) -> None:
            if frame.rtr and (pdo.rtr_allowed or pdo.type == ON_REQUEST):
                self._post((now, pdo.sample()))

        return take

    def _take_heartbeat(self, frame: Frame, now: float) -> None:
        if not frame.rtr:
            self._wake(self._control.hear(frame.id - ERROR_CONTROL_ID, now))

    def _take_guard(self, frame: Frame, now: float) -> None:
        if not frame.rtr or self.nmt is None:
            return
        answer = self._control.answer_guard(self.nmt.value, now)
        if answer is not None:
            self._send(frame.id, bytes((answer,)))
            self._wake(self._control.due)

    # ------------------------------------------------------------------------------------------ time and frames out

    def _supervise(self, dt: float) -> None:
        """After each step of the axis: what the device notices of it is dealt with in `advance`."""
        error = self._motion.supervise(dt)
        if not (error or self._lowest_voltage <= self.axis.supply_voltage <= self._highest_voltage):
            error = self._voltage_error()
        if error and error not in self._errors.active:
            self._alarms.append(error)
        elif not (self._power.ramping or (self._pdos.on_change and self.nmt is _OPERATIONAL)):
            return
        self._wake(self._now)

    def _voltage_error(self) -> int:
        if self._lowest_voltage <= self.axis.supply_voltage <= self._highest_voltage:
            return 0
        return UNDER_VOLTAGE if self.axis.supply_voltage < self._lowest_voltage else OVER_VOLTAGE

    def _raise_error(self, code: int) -> None:
        if self.nmt is not None and self.nmt is not Nmt.INITIALISING and self._errors.add(code):
            self._send_emergency(code)
            self._power.fail(code, self._now)

    def _run_error_control(self) -> None:
        beat, silent = self._control.advance(self._now)
        if beat and self.nmt is not None:
            self._send(ERROR_CONTROL_ID + self.node_id, bytes((self.nmt.value,)))
        if silent:
            self._raise_error(LIFE_GUARD)

    def _send_changes(self) -> None:
        self._changes_due = math.inf
        if self.nmt is Nmt.OPERATIONAL and self._pdos.on_change:
            frames, self._changes_due = self._pdos.change_samples(self._now)
            for frame in frames:
                self._post((self._now, frame))

    def _send_emergency(self, code: int) -> None:
        if self.nmt in (Nmt.PRE_OPERATIONAL, Nmt.OPERATIONAL):
            self._send(EMCY_ID + self.node_id, code.to_bytes(2, "little") + bytes((self._errors.register,)) + bytes(5))

    def _send(self, identifier: int, data: bytes) -> None:
        self._post((self._now, Frame(identifier, data)))

    def _settle(self) -> None:
        """After something that may have moved timers or mapped values."""
        self._send_changes()
        self._wake(min(self._power.due, self._control.due, self._changes_due))

    def _send_through(self, post: Post) -> None:
        self._post = post

    def _wake(self, due: float) -> None:
        if due < self.next_due and self.nmt is not None:
            self.next_due = due
