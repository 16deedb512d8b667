"""What is wrong with gains that a mission wants to try, and what they are as a whole."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from artemis.drive_schema import Drive, Gains, SiGains
from artemis.families.family import GainScale
from artemis.mission.actions import NewGains
from artemis.mission.problems import nearest
from artemis.vehicle import RobotFile

MOST = 10
"""No gain grows by more than this factor in one trial: a zero too many is refused, larger changes go by steps."""
_FIRST = {"current": 0, "velocity": 2, "position": 4}
"""Places in the order of `Family.gains`."""


def check_gains(wanted: Mapping[str, NewGains], robot: RobotFile) -> Iterator[tuple[str, str]]:
    """Drives that cannot try these gains, each with what is wrong."""
    for name, new in wanted.items():
        if name not in robot.drives:
            yield name, f"no such drive{nearest(name, robot.drives, 'drives')}"
            continue
        drive = robot.drives[name]
        title = drive.tables.title
        if (scale := drive.tables.gain_scale) is None:
            yield (
                name,
                f"gains of this kind of drive ({title}) are not tried: tune it with the maker's tool",
            )
        elif drive.known_gains is None:
            key = gains_key(drive)
            yield name, f"the robot file has no {key} of it: write there those that `artemis calibrate gains` shows"
        else:
            yield from ((name, problem) for problem in _beyond(new, drive, drive.known_gains, scale))


def gains_key(drive: Drive) -> str:
    """Key of a drive in the robot file that has its gains."""
    return "si_gains" if drive.tables.gains_in_si else "gains"


def _beyond(new: NewGains, drive: Drive, known: Gains | SiGains, scale: GainScale) -> Iterator[str]:
    in_si = drive.tables.gains_in_si
    for kind, numbers in new.model_dump(exclude_none=True).items():
        presents, units = getattr(known, kind), scale.units[_FIRST[kind] :]
        for letter, number, present, unit in zip("PID", numbers, presents, units, strict=False):
            top = scale.largest * unit if in_si else scale.largest
            if number > top or not (in_si or number.is_integer()):
                expected = f"0 to {top:.0f}" if in_si else f"a whole number of 0 to {top}"
                yield f"{kind} {letter} {number:.7g}: expected {expected} ({drive.tables.title})"
            elif present and number > MOST * present:
                yield f"{kind} {letter} {number:.7g}: at most {MOST} times the present {present} per trial"


def merged(new: NewGains, known: Gains | SiGains) -> Gains | SiGains:
    """All gains of a drive: the new ones, the others as they are known."""
    wanted = new.model_dump(exclude_none=True)
    if isinstance(known, Gains):
        wanted = {kind: tuple(map(int, numbers)) for kind, numbers in wanted.items()}
    return known.model_copy(update=wanted)
