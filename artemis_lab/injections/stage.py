"""What an injection may touch, and what an injection is."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Annotated, Any

from pydantic import Field

from artemis.config import Config
from artemis.drive_states import Nmt
from artemis.sim.epos import SimEpos
from artemis.sim.world import World
from artemis.values import Request
from artemis.vehicle import RobotFile
from artemis_lab.injections.bad_plugins import BadFollower, BadInput, BadLocalizer, FollowerBehaviour
from artemis_lab.injections.failing_disk import FailingDisk
from artemis_lab.injections.fault_bus import FaultBus, Rule

Undo = Callable[[], None]
"""Ends what an injection began."""
Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """A running simulation, as far as things may go wrong in it."""

    robot: RobotFile
    world: World
    bus: FaultBus
    loop: asyncio.AbstractEventLoop
    inputs: Mapping[str, BadInput] = field(default_factory=dict)
    followers: Sequence[BadFollower] = ()
    localizer: BadLocalizer | None = None
    disk: FailingDisk | None = None
    """What the run is recorded on."""
    request: Callable[[Request], None] = lambda request: None
    """Where an operator's requests go."""

    @property
    def now(self) -> float:
        """The loop's time [s]."""
        return self.loop.time()

    def drive(self, node: str | None) -> SimEpos:
        """The simulated drive of this name.

        Raises:
            ValueError: no name where one is needed, or an unknown one.
        """
        names = [drive.name for drive in self.world.nodes]
        if node is None or node not in names:
            raise ValueError(f"needs one of the drives {', '.join(names)}, not {node}")
        return self.world.drive(node)

    def drives(self, node: str | None, role: str | None = None) -> list[SimEpos]:
        """The drive of this name; without one, all (of a role)."""
        if node is not None:
            return [self.drive(node)]
        return [drive for drive in self.world.nodes if role in (None, self.robot.drives[drive.name].role)]

    def node_id(self, node: str | None) -> int | None:
        """The CANopen node of a drive; None for None."""
        return None if node is None else self.robot.drives[node].node_id

    def rule(self, rule: Rule) -> Undo:
        """Let a rule of the bus act."""
        self.bus.add(rule)
        return lambda: self.bus.remove(rule)

    def once_booted(self, drive: SimEpos, act: Callable[[], None]) -> None:
        """Do it now, or as soon as the drive has booted."""
        if drive.nmt is Nmt.INITIALISING:
            self.loop.call_later(1.1 * drive.boot_time, act)
        else:
            act()

    def repeat(self, act: Callable[[], None], period: float, times: int | None = None) -> Undo:
        """Do it now, and every `period` [s] until it is undone, or was done so many times."""
        left, ended = times, False

        def once() -> None:
            nonlocal left
            if ended or left == 0:
                return
            act()
            left = None if left is None else left - 1
            self.loop.call_later(period, once)

        def end() -> None:
            nonlocal ended
            ended = True

        once()
        return end


class Needs(Enum):
    """What an injection happens to."""

    NOTHING = "no drive"
    SOME_DRIVE = "a drive, or all without a name"
    DRIVE = "a drive"
    TRACTION = "a traction drive"
    STEERING = "a steering drive"


class Nothing(Config):
    """No parameters."""


class Lasting(Config):
    """Something that can end."""

    duration_s: Positive | None = None
    """Then it ends; None: never."""


def together(undos: Sequence[Undo]) -> Undo:
    """All of them."""

    def undo_all() -> None:
        for undo in undos:
            undo()

    return undo_all


@dataclass(frozen=True, slots=True)
class Injection:
    """How one row of the fault table is made to happen."""

    text: str
    """What happens, in a few words."""
    act: Callable[[Stage, str | None, Any], Undo | None]
    """Makes it happen, to a drive of that name, with `parameters`; returns how to end it, if it can end."""
    needs: Needs = Needs.NOTHING
    parameters: type[Config] = Nothing
    families: Collection[str] | None = None
    """Of drives that it can happen to; None: all."""
    behaviour: Callable[[Any], FollowerBehaviour] | None = None
    """For faults of a follower: how it behaves, with `parameters`."""
