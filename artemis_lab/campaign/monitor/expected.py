"""What the monitor expects of each injected fault: as what it shows, how soon, and when at all.

Written from the fault catalogue's requirements, not from the table that runs: that table is under test.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from artemis_lab.campaign.besides import SPARE_INPUT
from artemis_lab.campaign.monitor.evidence import Evidence, Injected


class When(Enum):
    """In which situation the fault has to be noticed."""

    WATCHED = "in every mode with the drives in use"
    ENABLED = "while the traction drives are enabled"
    MOVING = "while both driven wheels are commanded to move"
    BY_HAND = "while driving by hand"
    FOLLOWING = "while a follower or a behaviour drives"
    FROM_START = "there from the beginning: before the robot is ready"
    HARMLESS = "never: nothing may come of it"
    UNTOLD = "it depends"


class Expected(NamedTuple):
    """How one injected fault shows."""

    when: When
    within: float = 0.02
    """Worst case [s]; the period of a tick comes on top."""
    shows: tuple[str, ...] = ()
    """Any of these rows, before any other."""
    stop: str = "S1"
    """Reaction: S1 (quick stop), S2 (controlled stop), or nothing for milder ones."""
    coasts: bool = False
    """A drive cuts its power: its wheel rolls out."""


W, E, M, H, F, START = When.WATCHED, When.ENABLED, When.MOVING, When.BY_HAND, When.FOLLOWING, When.FROM_START
HARMLESS, UNTOLD = Expected(When.HARMLESS, stop=""), Expected(When.UNTOLD, stop="")
_CUT = ("01", "02", "03", "04", "05", "06", "07", "08", "11", "12", "13", "14", "15", "28", "31")
"""Drive errors after which the drive is off at once (EPOS firmware specification 2010, 12.2)."""
_CUT_4 = ("09", "10", "17", "29", "34", "35", "36", "37", "39", "41", "42")
"""Those that only later generations have."""
_BRAKED = ("16", "18", "19", "20", "21", "22", "23", "24", "25", "26", "27")
"""Those after which it stops by its own ramp first."""
UNHEARD = Expected(W, 0.1, ("COM-01",), coasts=True)
"""Any drive error whose EMCY is lost."""
NO_REACTION = "DRV-21"
"""For a COB-ID collision the EPOS firmware specification 2010 (12.2) names no reaction: only its EMCY tells."""
UNKEPT = "COM-10"
"""Unless another object is named it drops writes of 0x6085, which steering drives are left with from the factory."""
STALL = Expected(W, 0.02, ("SYS-03", "DRV-20", "SYS-01", "COM-31", "PLG-03", "PTH-09"), stop="S2")
"""The computer does nothing for a while; noticed as soon as it goes on."""
LATE = 0.06
"""One tick so much too late [s] has to be noticed."""
OFTEN_LATE = 0.02
"""Some in a row so much too late are noticed, too."""
BLOCKED = 1.15
"""Wheels that do not turn are noticed in 1 s (RUN-04); the injection brakes both from any speed in 0.15 s."""
LOST = ("COM-22",)
OFTEN_DAMAGED = 0.5
"""Of so large a share of damaged telegrams some are among the first ones."""
SO_LATE = 0.22
"""Scans that are at once so much later [s] leave a gap that has to be noticed."""

EXPECTED: dict[str, Expected] = {
    **{f"DRV-{number}": Expected(W, 0.02, (f"DRV-{number}",), coasts=True) for number in (*_CUT, *_CUT_4)},
    **{f"DRV-{number}": Expected(W, 0.02, (f"DRV-{number}",)) for number in (*_BRAKED, "38", "40")},
    "DRV-30": HARMLESS,
    "DRV-32": Expected(W, 0.02, ("DRV-32",)),
    "DRV-33": Expected(W, 0.04, ("DRV-02", "DRV-33"), coasts=True),
    "COM-01": Expected(W, 0.1, ("COM-01",), coasts=True),
    "COM-02": Expected(E, 0.1, ("COM-02", "RUN-06"), coasts=True),
    "COM-03": Expected(START, shows=("COM-03",)),
    "COM-04": Expected(W, 0.1, ("COM-04",)),
    "COM-05": Expected(W, 0.1, ("COM-05",)),
    "COM-06": UNTOLD,
    "COM-07": Expected(START, shows=("COM-07",)),
    "COM-08": Expected(START, shows=("COM-08",)),
    "COM-09": UNTOLD,
    "COM-10": Expected(START, shows=("COM-10",)),
    "COM-11": Expected(W, 0.1, ("COM-11",)),
    "COM-12": UNTOLD,
    "COM-13": HARMLESS,
    "COM-14": Expected(W, 1.02, ("COM-14",), stop="S2"),
    "COM-15": Expected(W, 0.12, ("COM-15", "COM-11", "COM-16")),
    "COM-16": UNTOLD,  # only if the overtaken frame is TxPDO 1
    "COM-17": Expected(W, 0.02, ("COM-17",), coasts=True),
    "COM-18": Expected(W, 0.02, ("COM-17", "COM-18")),
    "COM-19": UNTOLD,
    "COM-20": Expected(W, 0.1, ("COM-20",), stop=""),
    "COM-21": Expected(W, 0.1, LOST),
    "COM-22": Expected(W, 0.1, LOST),
    "COM-23": Expected(W, 0.1, LOST),
    "COM-24": Expected(W, 0.06, LOST),
    "COM-25": UNTOLD,
    "COM-26": Expected(W, 0.1, ("COM-26",), coasts=True),
    "COM-27": Expected(W, 0.27, ("COM-27", "COM-11")),
    "COM-28": Expected(W, 0.27, ("COM-28",)),
    "COM-29": Expected(W, 0.12, ("COM-29",)),
    "COM-30": Expected(START, shows=("COM-30",)),
    "COM-31": STALL,
    "COM-32": Expected(START, shows=("COM-32",)),
    "COM-33": Expected(START, shows=("COM-33", "COM-08")),
    "COM-34": UNTOLD,
    "RUN-01": Expected(M, 0.2, ("RUN-01",)),  # of which the wheel needs 0.06 s to run away
    "RUN-02": UNTOLD,
    "RUN-03": UNTOLD,
    "RUN-04": Expected(M, 1.0, ("RUN-04", "RUN-05", "DRV-02", "DRV-25"), stop="S2"),
    "RUN-05": Expected(M, 0.35, ("RUN-01", "RUN-05"), stop=""),
    "RUN-06": Expected(M, 0.1, ("RUN-06", "COM-02"), coasts=True),
    "RUN-09": UNTOLD,
    "RUN-10": UNTOLD,
    "RUN-11": Expected(F, 0.02, ("RUN-11",), stop="S2"),
    "RUN-12": Expected(F, 1.04, ("RUN-12", "PTH-06"), stop=""),
    "STE-01": UNTOLD,
    "STE-02": UNTOLD,
    "STE-03": Expected(W, 0.12, ("STE-03",)),
    "STE-04": Expected(W, 0.06, ("STE-04",)),
    "STE-05": Expected(E, 0.22, ("STE-05",)),
    "STE-06": UNTOLD,
    "STE-07": UNTOLD,
    "CAL-01": Expected(START, shows=("CAL-01", "STE-01", "STE-02", "DRV-25", "DRV-02")),
    "CAL-02": Expected(START, shows=("CAL-02",)),
    "PTH-06": UNTOLD,
    "PTH-07": Expected(M, BLOCKED, ("RUN-04", "PTH-07", "DRV-02", "DRV-25"), stop="S2"),
    "PTH-08": UNTOLD,
    "PTH-09": Expected(F, 0.08, ("PTH-09", "PLG-03"), stop="S2"),
    "INP-01": Expected(H, 0.06, ("INP-01",), stop="S2"),
    "INP-03": Expected(H, 0.17, ("INP-03",), stop="S2"),
    "INP-04": Expected(H, 0.17, ("INP-03",), stop="S2"),
    "INP-05": Expected(H, 0.17, ("INP-03",), stop="S2"),
    "INP-06": Expected(H, 1.02, ("INP-06",), stop="S2"),
    "INP-07": UNTOLD,
    "INP-08": UNTOLD,
    "INP-09": HARMLESS,
    "INP-10": HARMLESS,
    "INP-11": HARMLESS,
    "INP-12": UNTOLD,
    "PLG-02": Expected(F, 0.02, ("PLG-02",), stop="S2"),
    "PLG-03": Expected(F, 0.08, ("PTH-09", "PLG-03"), stop="S2"),
    "PLG-04": STALL._replace(when=F),
    "PLG-06": Expected(F, 0.02, ("PLG-06", "RUN-11"), stop="S2"),
    "PWR-01": UNTOLD,
    "PWR-02": UNTOLD,
    "PWR-03": UNTOLD,
    "SYS-01": STALL,
    "SYS-03": STALL,
    "SYS-04": UNTOLD,
    "SYS-07": STALL,
    "SYS-09": Expected(W, 0.12, ("COM-29",), coasts=True),
    "SYS-10": UNTOLD,
    "DSK-02": UNTOLD,
    "DSK-05": UNTOLD,
    "EST-01": Expected(W, 0.04, ("DRV-04", "DRV-29", "EST-01"), coasts=True),
    "EST-03": Expected(W, 0.04, ("DRV-04", "DRV-29", "EST-01"), coasts=True),
    "EST-04": Expected(W, 0.04, ("DRV-04", "DRV-29", "EST-01"), coasts=True),
    "LAS-01": Expected(W, 0.19, ("LAS-01",), stop="S2"),
    "LAS-02": Expected(W, 0.17, ("LAS-02",), stop="S2"),
    "LAS-03": Expected(W, 0.27, ("LAS-03", "LAS-01"), stop=""),
    "LAS-04": HARMLESS,
    "LAS-05": Expected(W, 0.2, ("LAS-05",), stop="S2"),
    "LAS-06": Expected(W, 0.2, ("LAS-06",), stop=""),  # S2 after a second
    "LAS-07": Expected(W, 0.25, ("LAS-01",), stop="S2"),
    "OPR-01": HARMLESS,
    "OPR-02": HARMLESS,
}
OF_EPOS4: dict[str, Expected] = {
    "COM-26": Expected(W, 0.1, ("COM-26", "COM-11"), coasts=True),  # it boots so long that it is missed before
    "COM-27": Expected(W, 0.27, ("COM-27", "COM-11", "DRV-38")),  # it misses its set-points before
    "DRV-16": Expected(W, 0.02, ("DRV-16",), coasts=True),  # the first generation brakes
}
"""What is another matter with an EPOS4."""


def expectation(injected: Injected, e: Evidence) -> Expected:
    """What to expect of this one."""
    is_epos4 = any(drive.family == "epos4" for drive in e.robot.drives.values())
    table = OF_EPOS4 if is_epos4 and injected.id in OF_EPOS4 else EXPECTED
    expected, tick = table[injected.id], e.tick
    if injected.options.get("input") == SPARE_INPUT:
        return UNTOLD  # the robot may drive without it
    if injected.options.get("heard") is False:
        return UNTOLD if injected.id == NO_REACTION else UNHEARD
    if injected.id == UNKEPT and injected.node.startswith("steer") and "index" not in injected.options:
        return UNTOLD
    if injected.id.startswith("LAS"):
        return _of_scanner(injected, expected)
    seconds = injected.options.get("seconds")
    if seconds is None or (expected.when is not When.FOLLOWING and expected.shows != STALL.shows):
        return expected
    if seconds > LATE + tick:
        return STALL._replace(when=expected.when, within=STALL.within + seconds)
    if expected.shows == STALL.shows:
        return UNTOLD
    behind = max(0.0, seconds - tick)  # three late answers in a row make the ticks late, too
    shows = (*expected.shows, "SYS-01") if behind > OFTEN_LATE else expected.shows
    return expected._replace(within=expected.within + 3 * behind, shows=shows)


def _of_scanner(injected: Injected, expected: Expected) -> Expected:
    """A laser scanner's: little of it shows late or never, and the robot need not stop."""
    options = injected.options
    if injected.id == "LAS-03" and options.get("share", 0.8) < OFTEN_DAMAGED:
        return UNTOLD
    if injected.id == "LAS-05" and options.get("status") == "dirty":
        return expected._replace(stop="")
    if injected.id == "LAS-06" and "sector_deg" in options:
        return UNTOLD
    if injected.id == "LAS-07" and (options.get("seconds", 0.3) < SO_LATE or options.get("within_s")):
        return UNTOLD
    return expected
