"""Every fault that can be made to happen in a simulated run, by its row in the fault table; and why others cannot."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Protocol

from artemis.devices.can_bus import FrameBus
from artemis.plugins.contracts import InputDevice
from artemis.recording.disk import Disk
from artemis.recording.journal import Entry
from artemis.sim.world import World
from artemis.states.mode import Step, with_followers
from artemis.testing.bad_plugins import BadFollower, BadInput, FollowerBehaviour
from artemis.testing.bus_injections import BUS_INJECTIONS
from artemis.testing.drive_injections import DRIVE_INJECTIONS
from artemis.testing.failing_disk import FailingDisk
from artemis.testing.fault_bus import FaultBus
from artemis.testing.host_injections import HOST_INJECTIONS
from artemis.testing.motion_injections import MOTION_INJECTIONS
from artemis.testing.stage import Injection, Stage, Undo
from artemis.values import Request
from artemis.vehicle import Robot

INJECTIONS: dict[str, Injection] = dict(
    sorted({**DRIVE_INJECTIONS, **BUS_INJECTIONS, **MOTION_INJECTIONS, **HOST_INJECTIONS}.items())
)
"""By row of the fault table."""

_EPOS4 = "only an EPOS4 knows it"
_FILE = "is found in a file, before a run"
_NETWORK = "needs an input over the network"
_LASER = "needs a laser scanner"
_LOCALISATION = "needs a localisation"
_PROCESS = "would end the simulated drives with it: they share the process"
_DEVICE = "needs a device: `artemis.testing.fake_hid`"

NOT_INJECTED: dict[str, str] = {
    **dict.fromkeys(("DRV-09", "DRV-10", "DRV-17", "DRV-29"), _EPOS4),
    "RUN-07": _LOCALISATION,
    "RUN-08": "COM-26 makes it happen, where the robot moves",
    "INP-02": _DEVICE,
    "INP-13": "another input drives in another step, which begins at standstill",
    "INP-14": _DEVICE,
    "INP-15": _DEVICE,
    "INP-16": "force feedback is not used",
    **{f"NET-{number:02}": _NETWORK for number in range(1, 13)},
    **{f"LAS-{number:02}": _LASER for number in range(1, 9)},
    **{f"LOC-{number:02}": _LOCALISATION for number in range(1, 6)},
    **{f"PTH-{number:02}": _FILE for number in range(1, 5)},
    "PTH-05": "a path begins where the robot stands",
    **{f"MIS-{number:02}": _FILE for number in range(1, 8)},
    "PLG-01": "a plugin is made before a run",
    "PLG-07": "a plugin is never given the bus",
    "SYS-02": "nothing in a run reads the wall clock",
    "SYS-06": _PROCESS,
    "SYS-08": _PROCESS,
    "SYS-11": "no common way to read a computer's temperature",
    "DSK-01": "is looked for before a run",
    "DSK-03": "in virtual time a recording waits for its disk, however slow",
    "DSK-04": "is found when a journal is read",
    "EST-02": "needs an input pair",
    "OPR-03": "happens by itself when nobody acts",
}
"""Rows that no injection can make happen, each with the reason."""


def inject(stage: Stage, id: str, node: str | None = None, **parameters: Any) -> Undo:  # noqa: ANN401 (of any row)
    """Make the fault of row `id` happen now; what it returns ends it (where it can end).

    Raises:
        KeyError: no such injection.
        ValidationError: wrong parameters.
        ValueError: no such drive or input, or none where one is needed.
    """
    injection = INJECTIONS[id]
    checked = injection.parameters.model_validate(parameters)
    stage.bus.catch_up()
    undo = injection.act(stage, node, checked)
    duration = getattr(checked, "duration_s", None)
    if undo is None:
        return lambda: None
    if duration is not None:
        stage.loop.call_later(duration, undo)
    return undo


class Order(Protocol):
    """One entry of a mission's `simulation.faults`."""

    @property
    def at_s(self) -> float:
        """Run time [s]."""

    @property
    def inject(self) -> str:
        """Row of the fault table."""

    @property
    def node(self) -> str | None:
        """Drive."""

    @property
    def options(self) -> Mapping[str, Any]:
        """Parameters of the row."""


def stage_of(
    robot: Robot,
    world: World,
    bus: FrameBus,
    inputs: dict[str, InputDevice],
    disk: Disk,
    request: Callable[[Request], None],
) -> Stage:
    """The stage of a run that is about to begin on the running loop; its inputs are wrapped where they lie."""
    assert isinstance(bus, FaultBus)
    bad = {name: BadInput(device) for name, device in inputs.items()}
    inputs.update(bad)
    return Stage(
        robot=robot,
        world=world,
        bus=bus,
        loop=asyncio.get_running_loop(),
        inputs=bad,
        disk=disk if isinstance(disk, FailingDisk) else None,
        request=request,
    )


def schedule(stage: Stage, orders: Iterable[Order], note: Callable[[Entry], None]) -> None:
    """Make each fault happen at its time, counted from now; those at 0 before this returns.

    Each is noted as a journal entry when it happens. A follower's faults are otherwise its agenda's business.
    """
    start = stage.now

    def do(order: Order) -> None:
        if _of_follower(order) is None:
            inject(stage, order.inject, order.node, **order.options)
        text = " ".join(filter(None, (order.inject, order.node))) + f": {INJECTIONS[order.inject].text}"
        data = {"id": order.inject, "device": order.node or "", **order.options}
        note(Entry(time=stage.now - start, kind="injected", text=text, data=data))

    for order in orders:
        if order.at_s:
            stage.loop.call_later(order.at_s, do, order)
        else:
            do(order)


def agenda(orders: Iterable[Order]) -> list[tuple[float, FollowerBehaviour | None]]:
    """What a `BadFollower` is to do, and when."""
    found: list[tuple[float, FollowerBehaviour | None]] = []
    for order in orders:
        behaviour = _of_follower(order)
        if behaviour is not None:
            found.append((order.at_s, behaviour))
            duration = order.options.get("duration_s")
            if duration is not None:
                found.append((order.at_s + duration, None))
    return sorted(found, key=lambda entry: entry[0])


def failing_followers(steps: Iterable[Step], orders: Sequence[Order]) -> tuple[Step, ...]:
    """The steps of a plan; their followers do at its time what is asked for."""
    return with_followers(steps, lambda follower: BadFollower(follower, agenda(orders)))


def _of_follower(order: Order) -> FollowerBehaviour | None:
    """The behaviour of a follower that is asked for; None: something else is."""
    injection = INJECTIONS[order.inject]
    if injection.behaviour is None:
        return None
    parameters = injection.parameters.model_validate(dict(order.options))
    return injection.behaviour(parameters) if getattr(parameters, "input", None) is None else None
