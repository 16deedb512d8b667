"""What takes a drive longer than a tick: coroutines that secure, configure and release it over SDO."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from math import radians
from typing import TypeVar

from artemis.devices.canopen import NmtCommand, SdoAbort, nmt_frame
from artemis.devices.epos import EposDrive
from artemis.devices.epos_identity import check_family, check_identity, held
from artemis.devices.epos_objects import NOT_VALID, more_pdos, pdo_settings, quantities, settings, wrapped
from artemis.devices.epos_state import Controlword
from artemis.drive_numbers import LIMIT_MARGIN
from artemis.drive_states import POWERED, DriveState
from artemis.errors import DeviceError, DeviceLost, DeviceRestarted, DeviceTimeout, NotKept, WrongDevice
from artemis.families.family import OptionCode
from artemis.families.objects import (
    CONSUMER_HEARTBEAT,
    CONTROLWORD,
    ERROR_COUNT,
    LIMIT_OFF,
    MODE_DISPLAY,
    POSITION,
    POSITION_LIMITS,
    SAVE,
    STATUSWORD,
    STORE,
    U32,
    Object,
    Setting,
)
from artemis.motion.ackermann import Ackermann
from artemis.values import RESETS, Job, JobKind, JobResult

MAX_RESETS = 3
"""A drive whose own error history asks for a reset gets so many of them until one helps."""
POLL = 0.02
"""Between two looks at the drive while waiting for it [s]."""
STOP_TIME = 5.0
"""Longest wait for a drive found moving to stand [s]."""
STORE_TIME = 3.0
"""A drive may be busy for so long when it stores its parameters [s]: no manual says how long it is."""

T = TypeVar("T")

_FAULTS: dict[type[DeviceError], str] = {
    SdoAbort: "COM-07",
    DeviceTimeout: "COM-08",
    DeviceLost: "COM-22",
    WrongDevice: "COM-33",
    NotKept: "COM-10",
    DeviceRestarted: "COM-26",
}


def fault_of(error: DeviceError) -> str:
    """The fault table's id of what a job met."""
    return _FAULTS.get(type(error), "COM-03")


class EposJobs:
    """The jobs of one drive. Each raises DeviceError where the drive refuses, is silent, or is another one."""

    def __init__(self, epos: EposDrive) -> None:
        self._epos, self._sdo = epos, epos.sdo
        self.name, self.drive, self._family = epos.name, epos.drive, epos.family
        self._set_point = epos.family.set_points[epos.drive.role]
        self._numbers = {
            JobKind.READ_CALIBRATION: epos.family.memory,
            JobKind.WRITE_CALIBRATION: epos.family.memory,
            JobKind.READ_GAINS: epos.family.gains,
            JobKind.WRITE_GAINS: epos.family.gains,
        }
        """What the jobs that move plain numbers read or write."""
        self._boots = self._resets = 0
        self._hardware: int | None = None
        """Version of the drive, once it is known to be of our family."""
        self._one_at_a_time = asyncio.Lock()  # an end that comes early must not overtake the configuration

    async def result(self, job: Job) -> JobResult:
        """Do a job once those before it have ended; a drive that fails is a result, not an exception."""
        try:
            values = await self.perform(job)
        except DeviceError as error:
            fault = fault_of(error)
            return JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=False, detail=error.problem, fault=fault)
        return JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=True, values=values)

    async def perform(self, job: Job) -> tuple[int, ...]:
        """Do a job once those before it have ended; its values, if it has any. Raises what the jobs raise."""
        async with self._one_at_a_time:
            return await self._do(job)

    async def _do(self, job: Job) -> tuple[int, ...]:
        match job.kind:
            case JobKind.SECURE:
                await self.secure(job.value)
            case JobKind.HALT | JobKind.KEEP_OFF:
                return (1,) if await self._switch_off() else ()
            case JobKind.CONFIGURE:
                await self.configure()
                return (1,) if self._family.forgets else ()
            case JobKind.REFERENCE:
                await self.reference(job.value)
            case JobKind.CLEAR_TARGET:
                return await self.check_target()
            case JobKind.READ_HISTORY:
                return await self.read_history()
            case JobKind.READ_STO:
                return await self._read_sto()
            case JobKind.READ_CALIBRATION | JobKind.READ_GAINS:
                return await self._read_all(self._numbers[job.kind])
            case JobKind.WRITE_CALIBRATION | JobKind.WRITE_GAINS:
                await self._write_all(self._numbers_for(job), job.values)
            case JobKind.STORE:
                await self.store()
            case JobKind.DISARM:
                await self.disarm()
        return ()

    def _numbers_for(self, job: Job) -> tuple[Object, ...]:
        if not (objects := self._numbers[job.kind]):
            raise DeviceError(self.name, f"has no place for it that is known here ({self._family.title})")
        return objects

    async def secure(self, reset: float) -> None:
        """Check its family, and if it moves, stop it; check who it is, and leave it off, unwatching, without a fault.

        A drive of another family is left as it is: what a controlword means to it is not known here.
        `reset`: have its communication or the whole node reset before (`RESETS`), as some faults need. The drive's own
        error history tells the same of a fault that nobody heard of, where a fault reset alone is not enough; it is
        followed `MAX_RESETS` times.
        """
        history: tuple[int, ...] = ()
        self._hardware = None
        tried: list[str] = []
        if reset:
            tried.append(await self._reset(reset))
        else:
            await self._make_safe()
        if (state := await self._settled_state()) is DriveState.FAULT:
            tried.append("fault reset")
            history = await self.read_history()  # before a reset clears it
            needed = max((RESETS[self._family.resets.get(code, "")] for code in history), default=0.0)
            if needed > reset and self._resets < MAX_RESETS:
                self._resets += 1
                tried.append(await self._reset(needed))
                state = await self._settled_state()
        if state is not DriveState.SWITCH_ON_DISABLED:
            codes = ", ".join(f"0x{code:04X}" for code in history or await self.read_history()) or "empty"
            after = f" after {', '.join(tried)}" if tried else ""
            problem = f"stays in {state.value}, not switch on disabled{after}; error history: {codes}"
            raise DeviceError(self.name, problem)
        self._resets = 0

    async def _reset(self, reset: float) -> str:
        """Off, then NMT Reset Communication or Reset Node (`RESETS`), and made safe; what was sent.

        A drive boots once for it (CiA 301, 7.3.2); one that boots again has restarted by itself.
        """
        await self._switch_off()
        boots = self._epos.boots
        whole = reset == RESETS["node"]
        command = NmtCommand.RESET_NODE if whole else NmtCommand.RESET_COMMUNICATION
        self._epos.send(nmt_frame(command, self.drive.node_id))
        self._hardware = None  # what boots is asked anew
        await asyncio.sleep(self._family.reset_time)
        await self._make_safe()
        if self._boots > boots + 1:
            raise DeviceRestarted(self.name, "once more after it was reset")
        return "NMT Reset Node" if whole else "NMT Reset Communication"

    async def _make_safe(self) -> None:
        """Pre-Operational, off, the right drive, unwatching; a fault is reset where that is all it needs."""
        await self._check_family()
        self._boots = self._epos.boots
        self._epos.send(nmt_frame(NmtCommand.ENTER_PRE_OPERATIONAL, self.drive.node_id))
        await self._switch_off()
        await self._check_identity()
        await self._stop_watching()
        await self._reset_fault()

    async def configure(self) -> None:
        """Write the robot file's settings and the PDOs, read each back, and start the node; it has to be secured."""
        try:
            await self._write_configuration()
        except DeviceError:
            if self._epos.boots == self._boots:
                raise
        if self._epos.boots != self._boots:
            raise DeviceRestarted(self.name, "while it was configured")
        self._epos.restart()
        self._epos.send(nmt_frame(NmtCommand.START, self.drive.node_id))

    async def _write_configuration(self) -> None:
        family, period = self._family, self._epos.period
        for setting in settings(self._epos.robot, self.drive, period):
            await self._ensure(setting)
        for object in family.cleared:
            if await held(self.read, object):
                await self._write_checked(Setting(object, 0))
        for option in family.option_codes:
            await self._ensure_option(option)
        await self._check_configured()
        for cob_id in more_pdos(self.drive):
            await self._switch_pdo_off(cob_id)
        for pdo in pdo_settings(self._epos.robot, self.drive):
            await self._ensure_pdo(pdo)

    async def _check_configured(self) -> None:
        """What follows from the settings, or must not be there, is as it has to be."""
        family, period = self._family, self._epos.period
        for (object, value, _), meaning in family.forbidden:
            if await held(self.read, object) == value:
                raise NotKept(self.name, f"{object} is {value} ({meaning})")
        for object, quantity, name in family.checks:
            wanted = quantities(self._epos.robot, self.drive, period)[quantity]
            if (found := await self.read(object)) != wanted:
                raise WrongDevice(self.name, f"has {found} {name} ({object}), the robot file says {wanted}")
        mode = self.drive.operating_mode
        if (shown := await self._settled(partial(self.read, MODE_DISPLAY), mode)) != mode:
            raise DeviceError(self.name, f"shows operating mode {shown}, not {mode}")

    async def _ensure_pdo(self, pdo: list[Setting]) -> None:
        if not await self._holds(pdo):
            if not self._family.moves_valid_pdos:
                await self._switch_pdo_off(pdo[0].object)
            for setting in pdo:
                await self._write_checked(setting)

    async def _ensure_option(self, option: OptionCode) -> None:
        try:
            await self._ensure(option.setting)
        except (SdoAbort, NotKept) as error:
            wanted = f"{option.setting.object} = {option.setting.value} ({option.name})"
            raise NotKept(self.name, f"does not take the option code {wanted}: {error.problem}") from error

    async def _switch_pdo_off(self, cob_id: Object) -> None:
        """With the identifier that it has: another is refused while the PDO is valid. One that is not there is off."""
        present = await held(self.read, cob_id)
        if present is not None and not present & NOT_VALID:
            await self._write_checked(Setting(cob_id, present | NOT_VALID))

    async def reference(self, angle: float) -> None:
        """The wheel stands at `angle` [rad]: count from here, and let the drive refuse what is out of reach."""
        raw = await self.read(POSITION)
        car = Ackermann(self._epos.robot.geometry)
        reach = radians(self._epos.robot.limits.steering_deg)
        side = 0 if self.drive.side == "left" else 1
        ends = (car.wheel_angles(-reach)[side] - LIMIT_MARGIN, car.wheel_angles(reach)[side] + LIMIT_MARGIN)
        ends = min(ends[0], angle - LIMIT_MARGIN), max(ends[1], angle + LIMIT_MARGIN)  # found beyond: it may come back
        limits = sorted(raw + round((end - angle) * self._epos.units.counts) for end in ends)
        if not LIMIT_OFF[0] < limits[0] < limits[1] < LIMIT_OFF[1]:  # a set-point beyond would be one at the other end
            raise NotKept(self.name, f"counts from {raw} on: too near the end of its counter for position limits")
        if self._family.limits_position:
            await self._write_all(POSITION_LIMITS, limits)
        self._epos.rebase(angle, raw)  # last: the job's result shall be seen together with the new angle

    async def check_target(self) -> tuple[int, ...]:
        """The set-point in the drive is harmless to enable with: no speed, or the present position.

        Returns the stale one that had to be cleared, if there was one.
        """
        target = await self.read(self._set_point)
        wanted = 0 if self.drive.role == "traction" else await self.read(POSITION)
        if abs(target - wanted) > (0 if self.drive.role == "traction" else self.drive.lag_counts // 4):
            await self.write(self._set_point, wanted)
            if (kept := await self.read(self._set_point)) != wanted:
                raise NotKept(self.name, f"keeps the stale set-point {kept} in {self._set_point} (wanted {wanted})")
            return (target,)
        return ()

    async def read_history(self) -> tuple[int, ...]:
        """Error codes of object 0x1003, newest first; none where a drive has none: CiA 301 leaves it to the maker."""
        count = await held(self.read, ERROR_COUNT) or 0
        codes = [await held(self.read, Object(0x1003, number, U32)) for number in range(1, min(count, 5) + 1)]
        return tuple(code & 0xFFFF for code in codes if code is not None)

    async def _read_sto(self) -> tuple[int, ...]:
        """What its inputs for safe torque off show, where one is open."""
        if (closed := self._family.sto) is None:
            return ()
        shown = await self.read(closed.object)
        return () if shown & closed.value == closed.value else (shown,)

    async def store(self) -> None:
        """Keep all parameters for ever, but for the position limits: when the power comes the drive counts from zero.

        Only while the drive is off: it is busy meanwhile.
        """
        objects = POSITION_LIMITS if self._family.limits_position else ()
        limits = await self._read_all(objects)
        await self._write_all(objects, LIMIT_OFF[: len(objects)])
        await self._sdo.write(STORE.index, STORE.subindex, STORE.type.encode(SAVE), STORE_TIME)
        await self._write_all(objects, limits)

    async def disarm(self) -> None:
        """Off, then no longer watching our heartbeat, Pre-Operational: the drive rests without a fault.

        One that may still turn goes on watching, and in the exchange of process data: our silence stops it.
        """
        await self._switch_off()
        try:
            await self._stop_watching()
            await self._reset_fault()
        finally:
            self._epos.send(nmt_frame(NmtCommand.ENTER_PRE_OPERATIONAL, self.drive.node_id))

    async def _switch_off(self) -> bool:
        """Power off; a moving drive is stopped by its own ramp before. Whether it was on."""
        await self._check_family()
        if was_on := (await self._read_state()) in POWERED:
            await self.write(CONTROLWORD, Controlword.QUICK_STOP)
            await self._come_to_rest()
        await self.write(CONTROLWORD, Controlword.DISABLE_VOLTAGE)
        return was_on

    async def _stop_watching(self) -> None:
        await self._ensure(Setting(CONSUMER_HEARTBEAT, 0))

    async def _reset_fault(self) -> None:
        if (await self._read_state()) is DriveState.FAULT:
            await self.write(CONTROLWORD, Controlword.FAULT_RESET)  # the drive refuses while the cause remains

    # ------------------------------------------------------------------------------------------ objects

    async def read(self, object: Object) -> int:
        """Value of an object."""
        return int(object.type.decode(await self._sdo.read(object.index, object.subindex, object.type.size)))

    async def write(self, object: Object, value: int) -> None:
        """Write an object."""
        await self._sdo.write(object.index, object.subindex, object.type.encode(value))

    async def _read_all(self, objects: Sequence[Object]) -> tuple[int, ...]:
        return tuple([await self.read(object) for object in objects])

    async def _write_all(self, objects: Sequence[Object], values: Sequence[int]) -> None:
        for object, value in zip(objects, values, strict=True):
            await self._ensure(Setting(object, value))

    async def _ensure(self, setting: Setting) -> None:
        """Write only what differs: changing sensor data raises errors, and settings wear the memory."""
        present = await self.read(setting.object)
        if (wanted := setting.over(present)) != present:
            await self._write_checked(Setting(setting.object, wanted))

    async def _holds(self, pdo: list[Setting]) -> bool:
        """Whether every object of a PDO has the last of its values already; one to be off may not be there at all."""
        final = {setting.object: setting.value for setting in pdo}
        for object, value in final.items():
            found = await (held(self.read, object) if len(pdo) == 1 else self.read(object))
            if found is not None and found != value:
                return False
        return True

    async def _write_checked(self, setting: Setting) -> None:
        await self.write(setting.object, setting.value)
        if (kept := await self.read(setting.object)) != setting.value:
            raise NotKept(self.name, f"did not keep {setting.object}: wrote 0x{setting.value:X}, reads 0x{kept:X}")

    async def _check_family(self) -> None:
        """What a controlword means depends on the family; asked again when the drive is secured, and after a reset."""
        if self._hardware is None:
            self._hardware = await check_family(self.name, self.drive, self.read)

    async def _check_identity(self) -> None:
        """Hardware, firmware and serial number against the robot file."""
        assert self._hardware is not None  # its family was checked
        await check_identity(self.name, self.drive, self._hardware, self.read)

    async def _read_state(self) -> DriveState:
        return self._family.state(await self.read(STATUSWORD))

    async def _settled_state(self) -> DriveState:
        """Switch On Disabled, once it is in it; else the state in which it stays."""
        return await self._settled(self._read_state, DriveState.SWITCH_ON_DISABLED)

    async def _settled(self, read: Callable[[], Awaitable[T]], wanted: T) -> T:
        """What is read as soon as it is `wanted`, or at last: a drive may follow a write a while after its answer."""
        for _ in range(round(self._family.state_time / POLL)):
            if (seen := await read()) == wanted:
                return seen
            await asyncio.sleep(POLL)
        return await read()

    async def _come_to_rest(self) -> None:
        """Wait until it stands: a sensor at its edge may tell one count more or less at each look."""
        still = max(1.0, self._family.still_rpm / 60.0 * POLL * self.drive.sensor.counts_per_turn)
        last = await self.read(POSITION)
        for _ in range(round(STOP_TIME / POLL)):
            await asyncio.sleep(POLL)
            if abs(wrapped((position := await self.read(POSITION)) - last)) <= still:
                return
            last = position
        raise DeviceError(self.name, f"was found moving and does not stop within {STOP_TIME:g} s")
