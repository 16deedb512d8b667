"""The tree of a mission's steps, from its file; and what is wrong with how its words fit together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from artemis.errors import ConfigError
from artemis.mission.actions import Follow
from artemis.mission.behaviours import UNTIL, declarations
from artemis.mission.problems import nearest
from artemis.mission.schema import Mission
from artemis.mission.words import Step
from artemis.plugins.contracts import Declared
from artemis.progress import BLOCKED, DONE
from artemis.states import tree
from artemis.states.advance import Passive
from artemis.states.condition import Condition, SignalKind, comparisons, parse
from artemis.states.outline import steps_in
from artemis.states.tree import ANY, FAULT, LOST, RESTART, RESUME, TIMEOUT, Leaf, Node, Steps, Tree
from artemis.supervision.catalogue import ROWS
from artemis.yaml_file import KeyPath, dotted

MOVING = ("calibrate", "follow", "teleop")
"""Steps that move the robot, or turn its wheels."""
_NUMBER, _TRUTH = SignalKind(kind=float), SignalKind(kind=bool)


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
    return {"run_s": _NUMBER, "driven_m": _NUMBER, "battery_v": _NUMBER, **asked, **by_input, **measured}


def _written(mission: Mission) -> Any:  # noqa: ANN401 (of a file)
    """The mission's steps, as its file writes them."""
    return mission.model_dump(include={"steps"}, by_alias=True)["steps"]


def mission_tree(mission: Mission) -> MissionTree:
    """The tree of a mission, with everything that is wrong in it."""
    building = _Building(mission)
    building.check_signals()
    of = mission.steps[:-1] if mission.steps[-1].stop is not None and len(mission.steps) > 1 else mission.steps
    root = building.steps(of, ("steps",), building.signals)
    building.check(root, ("steps",))
    return MissionTree(
        tree.tree_of(root),
        building.numbered,
        building.passive,
        building.outcomes,
        building.asked,
        building.problems,
        building.remarks,
    )


class _Building:
    def __init__(self, mission: Mission) -> None:
        self._simulated = mission.bus == "simulation"
        steps = _written(mission)
        self._behaviours = declarations(steps)
        self.signals = _signals(mission, steps, self._behaviours)
        self._until: set[int] = set()
        """Nodes made of a behaviour's key `until`, by identity."""
        self.numbered: list[tuple[KeyPath, Step]] = []
        self.passive: list[Passive | None] = []
        self.outcomes: list[frozenset[str]] = []
        self.asked: list[Condition] = []
        self.problems: list[tuple[KeyPath, str]] = []
        self.remarks: list[str] = []
        self._paths: dict[int, KeyPath] = {}
        """Of nodes, by identity."""
        self._kept: list[Node] = []

    # ------------------------------------------------------------------------------------------ building

    def steps(self, steps: Sequence[Step], path: KeyPath, signals: Mapping[str, SignalKind]) -> Steps:
        """One list of steps."""
        return Steps(tuple(self._node(step, (*path, index, step.word), signals) for index, step in enumerate(steps)))

    def _node(self, step: Step, path: KeyPath, signals: Mapping[str, SignalKind]) -> Node:
        node = self._made(step, path, signals)
        self._paths[id(node)] = path
        self._kept.append(node)
        return node

    def _made(self, step: Step, path: KeyPath, signals: Mapping[str, SignalKind]) -> Node:
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
                until = self._condition(body.until, (*path, "until"), inner)
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
        self.outcomes.append(frozenset(self._outcomes(step)))
        leaf = Leaf(len(self.numbered) - 1, name)
        return self._ended(leaf, step, path, signals) if step.behaviour else leaf

    def _ended(self, leaf: Leaf, step: Step, path: KeyPath, signals: Mapping[str, SignalKind]) -> Node:
        """The step of a behaviour; with the condition that ends it, where it has one."""
        text = step.action.get(UNTIL)
        condition = self._condition(text, (*path, UNTIL), signals) if isinstance(text, str) else None
        if condition is None:
            return leaf
        watch = tree.Watch(text=text, condition=condition, steps=None, then=DONE)
        during = tree.During(path=dotted(path), steps=Steps((leaf,)), at_most=None, when=(watch,))
        self._paths[id(leaf)] = path
        self._until.add(id(during))
        return during

    def _passive(self, step: Step, path: KeyPath, signals: Mapping[str, SignalKind]) -> Passive | None:
        if step.wait is not None:
            condition = self._condition(step.wait.for_, (*path, "for"), signals)
            return Passive(seconds=step.wait.seconds, condition=condition, at_most=step.wait.at_most_s)
        return Passive(answers=step.ask.answers, at_most=step.ask.at_most_s) if step.ask is not None else None

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
        if "battery_v" in text and not self._simulated:
            self.problems.append(
                (path, "battery_v: no drive of this robot measures it; use a time, such as run_s > 3600")
            )
        return condition

    # ------------------------------------------------------------------------------------------ checking

    def check_signals(self) -> None:
        """Two behaviours must not tell the same signal."""
        tells: dict[str, str] = {}
        for behaviour, facts in self._behaviours.items():
            for name in facts.signals:
                if name in tells:
                    both = f"{behaviour} and {tells[name]} both tell the signal {name}: use one of them"
                    self.problems.append((("steps",), both))
                tells[name] = behaviour

    def check(self, node: Node, path: KeyPath) -> tuple[set[str], bool]:
        """What a node may end with, and whether time passes on each way to `done`; what is wrong is noted."""
        path = self._paths.get(id(node), path)
        match node:
            case Leaf(number):
                return set(self.outcomes[number]), True
            case tree.Say():
                return {DONE}, False
            case tree.End(outcome=outcome):
                return {f"!{outcome}"}, False
            case Steps(of):
                return self._check_list(of, path)
            case tree.Repeat():
                return self._check_repeat(node, path)
            case tree.Try():
                return self._check_try(node, path)
            case tree.During():
                return self.check(node.steps, path) if id(node) in self._until else self._check_during(node, path)
            case tree.Choose():
                found = [self.check(steps, path) for _, steps in node.branches]
                is_open = all(condition is not None for condition, _ in node.branches)
                ends = set[str]().union(*(ends for ends, _ in found), {DONE} if is_open else ())
                return ends, not is_open and all(takes_time for _, takes_time in found)
        return self._check_together(node, path)

    def _outcomes(self, step: Step) -> set[str]:
        if step.behaviour:
            facts = self._behaviours.get(step.behaviour)
            return {DONE, *(facts.outcomes if facts else ()), *([BLOCKED] if facts and facts.moves else ())}
        if isinstance(step.action, Follow):
            return {DONE, BLOCKED}
        limited = getattr(step.action, "at_most_s", None) is not None
        return {DONE, *([TIMEOUT] if limited else [])}

    def _check_list(self, of: Sequence[Node], path: KeyPath) -> tuple[set[str], bool]:
        ends, takes_time = {DONE}, False
        for index, node in enumerate(of):
            found, takes = self.check(node, path)
            ends, takes_time = ends - {DONE} | found, takes_time or takes
            if DONE not in found:
                for after in of[index + 1 : index + 2]:
                    never = "is never reached: the step before never ends with done"
                    self.problems.append((self._paths.get(id(after), path), never))
                break
        return ends, takes_time

    def _check_repeat(self, node: tree.Repeat, path: KeyPath) -> tuple[set[str], bool]:
        ends, takes_time = self.check(node.steps, (*path, "steps"))
        if DONE in ends and not takes_time:
            self.problems.append(
                (path, "no time passes in it on some way through: add a step that takes time, or an else")
            )
        stops = node.times is not None or node.until is not None
        if not stops and ends <= {DONE}:
            self.remarks.append(f"{dotted(path)}: repeats for ever; only a person ends it")
        return ends - {DONE} | ({DONE} & ends if stops else set()), takes_time

    def _check_try(self, node: tree.Try, path: KeyPath) -> tuple[set[str], bool]:
        ends, takes_time = self.check(node.steps, (*path, "steps"))
        possible = {end for end in ends if end != DONE and not end.startswith("!")}
        places = {"follow", *(name for name, facts in self._behaviours.items() if facts.moves)}
        follows = any(self._kind(inner) in places for inner in tree.inside(node.steps))
        named: list[tuple[KeyPath, str]] = [
            *((("again_on", index), name) for index, name in enumerate(node.again_on or ())),
            *((("catch", name), name) for name, _ in node.catch),
        ]
        for key, name in named:
            self._check_name(name, possible, (*path, *key), follows=follows)
        if node.between is not None:
            between, _ = self.check(node.between, (*path, "between"))
            ends |= between - {DONE}
        names = {name for name, _ in node.catch}
        caught = possible if ANY in names else possible & names
        left = ends - caught
        for name, steps in node.catch:
            left |= self.check(steps, (*path, "catch", name))[0]
        return left, takes_time

    def _check_name(self, name: str, possible: set[str], path: KeyPath, *, follows: bool) -> None:
        kind, _, id = name.partition(":")
        if kind == FAULT and id and id not in ROWS:
            self.problems.append((path, f"no fault {id}{nearest(id, list(ROWS), 'faults')}"))
        if kind == FAULT or name in (ANY, *possible) or (name == LOST and follows):
            return
        known = sorted({*possible, FAULT, *([LOST] if follows else [])})
        self.problems.append((path, f"no step within ends with {name}{nearest(name, known, 'possible')}"))

    def _check_during(self, node: tree.During, path: KeyPath) -> tuple[set[str], bool]:
        remarks = len(self.remarks)
        ends, takes_time = self.check(node.steps, (*path, "steps"))
        if node.at_most is not None or any(watch.then not in (RESUME, RESTART) for watch in node.when):
            del self.remarks[remarks:]  # what repeats for ever within is ended here
        ends |= {TIMEOUT} if node.at_most is not None else set()
        texts: set[str] = set()
        for index, watch in enumerate(node.when):
            if watch.text in texts:
                again = "the same condition as a watcher above: this one is never asked"
                self.problems.append(((*path, "when", index, "if"), again))
            texts.add(watch.text)
            if watch.steps is not None:
                ends |= self.check(watch.steps, (*path, "when", index, "steps"))[0] - {DONE}
            if watch.then in (DONE, FAULT, ANY) or watch.then.startswith((f"{FAULT}:", "!")):
                self.problems.append(((*path, "when", index, "then"), f"{watch.then} is no outcome of your own"))
            ends |= {watch.then} - {RESUME, RESTART}
        return ends, takes_time

    def _check_together(self, node: Node, path: KeyPath) -> tuple[set[str], bool]:
        assert isinstance(node, tree.Together)
        ends, takes_time = self.check(node.steps, (*path, "steps"))
        for steps in node.beside:
            ends |= self.check(steps, (*path, "beside"))[0] - {DONE}
            for inner in tree.inside(steps):
                if self._moves(inner):
                    self.problems.append((self._paths[id(inner)], "moves the robot: steps beside others must not"))
                if self._kind(inner) == "ask":
                    self.problems.append((self._paths[id(inner)], "asks: a step beside others must not"))
        return ends, takes_time

    def _moves(self, node: Node) -> bool:
        facts = self._behaviours.get(self._kind(node))
        return self._kind(node) in MOVING or (facts is not None and facts.moves)

    def _kind(self, node: Node) -> str:
        return self.numbered[node.number][1].word if isinstance(node, Leaf) else ""
