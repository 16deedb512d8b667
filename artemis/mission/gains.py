"""What is wrong with gains that a mission wants to try, and what they are as a whole."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from artemis.mission.problems import nearest
from artemis.mission.schema import NewGains
from artemis.vehicle import Gains, Robot


def check_gains(wanted: Mapping[str, NewGains], robot: Robot) -> Iterator[tuple[str, str]]:
    """Drives that cannot try gains, each with what is wrong."""
    for name in wanted:
        if name not in robot.drives:
            yield name, f"no such drive{nearest(name, robot.drives, 'drives')}"
        elif robot.drives[name].gains is None:
            yield name, "the robot file has no gains of it: write there those that `artemis calibrate gains` shows"


def merged(new: NewGains, known: Gains) -> Gains:
    """All gains of a drive: the new ones, the others as they are known."""
    return known.model_copy(update=new.model_dump(exclude_none=True))
