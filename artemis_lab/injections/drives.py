"""Faults that drives report, and drives that do not do what they are told: DRV-.. and half of COM-.."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from artemis.config import Config
from artemis.drive_schema import Drive
from artemis.drive_states import DriveState, Nmt
from artemis.families.objects import PRODUCT
from artemis.sim.cia402_objects import objects402
from artemis.sim.epos2 import objects2
from artemis.sim.epos4_objects import objects4
from artemis.sim.epos_failures import Speech
from artemis.sim.epos_objects import objects
from artemis_lab.injections.emergencies import EMERGENCY_INJECTIONS, Word
from artemis_lab.injections.stage import Count, Injection, Lasting, Needs, Nothing, Positive, Stage, Undo, together

EMERGENCY = 0x080
ABORT_GENERAL = 0x08000000
"""SDO abort code "general error" (CiA 301 7.2.4.3.17)."""

UNKNOWN = 0x9999
"""An error code that no EPOS has."""

Index = Annotated[int, Field(ge=0, le=0xFFFF)]
Sub = Annotated[int, Field(ge=0, le=0xFF)]

OBJECTS = {
    "epos1": {(entry.index, entry.sub) for entry in objects(1, 0, 0, 0)},
    "epos2": {(entry.index, entry.sub) for entry in objects2(1, 0, 0, 0)},
    "epos4": {(entry.index, entry.sub) for entry in objects4(1, 0, 0, 0)},
}
"""Index and sub-index of everything that a drive of a family has; of others their robot file says it."""
OF_ITS_MAKER = range(0x2000, 0x6000)
"""Indices that CiA 301 leaves to the maker of a drive."""


class UnknownError(Config):
    """An error of the drive that is in no table."""

    code: Word = UNKNOWN
    """EMCY error code."""
    heard: bool = True
    """The EMCY frame arrives; without it only the statusword tells."""


class DamagedEmergency(Config):
    """An EMCY frame of the wrong length."""

    length: Annotated[int, Field(ge=0, le=7)] = 5


class Storm(Config):
    """EMCY frames without end."""

    code: Word = 0x2310
    times: Count = 40
    rate_hz: Positive = 50.0


class SilentFault(Config):
    """An error whose EMCY frame is lost."""

    code: Word = 0x1000


class NewState(Config):
    """A device state."""

    state: Literal["switch on disabled", "ready to switch on", "switched on", "quick stop active"] = (
        "switch on disabled"
    )


class RefusedState(Lasting):
    """A device state that the drive does not enter when told to; `refresh` leads to operation."""

    state: Literal[
        "switch on disabled", "ready to switch on", "switched on", "refresh", "operation enable", "quick stop active"
    ] = "refresh"


class WrongMode(Lasting):
    """What object 0x6061 shows."""

    mode: Annotated[int, Field(ge=-128, le=127)] = 1


class WrongStatusword(Lasting):
    """What object 0x6041 shows."""

    statusword: Word = 0x006F


class StaleTarget(Config):
    """What the target object still holds, in the drive's unit of velocity, or in counts of a steering drive."""

    target: int = 1000


class ObjectOf(Lasting):
    """An object of the drive."""

    index: Index = 0x6085
    sub: Sub = 0

    @model_validator(mode="after")
    def _known(self) -> Self:
        known = any((self.index, self.sub) in known for known in OBJECTS.values())
        if not known and self.index not in OF_ITS_MAKER:
            raise ValueError(f"no object 0x{self.index:04X} sub-index {self.sub} in any drive")
        return self


class RefusedObject(ObjectOf):
    """An object, and the code with which its requests are aborted."""

    index: Index = 0x1017
    code: Annotated[int, Field(ge=0, le=0xFFFFFFFF)] = ABORT_GENERAL
    count: Count | None = None
    """So many requests; None: all."""


class RefusedRelease(Lasting):
    """The code with which the drive refuses to stop watching the host."""

    code: Annotated[int, Field(ge=0, le=0xFFFFFFFF)] = ABORT_GENERAL


class FrameCount(Lasting):
    """How many frames; two of process data belong to each SYNC."""

    count: Count | None = None
    """None: all."""


class LateAnswer(Lasting):
    """SDO answers that come too late."""

    late_s: Positive = 0.08
    count: Count | None = 1


class NewNmt(Config):
    """An NMT state."""

    state: Literal["pre-operational", "stopped"] = "pre-operational"


class WrongNode(Lasting):
    """What is found where a node should be."""

    answers: Literal["nothing", "another product"] = "nothing"


def has_object(drive: Drive, index: int, sub: int) -> bool:
    """Whether the drive has it."""
    if drive.cia402 is None:
        return (index, sub) in OBJECTS[drive.family]
    return any((entry.index, entry.sub) == (index, sub) for entry in objects402(drive, drive.cia402))


def _report(stage: Stage, node: str | None, p: UnknownError) -> None:
    stage.drive(node).emergency(p.code, stage.now, heard=p.heard)


def _say_emergency(stage: Stage, node: str | None, data: bytes) -> None:
    drive = stage.drive(node)
    drive.say(EMERGENCY + drive.node_id, data, stage.now)


def _reset(stage: Stage, node: str | None, _: Nothing) -> None:
    _say_emergency(stage, node, bytes(8))


def _damaged(stage: Stage, node: str | None, p: DamagedEmergency) -> None:
    _say_emergency(stage, node, b"\x00\x10\x01\0\0\0\0\0"[: p.length])


def _storm(stage: Stage, node: str | None, p: Storm) -> Undo:
    stage.drive(node).emergency(p.code, stage.now, heard=False)
    data = p.code.to_bytes(2, "little") + b"\x01" + bytes(5)
    return stage.repeat(lambda: _say_emergency(stage, node, data), 1.0 / p.rate_hz, p.times)


def _fault_silently(stage: Stage, node: str | None, p: SilentFault) -> None:
    stage.drive(node).emergency(p.code, stage.now, heard=False)


def _change_state(stage: Stage, node: str | None, p: NewState) -> None:
    stage.drive(node).failures.force_state(DriveState(p.state))


def _refuse_state(stage: Stage, node: str | None, p: RefusedState) -> Undo:
    drive, state = stage.drive(node), DriveState(p.state)
    known = stage.robot.drives[drive.name].tables.states.values()
    if state is DriveState.REFRESH and state not in known:
        state = DriveState.OPERATION_ENABLE  # which it enters without it
    return drive.failures.refuse_states(state)


def _show_mode(stage: Stage, node: str | None, p: WrongMode) -> Undo:
    return stage.drive(node).failures.misreport(0x6061, 0, lambda _: p.mode)


def _show_statusword(stage: Stage, node: str | None, p: WrongStatusword) -> Undo:
    return stage.drive(node).failures.misreport(0x6041, 0, lambda _: p.statusword)


def _keep_target(stage: Stage, node: str | None, p: StaleTarget) -> None:
    drive = stage.drive(node)
    described = stage.robot.drives[drive.name]
    target = described.tables.set_points[described.role]
    stage.once_booted(drive, lambda: drive.poke(target.index, target.subindex, p.target))


def _abort(stage: Stage, node: str | None, p: RefusedObject) -> Undo:
    return stage.drive(node).failures.refuse_object(p.index, p.sub, p.code, p.count)


def _refuse_release(stage: Stage, node: str | None, p: RefusedRelease) -> Undo:
    return stage.drive(node).failures.refuse_object(0x1016, 1, p.code)


def _mute(kind: Speech) -> Callable[[Stage, str | None, FrameCount], Undo]:
    def mute(stage: Stage, node: str | None, p: FrameCount) -> Undo:
        return stage.drive(node).failures.impede(kind, count=p.count)

    return mute


def _answer_late(stage: Stage, node: str | None, p: LateAnswer) -> Undo:
    return stage.drive(node).failures.impede(Speech.SDO, copies=1, late=p.late_s, count=p.count)


def _ignore_write(stage: Stage, node: str | None, p: ObjectOf) -> Undo:
    return stage.drive(node).failures.ignore_writes(p.index, p.sub)


def _speak_twice(stage: Stage, node: str | None, _: Lasting) -> Undo:
    failures = stage.drive(node).failures
    return together([failures.impede(kind, copies=2) for kind in Speech])


def _reboot(stage: Stage, node: str | None, _: Nothing) -> None:
    stage.drive(node).power_on(stage.now)


def _change_nmt(stage: Stage, node: str | None, p: NewNmt) -> None:
    state = Nmt.STOPPED if p.state == "stopped" else Nmt.PRE_OPERATIONAL
    stage.drive(node).change_nmt(state, stage.now)


def _ignore_heartbeats(stage: Stage, node: str | None, _: Lasting) -> Undo:
    return together([drive.failures.ignore_heartbeats() for drive in stage.drives(node)])


def _nobody(stage: Stage, node: str | None, _: Lasting) -> Undo:
    """Without power a drive is silent."""
    drives = stage.drives(node)
    for drive in drives:
        drive.power_off()
    return together([lambda drive=drive: drive.power_on(stage.now) for drive in drives])  # type: ignore[misc]


def _be_another(stage: Stage, node: str | None, p: WrongNode) -> Undo:
    if p.answers == "nothing":
        return _nobody(stage, node, p)
    drive = stage.drive(node)
    undos = [drive.failures.misreport(0x1018, 2, lambda product: product ^ 0x0100_0000)]
    hardware = stage.robot.drives[drive.name].tables.hardware.object
    if hardware != PRODUCT:  # others have their hardware version in the product code alone
        undos.append(drive.failures.misreport(hardware.index, hardware.subindex, lambda version: version ^ 0x0100))
    return together(undos)


DRIVE_INJECTIONS: dict[str, Injection] = {
    **EMERGENCY_INJECTIONS,
    "DRV-30": Injection("drive reports that no error is left", _reset, Needs.DRIVE),
    "DRV-31": Injection("drive reports an unknown error", _report, Needs.DRIVE, UnknownError),
    "DRV-32": Injection("EMCY frame of the wrong length", _damaged, Needs.DRIVE, DamagedEmergency),
    "DRV-33": Injection("EMCY frames without end", _storm, Needs.DRIVE, Storm),
    "COM-01": Injection("drive goes into fault, its EMCY frame is lost", _fault_silently, Needs.DRIVE, SilentFault),
    "COM-02": Injection("drive changes its state by itself", _change_state, Needs.DRIVE, NewState),
    "COM-03": Injection("drive does not enter a state", _refuse_state, Needs.DRIVE, RefusedState),
    "COM-04": Injection("drive shows another mode of operation", _show_mode, Needs.DRIVE, WrongMode),
    "COM-05": Injection("drive shows a meaningless statusword", _show_statusword, Needs.DRIVE, WrongStatusword),
    "COM-06": Injection("drive kept a target", _keep_target, Needs.DRIVE, StaleTarget),
    "COM-07": Injection("drive aborts SDO requests for an object", _abort, Needs.DRIVE, RefusedObject),
    "COM-08": Injection("drive answers no SDO request", _mute(Speech.SDO), Needs.DRIVE, FrameCount),
    "COM-09": Injection("drive answers SDO requests too late", _answer_late, Needs.DRIVE, LateAnswer),
    "COM-10": Injection("drive confirms writes of an object and drops them", _ignore_write, Needs.DRIVE, ObjectOf),
    "COM-11": Injection("drive sends no feedback", _mute(Speech.PROCESS_DATA), Needs.DRIVE, FrameCount),
    "COM-19": Injection("a second node with the same id speaks", _speak_twice, Needs.DRIVE, Lasting),
    "COM-26": Injection("drive restarts", _reboot, Needs.DRIVE),
    "COM-27": Injection("drive leaves the NMT state Operational", _change_nmt, Needs.DRIVE, NewNmt),
    "COM-28": Injection("drive sends no heartbeat", _mute(Speech.HEARTBEAT), Needs.DRIVE, FrameCount),
    "COM-30": Injection("drive does not watch the host", _ignore_heartbeats, Needs.SOME_DRIVE, Lasting),
    "COM-32": Injection("no drive has power", _nobody, Needs.NOTHING, Lasting),
    "COM-33": Injection("node is missing, or another product", _be_another, Needs.DRIVE, WrongNode),
    "COM-34": Injection("drive refuses to stop watching the host", _refuse_release, Needs.DRIVE, RefusedRelease),
    "SYS-09": Injection("all drives lose their power", _nobody, Needs.NOTHING, Lasting),
}
