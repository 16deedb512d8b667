"""Whether the faults that a mission injects into its simulation can happen to its robot and its plugins."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from artemis.mission.problems import nearest
from artemis.mission.schema import InjectedFault
from artemis.testing.injections import INJECTIONS, NOT_INJECTED
from artemis.testing.stage import Injection, Needs
from artemis.vehicle import Robot

Problem = tuple[str, str]
"""Key of the fault, and what is wrong with it."""


def check_fault(fault: InjectedFault, robot: Robot | None, inputs: Collection[str], follows: bool) -> Iterator[Problem]:
    """What is wrong with a fault, but for its parameters' own values.

    Args:
        fault: As the mission has it.
        robot: Whose drives it may name; None: not known.
        inputs: The mission's inputs.
        follows: The mission has a follow step.
    """
    id = fault.inject
    if id in NOT_INJECTED:
        yield "inject", f"{id} cannot be injected: {NOT_INJECTED[id]}"
    elif id not in INJECTIONS:
        yield "inject", f"no such fault: {id}{nearest(id, INJECTIONS, 'faults')}"
    else:
        yield from _check_node(fault, INJECTIONS[id], robot)
        yield from _check_plugin(fault, INJECTIONS[id], inputs, follows)


def _check_node(fault: InjectedFault, injection: Injection, robot: Robot | None) -> Iterator[Problem]:
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
        elif node not in fitting:
            yield "node", f"{id} happens to {needs.value}: {', '.join(fitting)}"


def _check_plugin(
    fault: InjectedFault, injection: Injection, inputs: Collection[str], follows: bool
) -> Iterator[Problem]:
    name = fault.options.get("input")
    if "input" in injection.parameters.model_fields and isinstance(name, str):
        if name not in inputs:
            yield "input", f"no such input: {name}{nearest(name, inputs, 'inputs')}"
    elif injection.behaviour is not None:
        if not follows:
            yield "inject", f"{fault.inject} needs a follower: no step is a follow"
    elif "input" in injection.parameters.model_fields and not inputs:
        yield "inject", f"{fault.inject} needs an input: the mission has none"
