"""The simulated drive for a drive of a robot file: which class each family has."""

from __future__ import annotations

from artemis.drive_schema import Drive
from artemis.sim.axis import Axis
from artemis.sim.cia402 import SimCia402
from artemis.sim.epos import SimEpos
from artemis.sim.epos2 import SimEpos2
from artemis.sim.epos4 import SimEpos4
from artemis.sim.epos_settings import SimSettings

NODES: dict[str, type[SimEpos]] = {"epos1": SimEpos, "epos2": SimEpos2, "epos4": SimEpos4, "cia402": SimCia402}
"""By the key `family` of a drive."""


def simulated_drive(drive: Drive, axis: Axis, *, name: str, settings: SimSettings | None = None) -> SimEpos:
    """A simulated drive of its family, without power.

    Args:
        drive: As the robot file has it.
        axis: What it moves.
        name: Its name there.
        settings: How it behaves.
    """
    return NODES[drive.family](drive, axis, name=name, settings=settings)
