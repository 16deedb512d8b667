"""The tree of a mission's steps, from its file; and what is wrong with how its words fit together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from artemis.errors import ConfigError
from artemis.mission.behaviours import UNTIL, declarations
from artemis.mission.lapsing import lapses
from artemis.mission.order import TIME, Order
from artemis.mission.problems import nearest
from artemis.mission.schema import Mission
from artemis.mission.words import Step
from artemis.plugins.contracts import Declared
from artemis.progress import DONE
from artemis.states import tree
from artemis.states.advance import Passive
from artemis.states.condition import Condition, SignalKind, comparisons, parse
from artemis.states.outline import steps_in
from artemis.states.tree import ANY, FAULT, LOST, RESTART, RESUME, Leaf, Node, Steps, Tree
from artemis.supervision.catalogue import ROWS
from artemis.yaml_file import KeyPath, dotted

MOVING = ("calibrate", "follow", "goto", "teleop")
"""Steps that move the robot, or turn its wheels."""
_NUMBER, _TRUTH = SignalKind(kind=float), SignalKind(kind=bool)
OF_BATTERY = ("charge_percent", "range_m", "time_left_s")
"""Signals that only a robot has whose file describes its battery."""


@dataclass(frozen=True, slots=True)
class MissionTree:
    """A mission's words around its steps."""

    tree: Tree
    steps: list[tuple[KeyPath, Step]]
    """Those that take time, by number, with their key paths."""
    passive: list[Passive | None]
    """Of each, what ends it; None: the robot's modes tell that."""
    outcomes: list[frozenset[str]]
    """Of each, what it may end with, faults apart."""
    asked: list[Condition]
    """Every condition in it."""
    problems: list[tuple[KeyPath, str]] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    @property
    def signals(self) -> set[str]:
        """What its conditions ask for."""
        return {part.signal for condition in self.asked for part in comparisons(condition)}


def signals_of(mission: Mission) -> dict[str, SignalKind]:
    """What conditions of a mission may ask for, `round` apart, which only a `repeat` has."""
    steps = _written(mission)
    return _signals(mission, steps, declarations(steps))


def _signals(mission: Mission, steps: Any, behaviours: Mapping[str, Declared]) -> dict[str, SignalKind]:  # noqa: ANN401
    answers = [answer for _, word, body in steps_in(steps) if word == "ask" for answer in body["answers"]]
    by_input = {f"{name}.{button}": _TRUTH for name in mission.inputs for button in ("done", "record")}
    asked = {"answer": SignalKind(kind=str, values=tuple(dict.fromkeys(answers)))} if answers else {}
    measured = {name: _NUMBER for facts in behaviours.values() for name in facts.signals}
    return {
        "run_s": _NUMBER,
        "driven_m": _NUMBER,
        "battery_v": _NUMBER,
        **dict.fromkeys(OF_BATTERY, _NUMBER),
        **asked,
        **by_input,
        **measured,
    }


def _written(mission: Mission) -> Any:  # noqa: ANN401 (of a file)
    """The mission's steps, as its file writes them."""
    return mission.model_dump(include={"steps"}, by_alias=True)["steps"]


def mission_tree(mission: Mission, *, has_battery: bool = True, measured: bool = True) -> MissionTree:
    """The tree of a mission, with everything that is wrong in it.

    `has_battery`: the robot file describes one; `measured`: something measures the supply voltage.
    """
    written = _written(mission)
    building, count = _Building(mission, written, has_battery=has_battery, measured=measured), len(written)
    if mission.steps[-1].stop is not None and count > 1:
        count -= 1
    root = building.steps(mission.steps[:count], ("steps",), building.signals)
    checks = _Checks(written[:count], building.behaviours)
    return MissionTree(
        tree.tree_of(root),
        building.numbered,
        building.passive,
        [frozenset(checks.ends[path].keys() - {FAULT, LOST}) for path, _ in building.numbered],
        building.asked,
        building.problems + checks.problems,
        checks.remarks(building.lapsing),
    )


class _Building:
    def __init__(self, mission: Mission, steps: Any, *, has_battery: bool, measured: bool) -> None:  # noqa: ANN401 (of a file)
        self._measured, self._has_battery = measured, has_battery
        self.behaviours = declarations(steps)
        self.signals = _signals(mission, steps, self.behaviours)
        self.numbered: list[tuple[KeyPath, Step]] = []
        self.passive: list[Passive | None] = []
        self.asked: list[Condition] = []
        self.problems: list[tuple[KeyPath, str]] = []
        self.lapsing: list[KeyPath] = []
        """Conditions that end a step, may some day never hold again, and have no other limit beside them."""

    def steps(self, steps: Sequence[Step], path: KeyPath, signals: Mapping[str, SignalKind]) -> Steps:
        """One list of steps."""
        return Steps(tuple(self._node(step, (*path, index, step.word), signals) for index, step in enumerate(steps)))

    def _node(self, step: Step, path: KeyPath, signals: Mapping[str, SignalKind]) -> Node:
        body, name = step.action, dotted(path)
        match step.word:
            case "say":
                return tree.Say(name, body)
            case "end" | "stop":
                return tree.End(name, getattr(body, "outcome", DONE), getattr(body, "say", None) or "")
            case "call":
                return self.steps(body.steps, (*path, "steps"), signals)
            case "repeat":
                inner = {**signals, "round": _NUMBER}
                steps = self.steps(body.steps, (*path, "steps"), inner)
                until = self._end((*path, "until"), body.until, body.times, inner)
                return tree.Repeat(path=name, steps=steps, times=body.times, until=until)
            case "try":
                steps = self.steps(body.steps, (*path, "steps"), signals)
                between = body.between and self.steps(body.between, (*path, "between"), signals)
                catch = [(key, self.steps(of, (*path, "catch", key), signals)) for key, of in body.catch.items()]
                return tree.Try(
                    path=name,
                    steps=steps,
                    retries=body.retries,
                    again_on=body.again_on,
                    between=between,
                    catch=tuple(catch),
                )
            case "during":
                steps = self.steps(body.steps, (*path, "steps"), signals)
                watches = [self._watch(watch, (*path, "when", n), signals) for n, watch in enumerate(body.when)]
                when = tuple(watch for watch in watches if watch is not None)
                return tree.During(path=name, steps=steps, at_most=body.at_most_s, when=when)
            case "choose":
                return tree.Choose(path=name, branches=tuple(self._branches(body, path, signals)))
            case "together":
                steps = self.steps(body.steps, (*path, "steps"), signals)
                beside = self.steps(body.beside, (*path, "beside"), signals)
                return tree.Together(path=name, steps=steps, beside=tuple(Steps((one,)) for one in beside.of))
        self.numbered.append((path, step))
        self.passive.append(self._passive(step, path, signals))
        facts = self.behaviours.get(step.behaviour)
        leaf = Leaf(len(self.numbered) - 1, name, tuple(facts.signals) if facts else ())
        return self._ended(leaf, step, path, signals) if step.behaviour else leaf

    def _ended(self, leaf: Leaf, step: Step, path: KeyPath, signals: Mapping[str, SignalKind]) -> Node:
        """The step of a behaviour; with the condition that ends it, where it has one."""
        text = step.action.get(UNTIL)
        condition = self._condition(text, (*path, UNTIL), signals) if isinstance(text, str) else None
        if condition is None:
            return leaf
        watch = tree.Watch(text=text, condition=condition, steps=None, then=DONE)
        return tree.During(path=dotted(path), steps=Steps((leaf,)), at_most=None, when=(watch,))

    def _passive(self, step: Step, path: KeyPath, signals: Mapping[str, SignalKind]) -> Passive | None:
        if step.wait is not None:
            condition = self._end((*path, "for"), step.wait.for_, step.wait.at_most_s, signals)
            return Passive(seconds=step.wait.seconds, condition=condition, at_most=step.wait.at_most_s)
        return Passive(answers=step.ask.answers, at_most=step.ask.at_most_s) if step.ask is not None else None

    def _end(
        self, path: KeyPath, text: str | None, limit: float | None, signals: Mapping[str, SignalKind]
    ) -> Condition | None:
        """The condition that ends a step, beside which a `limit` may end it, too."""
        condition = self._condition(text, path, signals)
        if condition is not None and limit is None and lapses(condition):
            self.lapsing.append(path)
        return condition

    def _watch(self, watch: Any, path: KeyPath, signals: Mapping[str, SignalKind]) -> tree.Watch | None:  # noqa: ANN401
        condition = self._condition(watch.if_, (*path, "if"), signals)
        steps = watch.steps and self.steps(watch.steps, (*path, "steps"), signals)
        if condition is None:
            return None
        return tree.Watch(text=watch.if_, condition=condition, steps=steps, then=watch.then)

    def _branches(
        self,
        body: Any,  # noqa: ANN401
        path: KeyPath,
        signals: Mapping[str, SignalKind],
    ) -> Iterator[tuple[Condition | None, Steps]]:
        for index, branch in enumerate(body):
            condition = self._condition(branch.if_, (*path, index, "if"), signals)
            if branch.if_ is None and index + 1 < len(body):
                self.problems.append(((*path, index), "without `if` it always holds: it can only be the last"))
            yield condition, self.steps(branch.steps, (*path, index, "steps"), signals)

    def _condition(self, text: str | None, path: KeyPath, signals: Mapping[str, SignalKind]) -> Condition | None:
        if text is None:
            return None
        try:
            condition = parse(text, signals)
        except ConfigError as error:
            self.problems += [(path, problem) for problem in error.problems]
            return None
        self.asked.append(condition)
        asked = {part.signal for part in comparisons(condition)}
        if not self._has_battery and (found := asked.intersection(OF_BATTERY)):
            why = "the robot file describes no `battery`"
            self.problems += [(path, f"{name}: {why}") for name in sorted(found)]
        elif not self._measured and (found := asked & {"battery_v", *OF_BATTERY}):
            why = (
                "no drive of this robot measures the supply voltage: name an analog input that does "
                "(`battery.measured` of the robot file), or use a time, such as run_s > 3600"
            )
            self.problems += [(path, f"{name}: {why}") for name in sorted(found)]
        return condition


class _Checks:
    """Notes what is wrong with how the words of a mission fit together, in its file's own form."""

    def __init__(self, steps: Any, behaviours: Mapping[str, Declared]) -> None:  # noqa: ANN401 (of a file)
        order = Order(steps, behaviours)
        self.ends, self._behaviours = order.ends, behaviours
        never = "is never reached: the step before never ends with done"
        self.problems: list[tuple[KeyPath, str]] = [(path, never) for path in order.unreached]
        self._check_signals()
        self._endless: list[KeyPath] = []
        self._left: list[KeyPath] = []
        """Steps that something around them ends."""
        for path, word, body in steps_in(steps):
            match word:
                case "repeat":
                    self._check_repeat(path, body)
                case "try":
                    self._check_try(path, body)
                case "during":
                    self._check_during(path, body)
                case "together":
                    self._check_beside(path, body["beside"])
                    self._left.append((*path, "beside"))

    def remarks(self, lapsing: Sequence[KeyPath]) -> list[str]:
        """What may never end; `lapsing`: conditions that may some day never hold again."""
        told = [(path, "repeats for ever; only a person ends it") for path in self._endless]
        grows = "does not hold any more once run_s or driven_m has grown, and then only a person ends the step: "
        limits = {"for": "add at_most_s", "until": "add times"}
        told += [(path, f"{grows}{limits[str(path[-1])]}") for path in lapsing]
        return [f"{dotted(path)}: {text}" for path, text in told if not any(path[: len(at)] == at for at in self._left)]

    def _check_signals(self) -> None:
        """Two behaviours must not tell the same signal."""
        tells: dict[str, str] = {}
        for behaviour, facts in self._behaviours.items():
            for name in facts.signals:
                if name in tells:
                    both = f"{behaviour} and {tells[name]} both tell the signal {name}: use one of them"
                    self.problems.append((("steps",), both))
                tells[name] = behaviour

    def _check_repeat(self, path: KeyPath, body: Mapping[str, Any]) -> None:
        ends = self.ends[*path, "steps"]
        if TIME not in ends.get(DONE, (TIME,)):
            self.problems.append(
                (path, "no time passes in it on some way through: add a step that takes time, or an else")
            )
        if body["times"] is None and body["until"] is None and ends.keys() <= {DONE, FAULT, LOST}:
            self._endless.append(path)

    def _check_try(self, path: KeyPath, body: Mapping[str, Any]) -> None:
        ends = self.ends[*path, "steps"]
        possible = {LOST, *(name for name in ends if name != DONE and not name.startswith("!"))} & ends.keys()
        named = [
            *((("again_on", index), name) for index, name in enumerate(body["again_on"] or ())),
            *((("catch", name), name) for name in body["catch"]),
        ]
        for key, name in named:
            kind, _, id = name.partition(":")
            if kind == FAULT and id and id not in ROWS:
                self.problems.append(((*path, *key), f"no fault {id}{nearest(id, list(ROWS), 'faults')}"))
            if kind != FAULT and name not in (ANY, *possible):
                hint = nearest(name, sorted({*possible, FAULT}), "possible")
                self.problems.append(((*path, *key), f"no step within ends with {name}{hint}"))

    def _check_during(self, path: KeyPath, body: Mapping[str, Any]) -> None:
        if body["at_most_s"] is not None or any(watch["then"] not in (RESUME, RESTART) for watch in body["when"]):
            self._left.append((*path, "steps"))
        texts: set[str] = set()
        for index, watch in enumerate(body["when"]):
            text, then = watch["if"], watch["then"]
            if text in texts:
                again = "the same condition as a watcher above: this one is never asked"
                self.problems.append(((*path, "when", index, "if"), again))
            texts.add(text)
            if then in (DONE, FAULT, ANY) or then.startswith((f"{FAULT}:", "!")):
                self.problems.append(((*path, "when", index, "then"), f"{then} is no outcome of your own"))

    def _check_beside(self, path: KeyPath, beside: Any) -> None:  # noqa: ANN401 (of a file)
        for inner, word, _ in steps_in(beside, (*path, "beside")):
            facts = self._behaviours.get(word)
            if word in MOVING or (facts is not None and facts.moves):
                self.problems.append((inner, "moves the robot: steps beside others must not"))
            if word == "ask":
                self.problems.append((inner, "asks: a step beside others must not"))
