"""All that the monitor is given of one run, and what a broken invariant is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from artemis.campaign.monitor.journal_reader import Journal
from artemis.campaign.monitor.wire import Wire
from artemis.campaign.witness import Heard, Look
from artemis.vehicle import Robot


class Violation(NamedTuple):
    """An invariant that did not hold."""

    invariant: str
    time: float
    """Run time [s]."""
    text: str


class Injected(NamedTuple):
    """A fault that was made to happen."""

    time: float
    """When [s]."""
    id: str
    node: str
    """Empty: no single drive."""
    options: dict[str, Any]

    @property
    def until(self) -> float:
        """When it ended [s]; infinite if it did not."""
        return self.time + float(self.options.get("duration_s") or "inf")


class Stick(NamedTuple):
    """What a hand does with the stick from a time on."""

    time: float
    """[s]."""
    held: bool
    """The enable button is held."""
    neutral: bool
    """The stick rests, and the button is released."""


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """One run from outside. Times are seconds of the run."""

    robot: Robot
    """The robot file: geometry, limits, node ids."""
    tick: float
    """Period of the host's ticks [s]."""
    heard: Sequence[Heard]
    looks: Sequence[Look]
    journal: Journal
    injected: Sequence[Injected]
    operator: Sequence[tuple[float, str]]
    """What a person did, and when."""
    status: int | None
    """Exit status; None: the program failed or was killed."""
    stick: Sequence[Stick] = ()
    """Rows of the scripted stick, if the mission has one."""

    @cached_property
    def wire(self) -> Wire:
        """The frames, read."""
        nodes = [drive.node_id for drive in self.robot.drives.values()]
        return Wire(self.heard, nodes, self.robot.host_node_id)

    def node(self, role: str, side: str) -> int:
        """Node id of a drive."""
        return self.robot.drive_at(role, side)[1].node_id

    def acts(self, what: str) -> list[float]:
        """When a person did this."""
        return [time for time, did in self.operator if did == what]

    def active(self, time: float, *ids: str, after: float = 0.0) -> bool:
        """Whether one of these injections is there, or ended less than `after` [s] ago."""
        return any(i.id in ids and i.time <= time <= i.until + after for i in self.injected)
