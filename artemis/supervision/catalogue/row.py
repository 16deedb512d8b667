"""What a row of the fault table says, and the words in which rows are written."""

from __future__ import annotations

from enum import Enum
from math import inf
from typing import NamedTuple

from artemis.axles import OWN_SIDES, AbsoluteEncoder, Potentiometers
from artemis.values import Severity
from artemis.vehicle import RobotFile

WARN, LIMIT, S2, S1, S0 = (
    Severity.WARN,
    Severity.LIMIT,
    Severity.CONTROLLED_STOP,
    Severity.QUICK_STOP,
    Severity.OFF,
)
SHORT = {WARN: "W", LIMIT: "L", S2: "S2", S1: "S1", S0: "S0"}
"""How reactions are written in tables and missions."""


class Kind(Enum):
    """How a fault is forgotten."""

    ITSELF = "by itself"
    """Once its cause is gone."""
    AUTOMATIC = "automatic"
    """By artemis, a limited number of times, when the robot stands and the cause is gone; then acknowledged."""
    ACKNOWLEDGED = "acknowledge"
    """By a person, when the cause is gone."""
    CALIBRATED = "acknowledge, align again"
    """Acknowledged; where the wheels stand is measured again before motion."""
    CONFIGURED = "acknowledge, configure again"
    """Acknowledged; the node is reset and configured from scratch."""
    NEVER = "not in this run"


class Recovery(NamedTuple):
    """How a fault is forgotten, and how often."""

    kind: Kind
    times: int = 0
    """Automatic recoveries in `window` [s]."""
    window: float = inf
    final: int = 0
    """The n-th occurrence on one device in `window` is the last: then it is NEVER (0: none)."""
    reset: str = ""
    """NMT reset that the drive needs before: `communication` or `node`."""
    unless: tuple[str, ...] = ()
    """Not automatic while one of these is there, too."""
    settle: float = 0.0
    """The cause must have been gone for so long [s]."""


ITSELF, K, X = Recovery(Kind.ITSELF, settle=0.5), Recovery(Kind.ACKNOWLEDGED), Recovery(Kind.NEVER)
CAL = Recovery(Kind.CALIBRATED)
BOOT = Recovery(Kind.CONFIGURED, reset="node")
MINUTE = 60.0


def automatic(times: int, window: float = inf, *, unless: tuple[str, ...] = ()) -> Recovery:
    """At most `times` in `window` [s] (in the run, if no window is given)."""
    return Recovery(Kind.AUTOMATIC, times, window, unless=unless, settle=0.5)


class Threshold(NamedTuple):
    """A measured value above `over` for as long as `hold` [s] calls for `severity`."""

    severity: Severity
    over: float = 0.0
    hold: float = 0.0


class Found(Enum):
    """Where a fault is noticed."""

    EMERGENCY = "EMCY"
    MEASURED = "measured by the supervisor at every tick"
    MODE = "found by the mode that runs"
    BRING_UP = "found while the drives are brought up"
    EDGE = "found where artemis meets devices, plugins and files"
    LOADING = "refused before the run"
    COMMAND = "found by a command that drives nothing"
    ELSEWHERE = "shows as another row"
    DESIGN = "has no effect, by design"
    ABSENT = "not built"


class Requirement(Enum):
    """What a robot must have for a row to be noticed at all."""

    NOTHING = ""
    STEERING_MOTORS = "a steering motor at each front wheel"
    TRACTION_MOTORS = "a traction motor at each driven wheel"
    POTENTIOMETERS = "potentiometers of the steering"
    KEPT_CALIBRATION = "potentiometers of the steering, and drives that can keep their calibration"
    ANGLE_SENSORS = "potentiometers or absolute encoders of the steering"
    SEARCH = "a steering whose angle no potentiometers measure"
    STEERING_CURRENT = "steering drives whose motor current is measured"
    VOLTAGE = "a `battery` in the robot file, and a drive that measures its voltage"
    SCANNER = "a laser scanner"


class Row(NamedTuple):
    """One fault: what it is, how it is noticed, what follows, how it goes on."""

    name: str
    found: Found
    severity: Severity = Severity.NONE
    recovery: Recovery = K
    text: str = ""
    """For the operator, after the device's name."""
    advice: str = ""
    """What to look for or do next."""
    to_fault: bool = False
    """Leads to the mode `fault`; else a stop leads to `quickstop`."""
    within: float = 0.02
    """Worst case from the cause to the reaction [s]; 0 before a run."""
    stages: tuple[Threshold, ...] = ()
    """Of a measured row: limits of its measure, mildest first."""
    of: str = ""
    """What a measured row's limits are limits of, with the unit."""
    shows_as: tuple[str, ...] = ()
    """Rows as which it may be seen, or is where it has no mark of its own."""
    reason: str = ""
    """Why it has no effect, or what it would need to be noticed."""
    needs: Requirement = Requirement.NOTHING
    """Of a robot."""

    def is_missed_by(self, robot: RobotFile) -> bool:
        """Whether the robot has not what the row needs: it is never noticed there."""
        match self.needs:
            case Requirement.STEERING_MOTORS:
                return robot.sides("steering") != OWN_SIDES
            case Requirement.TRACTION_MOTORS:
                return robot.sides("traction") != OWN_SIDES
            case Requirement.POTENTIOMETERS:
                return not robot.has_potentiometers
            case Requirement.KEPT_CALIBRATION:
                steering = [drive for drive in robot.drives.values() if drive.role == "steering"]
                return not (robot.has_potentiometers and any(drive.tables.memory for drive in steering))
            case Requirement.ANGLE_SENSORS:
                return not isinstance(robot.angle_source("left"), Potentiometers | AbsoluteEncoder)
            case Requirement.SEARCH:
                return robot.has_potentiometers
            case Requirement.STEERING_CURRENT:
                return all(drive.tables.current is None for drive in robot.drives.values() if drive.role == "steering")
            case Requirement.VOLTAGE:
                return robot.battery is None or robot.supply_source is None
            case Requirement.SCANNER:
                return not robot.scanners
        return False
