"""What makes the faults of a mission's `simulation.faults` happen: found by its entry point, no part of artemis."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from artemis.config import Config
    from artemis.devices.can_bus import FrameBus
    from artemis.mission.schema import InjectedFault
    from artemis.plugins.contracts import InputDevice, Localizer
    from artemis.recording.disk import Disk
    from artemis.recording.journal import Entry
    from artemis.sim.world import World
    from artemis.states.plan import Step
    from artemis.values import Request
    from artemis.vehicle import RobotFile

GROUP = "artemis.fault_injection"
"""Entry points of injectors."""
Problem = tuple[str, str]
"""Key of a fault, and what is wrong with it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulated:
    """A simulated run that is about to begin on the running loop, as far as things may go wrong in it."""

    robot: RobotFile
    world: World
    bus: FrameBus
    """As the injector made it."""
    disk: Disk
    inputs: dict[str, InputDevice]
    """By their names in the mission; others may be put in their places."""
    localizer: Localizer | None
    """As the injector made it."""
    request: Callable[[Request], None]
    """Where an operator's requests go."""


class FaultInjector(Protocol):
    """Makes things go wrong in a simulated run, on purpose and repeatably."""

    def ids(self) -> Collection[str]:
        """Rows of the fault table that it can make happen."""

    def parameters(self, id: str) -> type[Config] | None:
        """The keys of a fault beside `at_s`, `inject` and `node`; None: it cannot make it happen."""

    def problems(
        self, fault: InjectedFault, robot: RobotFile | None, inputs: Collection[str], follows: bool
    ) -> Iterator[Problem]:
        """What is wrong with a fault, but for its parameters' own values.

        Args:
            fault: As the mission has it.
            robot: Whose drives it may name; None: not known.
            inputs: The mission's inputs.
            follows: A follower or a behaviour does one of the mission's steps.
        """

    def failing_plugins(self, steps: Sequence[Step], faults: Sequence[InjectedFault]) -> tuple[Step, ...]:
        """The steps of a plan; those that drive misbehave at its run time as asked for, also in a replay."""

    def failing_disk(self, folder: FilePath) -> Disk:
        """A disk that can be made to fail, with the room that `folder` has."""

    def failing_bus(self, bus: FrameBus, seed: int) -> FrameBus:
        """The bus, but it can be made to fail; `seed` of all that is random in that."""

    def failing_localizer(self, localizer: Localizer) -> Localizer:
        """The localizer, but it can be made to misbehave."""

    def begin(self, run: Simulated, faults: Sequence[InjectedFault], note: Callable[[Entry], None]) -> None:
        """Have each fault happen at its time, counted from now, and noted for the journal; those at 0 happen here."""


def installed_injector() -> FaultInjector | None:
    """The injector that is installed; None: there is none."""
    for point in sorted(entry_points(group=GROUP)):
        with suppress(ModuleNotFoundError):
            injector: FaultInjector = point.load()
            return injector
    return None
