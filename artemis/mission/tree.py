"""The tree of a mission's steps, from its file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from artemis.mission.conditions import UNTIL
from artemis.mission.schema import Mission
from artemis.mission.word_checks import WordChecks
from artemis.mission.words import Step
from artemis.progress import DONE
from artemis.states import tree
from artemis.states.condition import Condition, SignalKind, comparisons
from artemis.states.outline import numbered
from artemis.states.plan import AskStep, WaitStep
from artemis.states.step_names import name_of
from artemis.states.tree import FAULT, Leaf, Node, Steps, Tree
from artemis.yaml_file import KeyPath, dotted


@dataclass(frozen=True, slots=True)
class MissionTree:
    """A mission's words around its steps."""

    tree: Tree
    steps: list[tuple[KeyPath, Step]]
    """Those that take time, by number, with their key paths."""
    names: list[str]
    """Theirs, in a few words."""
    passive: list[WaitStep | AskStep | None]
    """Those that move nothing; None: the robot's modes report what ends it."""
    outcomes: list[frozenset[str]]
    """Of each, what it may end with; faults only as `lost`."""
    asked: list[Condition]
    """Every condition in it."""
    declared: dict[str, SignalKind]
    """What they may ask for, `round` apart."""

    @property
    def signals(self) -> set[str]:
        """What its conditions ask for."""
        return {part.signal for condition in self.asked for part in comparisons(condition)}


def written(mission: Mission) -> Any:  # noqa: ANN401 (of a file)
    """The mission's steps in its file's own form."""
    return mission.model_dump(include={"steps"}, by_alias=True)["steps"]


def mission_tree(mission: Mission, checks: WordChecks) -> MissionTree:
    """The tree of a mission in which nothing is wrong."""
    building, count = _Building(checks), len(mission.steps)
    if mission.steps[-1].stop is not None and count > 1:
        count -= 1
    root = building.steps(mission.steps[:count], ("steps",))
    return MissionTree(
        tree.tree_of(root),
        building.numbered,
        [name_of(word, body) for _, word, body in numbered(written(mission))],
        building.passive,
        [frozenset(checks.order.ends[path].keys() - {FAULT}) for path, _ in building.numbered],
        list(checks.conditions.values()),
        checks.signals,
    )


class _Building:
    def __init__(self, checks: WordChecks) -> None:
        self._conditions, self._behaviours = checks.conditions, checks.facts.behaviours
        self.numbered: list[tuple[KeyPath, Step]] = []
        self.passive: list[WaitStep | AskStep | None] = []

    def steps(self, steps: Sequence[Step], path: KeyPath) -> Steps:
        """One list of steps."""
        return Steps(tuple(self._node(step, (*path, index, step.word)) for index, step in enumerate(steps)))

    def _node(self, step: Step, path: KeyPath) -> Node:
        body, name = step.action, dotted(path)
        match step.word:
            case "say":
                return tree.Say(name, body)
            case "end" | "stop":
                return tree.End(name, getattr(body, "outcome", DONE), getattr(body, "say", None) or "")
            case "choose":
                branches = (
                    (self._conditions.get((*path, index, "if")), self.steps(branch.steps, (*path, index, "steps")))
                    for index, branch in enumerate(body)
                )
                return tree.Choose(path=name, branches=tuple(branches))
            case "wait" | "ask" | "calibrate" | "follow" | "goto" | "teleop":
                return self._leaf(step, path)
        if step.behaviour:
            return self._acting(step, path)
        steps = self.steps(body.steps, (*path, "steps"))
        match step.word:
            case "call":
                return steps
            case "repeat":
                until = self._conditions.get((*path, "until"))
                return tree.Repeat(path=name, steps=steps, times=body.times, until=until)
            case "try":
                between = body.between and self.steps(body.between, (*path, "between"))
                catch = tuple((key, self.steps(of, (*path, "catch", key))) for key, of in body.catch.items())
                retried = {"retries": body.retries, "again_on": body.again_on or (tree.ANY,), "between": between}
                return tree.Try(path=name, steps=steps, catch=catch, **retried)
            case "during":
                when = tuple(self._watches(body.when, (*path, "when")))
                return tree.During(path=name, steps=steps, at_most=body.at_most_s, when=when)
        beside = self.steps(body.beside, (*path, "beside"))
        return tree.Together(path=name, steps=steps, beside=tuple(Steps((one,)) for one in beside.of))

    def _watches(self, watches: Any, path: KeyPath) -> Iterator[tree.Watch]:  # noqa: ANN401 (of a schema)
        for index, watch in enumerate(watches):
            steps = watch.steps and self.steps(watch.steps, (*path, index, "steps"))
            condition = self._conditions[*path, index, "if"]
            yield tree.Watch(text=watch.if_, condition=condition, steps=steps, then=watch.then)

    def _leaf(self, step: Step, path: KeyPath, signals: Sequence[str] = ()) -> Leaf:
        passive: WaitStep | AskStep | None = None
        if (wait := step.wait) is not None:
            condition = self._conditions.get((*path, "for"))
            passive = WaitStep(seconds=wait.seconds, condition=condition, at_most=wait.at_most_s)
        elif (ask := step.ask) is not None:
            passive = AskStep(question=ask.question, answers=ask.answers, at_most=ask.at_most_s)
        self.numbered.append((path, step))
        self.passive.append(passive)
        return Leaf(len(self.numbered) - 1, dotted(path), tuple(signals))

    def _acting(self, step: Step, path: KeyPath) -> Node:
        """The step of a behaviour; with the condition that ends it, where it has one."""
        leaf = self._leaf(step, path, tuple(self._behaviours[step.behaviour].signals))
        condition = self._conditions.get((*path, UNTIL))
        if condition is None:
            return leaf
        watch = tree.Watch(text=step.action[UNTIL], condition=condition, steps=None, then=DONE)
        return tree.During(path=dotted(path), steps=Steps((leaf,)), at_most=None, when=(watch,))
