"""The faults of a mission's `simulation.faults`; this module is an `artemis.mission.injector.FaultInjector`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from pathlib import Path as FilePath

from pydantic import ValidationError

from artemis.config import Config
from artemis.devices.can_bus import FrameBus
from artemis.mission.injector import Problem, Simulated
from artemis.mission.problems import nearest
from artemis.mission.schema import InjectedFault
from artemis.plugins.contracts import Localizer
from artemis.recording.disk import Disk
from artemis.recording.journal import Entry
from artemis.states.plan import Step, with_behaviours, with_followers
from artemis.supervision.catalogue import ROWS
from artemis.vehicle import RobotFile
from artemis_lab.injections.bad_plugins import (
    BadBehaviour,
    BadFollower,
    BadInput,
    BadLocalizer,
    FollowerBehaviour,
)
from artemis_lab.injections.drives import has_object
from artemis_lab.injections.emergencies import checked_code, known_codes
from artemis_lab.injections.failing_disk import FailingDisk
from artemis_lab.injections.fault_bus import FaultBus
from artemis_lab.injections.stage import Injection, Needs, Stage
from artemis_lab.injections.table import INJECTIONS, NOT_INJECTED, inject, shows_on

# ---------------------------------------------------------------------------------------------- before the run


def ids() -> Collection[str]:
    """Rows of the fault table that can be made to happen."""
    return INJECTIONS.keys()


def parameters(id: str) -> type[Config] | None:
    """The keys of a fault beside `at_s`, `inject` and `node`; None: no such injection."""
    return INJECTIONS[id].parameters if id in INJECTIONS else None


def problems(
    fault: InjectedFault, robot: RobotFile | None, inputs: Collection[str], follows: bool
) -> Iterator[Problem]:
    """What is wrong with a fault, but for its parameters' own values."""
    id = fault.inject
    if id in NOT_INJECTED:
        yield "inject", f"{id} cannot be injected: {NOT_INJECTED[id]}"
    elif id not in INJECTIONS:
        yield "inject", f"no such fault: {id}{nearest(id, INJECTIONS, 'faults')}"
    else:
        yield from _check_node(fault, INJECTIONS[id], robot)
        yield from _check_family(fault, INJECTIONS[id], robot)
        yield from _check_scanner(fault, INJECTIONS[id], robot)
        yield from _check_plugin(fault, INJECTIONS[id], inputs, follows)


def _check_node(fault: InjectedFault, injection: Injection, robot: RobotFile | None) -> Iterator[Problem]:
    id, node, needs = fault.inject, fault.node, injection.needs
    if needs is Needs.NOTHING:
        if node is not None:
            yield "node", f"{id} happens to no single drive: leave it out"
    elif node is None:
        if needs is not Needs.SOME_DRIVE:
            yield "node", f"this key is missing: {id} happens to {needs.value}"
    elif robot is not None:
        role = {Needs.TRACTION: "traction", Needs.STEERING: "steering"}.get(needs)
        fitting = [name for name, drive in robot.drives.items() if role in (None, drive.role)]
        if node not in robot.drives:
            yield "node", f"no such drive: {node}{nearest(node, fitting, 'drives')}"
        elif not shows_on(id, robot):
            yield "inject", f"{id} needs {ROWS[id].needs.value}, which {robot.robot} has not"
        elif node not in fitting:
            yield "node", f"{id} happens to {needs.value}: {', '.join(fitting)}"


def _check_family(fault: InjectedFault, injection: Injection, robot: RobotFile | None) -> Iterator[Problem]:
    """A drive's family has this error, this code and this object."""
    drive = None if robot is None or fault.node is None else robot.drives.get(fault.node)
    if drive is None:
        return
    family, code = drive.family, fault.options.get("code")
    if injection.families is not None and family not in injection.families:
        only = " and ".join(injection.families)
        yield "node", f"{fault.inject} is no error of a drive of family {family}, only of {only}"
    elif injection.families is not None and code in known_codes(fault.inject):
        try:
            checked_code(fault.inject, family, code)
        except ValueError as error:
            yield "code", str(error)
    elif "index" in injection.parameters.model_fields:
        with suppress(ValidationError):  # what is wrong with it is said of every drive
            wanted = injection.parameters.model_validate(fault.options)
            index, sub = getattr(wanted, "index"), getattr(wanted, "sub")  # noqa: B009 (fields of `ObjectOf`)
            if not has_object(drive, index, sub):
                yield "index", f"a drive of family {family} has no object 0x{index:04X} sub-index {sub}"


def _check_scanner(fault: InjectedFault, injection: Injection, robot: RobotFile | None) -> Iterator[Problem]:
    if "scanner" not in injection.parameters.model_fields or robot is None:
        return
    name = fault.options.get("scanner")
    if not robot.scanners:
        yield "inject", f"{fault.inject} needs a scanner: the robot has none"
    elif isinstance(name, str) and name not in robot.scanners:
        yield "scanner", f"no such scanner: {name}{nearest(name, robot.scanners, 'scanners')}"


def _check_plugin(
    fault: InjectedFault, injection: Injection, inputs: Collection[str], follows: bool
) -> Iterator[Problem]:
    name = fault.options.get("input")
    if "input" in injection.parameters.model_fields and isinstance(name, str):
        if name not in inputs:
            yield "input", f"no such input: {name}{nearest(name, inputs, 'inputs')}"
    elif injection.behaviour is not None:
        if not follows:
            yield "inject", f"{fault.inject} needs a follower or a behaviour: no step has one"
    elif "input" in injection.parameters.model_fields and not inputs:
        yield "inject", f"{fault.inject} needs an input: the mission has none"


# ---------------------------------------------------------------------------------------------- parts that can fail


def failing_plugins(steps: Sequence[Step], faults: Sequence[InjectedFault]) -> tuple[Step, ...]:
    """The steps of a plan; their followers and behaviours do at its run time what is asked for, also in a replay."""
    following = with_followers(steps, lambda follower: BadFollower(follower, _agenda(faults)))
    return with_behaviours(following, lambda _, behaviour: BadBehaviour(behaviour, _agenda(faults)))


def failing_disk(folder: FilePath) -> Disk:
    """A disk that can be told to fail, with the room that `folder` has."""
    return FailingDisk(free=Disk().free(folder))


def failing_bus(bus: FrameBus, seed: int) -> FrameBus:
    """The bus, but it can be told to fail."""
    return FaultBus(bus, seed=seed)


def failing_localizer(localizer: Localizer) -> Localizer:
    """The localizer, but it can be told to misbehave."""
    return BadLocalizer(localizer)


# ---------------------------------------------------------------------------------------------- in the run


def begin(run: Simulated, faults: Sequence[InjectedFault], note: Callable[[Entry], None]) -> None:
    """Have each fault happen at its time, counted from now; those at 0 before this returns.

    Each is noted as a journal entry when it happens; those of followers and behaviours are their agenda's business.
    """
    stage = _stage_of(run)
    start = stage.now

    def do(fault: InjectedFault) -> None:
        if _of_follower(fault) is None:
            inject(stage, fault.inject, fault.node, **fault.options)
        text = " ".join(filter(None, (fault.inject, fault.node))) + f": {INJECTIONS[fault.inject].text}"
        data = {"id": fault.inject, "device": fault.node or "", **fault.options}
        note(Entry(time=stage.now - start, kind="injected", text=text, data=data))

    for fault in faults:
        if fault.at_s:
            stage.loop.call_later(fault.at_s, do, fault)
        else:
            do(fault)


def _stage_of(run: Simulated) -> Stage:
    """The stage of a run; its inputs are wrapped where they lie."""
    assert isinstance(run.bus, FaultBus)
    bad = {name: BadInput(device) for name, device in run.inputs.items()}
    run.inputs.update(bad)
    return Stage(
        robot=run.robot,
        world=run.world,
        bus=run.bus,
        loop=asyncio.get_running_loop(),
        inputs=bad,
        localizer=run.localizer if isinstance(run.localizer, BadLocalizer) else None,
        disk=run.disk if isinstance(run.disk, FailingDisk) else None,
        request=run.request,
    )


def _agenda(faults: Sequence[InjectedFault]) -> list[tuple[float, FollowerBehaviour | None]]:
    """What a `BadFollower` or `BadBehaviour` is to do, and when."""
    found: list[tuple[float, FollowerBehaviour | None]] = []
    for fault in faults:
        behaviour = _of_follower(fault)
        if behaviour is not None:
            found.append((fault.at_s, behaviour))
            duration = fault.options.get("duration_s")
            if isinstance(duration, int | float):
                found.append((fault.at_s + duration, None))
    return sorted(found, key=lambda entry: entry[0])


def _of_follower(fault: InjectedFault) -> FollowerBehaviour | None:
    """The behaviour of a follower that is asked for; None: something else is."""
    injection = INJECTIONS[fault.inject]
    if injection.behaviour is None:
        return None
    checked = injection.parameters.model_validate(fault.options)
    return injection.behaviour(checked) if getattr(checked, "input", None) is None else None
