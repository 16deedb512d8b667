"""All that the monitor is given of one run, and what a broken invariant is."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import inf
from typing import Any, NamedTuple

from artemis.vehicle import RobotFile
from artemis_lab.campaign.monitor.journal_reader import ReadJournal
from artemis_lab.campaign.monitor.wire import TARGET_VELOCITY, SetPoint, Wire, WriteRequest
from artemis_lab.campaign.witness import SIDES, Heard, Look

LATE_SCANS = "LAS-07"
"""Its `seconds` are those of the scans: the process goes on."""


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
        return self.time + float(self.options.get("duration_s") or inf)

    @property
    def standstill(self) -> float:
        """How long the whole process does nothing by it [s], at most: plugins are late up to three times."""
        times = self.options.get("times") or (1 if self.id.startswith("SYS") else 3)
        return float(self.options["seconds"] * times) if "seconds" in self.options and self.id != LATE_SCANS else 0.0

    @property
    def is_counted(self) -> bool:
        """It hits some frames, now or later: nobody knows which, or whether they matter."""
        return bool(self.options.get("count") or self.options.get("probability"))


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

    robot: RobotFile
    """The robot file: geometry, limits, node ids."""
    tick: float
    """Period of the host's ticks [s]."""
    heard: Sequence[Heard]
    looks: Sequence[Look]
    journal: ReadJournal
    injected: Sequence[Injected]
    operator: Sequence[tuple[float, str]]
    """What a person did, and when."""
    status: int | None
    """Exit status; None: the program failed or was killed."""
    stick: Sequence[Stick] = ()
    """Rows of the scripted stick, if the mission has one."""
    world: Mapping[str, Any] = field(default_factory=dict)
    """What stands and walks around a robot with scanners, as in a mission file."""
    rules: Mapping[str, Any] = field(default_factory=dict)
    """What such a mission says of obstacles."""

    @cached_property
    def wire(self) -> Wire:
        """The frames, read."""
        nodes = [drive.node_id for drive in self.robot.drives.values()]
        return Wire(self.heard, nodes, self.robot.host_node_id)

    @cached_property
    def targets(self) -> dict[str, list[tuple[float, float]]]:
        """Every target speed that was sent to each side's driven wheel: time [s] and m/s, forward positive."""
        found: dict[str, list[tuple[float, float]]] = {}
        for side in SIDES:
            scale, sent = self.metres_per_unit(side), found.setdefault(side, [])
            for event in self.wire.nodes[self.node("traction", side)].events:
                if isinstance(event, SetPoint):
                    sent.append((event.time, event.target * scale))
                elif isinstance(event, WriteRequest) and event.object == TARGET_VELOCITY:
                    sent.append((event.time, (event.value - (event.value >> 31 << 32)) * scale))
        return found

    def metres_per_unit(self, side: str) -> float:
        """Rolling speed of a driven wheel [m/s] per unit of velocity of its drive, signed."""
        _, drive = self.robot.drive_at("traction", side)
        scale = self.robot.metres_per_count(side) * drive.sensor.counts_per_turn / 60.0
        if drive.cia402 is not None:
            scale /= drive.cia402.velocity_units_per_rpm
        return -scale if drive.mirrored else scale

    def node(self, role: str, side: str) -> int:
        """Node id of a drive."""
        return self.robot.drive_at(role, side)[1].node_id

    @cached_property
    def _look_times(self) -> list[float]:
        return [look.time for look in self.looks]

    def looks_between(self, begin: float, end: float) -> Sequence[Look]:
        """What was seen of the machine in this time [s]."""
        return self.looks[bisect_left(self._look_times, begin) : bisect_right(self._look_times, end)]

    def look_at(self, time: float) -> Look | None:
        """The machine as it was last seen."""
        number = bisect_right(self._look_times, time)
        return self.looks[number - 1] if number else None

    def beat_before(self, time: float) -> float:
        """When the host's heartbeat was heard last [s]; minus infinity: never."""
        number = bisect_left(self.wire.beats, time)
        return self.wire.beats[number - 1] if number else -inf

    def acts(self, what: str) -> list[float]:
        """When a person did this."""
        return [time for time, did in self.operator if did == what]

    def active(self, time: float, *ids: str, after: float = 0.0) -> bool:
        """Whether one of these injections is there, or ended less than `after` [s] ago."""
        return any(i.id in ids and i.time <= time <= i.until + after for i in self.injected)
