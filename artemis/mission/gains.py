"""What is wrong with gains that a mission wants to try, and what they are as a whole."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from artemis.drive_schema import Gains
from artemis.mission.actions import NewGains
from artemis.mission.problems import nearest
from artemis.vehicle import RobotFile

MOST = 10
"""No gain grows by more than this factor in one trial: a zero too many is refused, larger changes go by steps."""


def check_gains(wanted: Mapping[str, NewGains], robot: RobotFile) -> Iterator[tuple[str, str]]:
    """Drives that cannot try these gains, each with what is wrong."""
    for name, new in wanted.items():
        if name not in robot.drives:
            yield name, f"no such drive{nearest(name, robot.drives, 'drives')}"
        elif (family := robot.drives[name].tables).gains_in_si or not family.gains:
            yield name, f"gains of this kind of drive ({family.title}) are not tried: tune it with the maker's tool"
        elif (known := robot.drives[name].gains) is None:
            yield name, "the robot file has no gains of it: write there those that `artemis calibrate gains` shows"
        else:
            yield from ((name, problem) for problem in _too_large(new, known))


def _too_large(new: NewGains, known: Gains) -> Iterator[str]:
    for kind, numbers in new.model_dump(exclude_none=True).items():
        for letter, number, present in zip("PID", numbers, getattr(known, kind), strict=False):
            if present and number > MOST * present:
                yield f"{kind} {letter} {number}: at most {MOST} times the present {present} per trial"


def merged(new: NewGains, known: Gains) -> Gains:
    """All gains of a drive: the new ones, the others as they are known."""
    return known.model_copy(update=new.model_dump(exclude_none=True))
