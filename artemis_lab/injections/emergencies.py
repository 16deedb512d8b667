"""Errors that drives report, by row of the fault table and family of the drive: DRV-01 to DRV-29, DRV-34 to DRV-42."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field, create_model

from artemis.config import Config
from artemis.families.cia402 import ERRORS as ERRORS_402
from artemis.sim.epos4 import SimEpos4
from artemis.sim.epos4_errors import HOT, STO_OPEN
from artemis_lab.injections.stage import Injection, Needs, Positive, Stage, Undo

Word = Annotated[int, Field(ge=0, le=0xFFFF)]

TEXTS = {
    "DRV-01": "generic error",
    "DRV-02": "over-current",
    "DRV-03": "over-voltage",
    "DRV-04": "under-voltage",
    "DRV-05": "logic supply",
    "DRV-06": "over-temperature",
    "DRV-07": "internal software error",
    "DRV-08": "software parameter error",
    "DRV-09": "corrupt parameters",
    "DRV-10": "hardware defect",
    "DRV-11": "position sensor error",
    "DRV-12": "position sensor breach",
    "DRV-13": "encoder index",
    "DRV-14": "hall sensor",
    "DRV-15": "hall sensor not found",
    "DRV-16": "hall angle",
    "DRV-17": "sensor direction",
    "DRV-18": "CAN overrun",
    "DRV-19": "CAN passive",
    "DRV-20": "host's heartbeat lost",
    "DRV-21": "COB-ID collision",
    "DRV-22": "CAN bus off",
    "DRV-23": "CAN queue overrun",
    "DRV-24": "PDO length",
    "DRV-25": "following error",
    "DRV-26": "limit switch",
    "DRV-27": "software position limit",
    "DRV-28": "overloaded",
    "DRV-29": "safe torque off",
    "DRV-34": "power stage protection",
    "DRV-35": "motor too hot",
    "DRV-36": "absolute encoder",
    "DRV-37": "sensor not configured",
    "DRV-38": "late set-points",
    "DRV-39": "drive watchdog",
    "DRV-40": "controller gain",
    "DRV-41": "auto tuning",
    "DRV-42": "extension card",
}
_BOTH: dict[str, tuple[int, ...]] = {
    "DRV-01": (0x1000,),
    "DRV-02": (0x2310,),
    "DRV-03": (0x3210,),
    "DRV-04": (0x3220,),
    "DRV-05": (0x5113,),
    "DRV-06": (0x4210,),
    "DRV-08": (0x6320,),
    "DRV-11": (0x7320,),
    "DRV-18": (0x8110, 0x8111),
    "DRV-19": (0x8120,),
    "DRV-20": (0x8130,),
    "DRV-21": (0x8150,),
    "DRV-22": (0x81FD,),
    "DRV-23": (0x81FE, 0x81FF),
    "DRV-24": (0x8210,),
    "DRV-25": (0x8611,),
}
CODES: dict[str, dict[str, tuple[int, ...]]] = {
    "epos1": {
        **_BOTH,
        "DRV-07": (0x6100,),
        "DRV-12": (0xFF0A,),
        "DRV-13": (0xFF02, 0xFF03),
        "DRV-14": (0xFF01,),
        "DRV-15": (0xFF04,),
        "DRV-16": (0xFF08,),
        "DRV-26": (0xFF06, 0xFF07),
        "DRV-27": (0xFF09,),
        "DRV-28": (0xFF0B,),
    },
    "epos4": {
        **_BOTH,
        "DRV-07": tuple(range(0x6180, 0x61F1, 0x10)),
        "DRV-09": (0x6380,),
        "DRV-10": (0x5280, 0x5281, 0x5282, *range(0x5480, 0x5484), *range(0x1080, 0x1089), 0x1090),
        "DRV-12": (0x7380,),
        "DRV-13": (0x7382, 0x7381),
        "DRV-14": (0x7388,),
        "DRV-15": (0x7389,),
        "DRV-16": (0x738A,),
        "DRV-17": (0x7392,),
        "DRV-26": (0x8A80, 0x8A81),
        "DRV-27": (0x8A82,),
        "DRV-28": (0xFF0B, 0xFF01),
        "DRV-29": (0x8A88, 0x8A8A, 0x8A8B),
        "DRV-34": (0x2320,),
        "DRV-35": (0x4380,),
        "DRV-36": (0x738C, 0x738D),
        "DRV-37": (0x7390, 0x7391),
        "DRV-38": (0x8250,),
        "DRV-39": (0xFF02,),
        "DRV-40": (0xFF10,),
        "DRV-41": tuple(range(0xFF11, 0xFF25)),
        "DRV-42": (0x6080, 0x6081),
    },
}
CODES["epos2"] = {
    **CODES["epos1"],
    "DRV-04": (0x3220, 0x5114),
    "DRV-08": (0x6320, 0xFF0F),
    "DRV-17": (0xFF11, 0xFF12),
    "DRV-38": (0xFF0C,),
    "DRV-40": (0xFF10,),
    "DRV-41": (0xFF0D,),
}
CODES["cia402"] = {id: tuple(code for code, row in ERRORS_402.items() if row == id) for id in ERRORS_402.values()}
"""EMCY error codes by family and row, each row's usual one first.

Sources: firmware specification 2010 of the EPOS, 12.2; public tables that quote the EPOS4's of 2021 and later; CiA 301
and 402.
"""
CODES = {family: dict(sorted(rows.items())) for family, rows in CODES.items()}


class DriveError(Config):
    """An error of the drive."""

    code: Word | None = None
    """EMCY error code; None: the row's first one of the drive's family."""
    heard: bool = True
    """The EMCY frame arrives; without it only the statusword tells."""


class Heat(DriveError):
    """An error, or its cause."""

    ambient_c: Annotated[float, Field(ge=-20, le=200)] | None = None
    """The surroundings of an EPOS4 get so warm, and it reports what it makes of that; None: it only reports."""
    duration_s: Positive | None = None
    """So long; None: until the end."""


class OpenSto(DriveError):
    """An error, or its cause: 0x8A88 comes of inputs that open, and is there for as long as they are."""

    duration_s: Positive | None = None


def families_of(id: str) -> list[str]:
    """Families whose drives can report this row."""
    return [family for family, rows in CODES.items() if id in rows]


def usual_code(id: str, family: str) -> int:
    """The code that a drive of this family reports.

    Raises:
        ValueError: It has none for this row.
    """
    codes = CODES.get(family, {}).get(id)
    if codes is None:
        raise ValueError(f"{id} is no error of a drive of family {family}, only of {' and '.join(families_of(id))}")
    return codes[0]


def known_codes(id: str) -> tuple[int, ...]:
    """The row's codes of any family."""
    return tuple(dict.fromkeys(code for rows in CODES.values() for code in rows.get(id, ())))


def checked_code(id: str, family: str, code: int | None) -> int:
    """The code, or the usual one.

    Raises:
        ValueError: A drive of this family does not have it in this row.
    """
    usual = usual_code(id, family)
    codes = CODES[family][id]
    if code is not None and code not in codes:
        raise ValueError(f"expected {_either(codes)} of a drive of family {family}, found 0x{code:04X}")
    return usual if code is None else code


def _either(codes: tuple[int, ...]) -> str:
    return " or ".join(f"0x{known:04X}" for known in codes)


def _parameters(id: str, base: type[DriveError]) -> type[DriveError]:
    """Parameters of a row: its codes of any family."""
    known = known_codes(id)

    def check(code: int) -> int:
        if code not in known:
            raise ValueError(f"expected {_either(known)}, found 0x{code:04X}")
        return code

    return create_model("Emergency", __base__=base, code=(Annotated[Word, AfterValidator(check)] | None, None))


def _row(id: str) -> Injection:
    def report(stage: Stage, node: str | None, p: DriveError) -> Undo | None:
        drive = stage.drive(node)
        code = checked_code(id, stage.robot.drives[drive.name].family, p.code)
        if code == STO_OPEN and p.heard and isinstance(drive, SimEpos4):
            drive.open_sto(True, stage.now)
            return lambda: drive.open_sto(False, stage.now)
        if code == HOT and isinstance(drive, SimEpos4) and isinstance(p, Heat) and p.ambient_c is not None:
            return _heat(drive, p.ambient_c)
        drive.emergency(code, stage.now, heard=p.heard)
        return None

    bases: dict[str, type[DriveError]] = {"DRV-06": Heat, "DRV-29": OpenSto}
    base = bases.get(id, DriveError)
    return Injection(f"drive reports {TEXTS[id]}", report, Needs.DRIVE, _parameters(id, base), families=families_of(id))


def _heat(drive: SimEpos4, ambient: float) -> Undo:
    before, drive.periphery.ambient = drive.periphery.ambient, ambient

    def cool() -> None:
        drive.periphery.ambient = before

    return cool


EMERGENCY_INJECTIONS = {id: _row(id) for id in TEXTS}
"""By row of the fault table."""
