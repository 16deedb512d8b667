"""How the words of a mission fit together, in its file's own form: also where parts of it cannot be read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from artemis.mission.conditions import conditions_in, declared_signals, lapses
from artemis.mission.order import TIME, UNREAD, Order
from artemis.mission.problems import LAST_BRANCH, closest, nearest
from artemis.progress import DONE, OWN_STEPS
from artemis.states.condition import SignalKind
from artemis.states.outcomes import StepFacts, outcomes_of
from artemis.states.outline import Path, keys_of, parts_of, step_of, steps_in
from artemis.states.tree import ANY, FAULT, LOST, RESTART, RESUME, is_fault
from artemis.supervision.catalogue import ROWS
from artemis.yaml_file import dotted


class WordChecks:
    """Goes through the steps of a mission once.

    Attributes:
        order: How each step and word may end, and what is done before it.
        signals: What conditions may ask for, `round` apart.
        conditions: Those that can be read, by their paths.
        facts: What outcomes depend on beside the steps.
        problems: What is wrong, with its path.
        remarks: What may never end or happen, and outcomes that end the mission, for people.
    """

    def __init__(
        self,
        steps: Any,  # noqa: ANN401 (of a file)
        inputs: Iterable[str],
        facts: StepFacts,
        wrong: Iterable[Path] = (),
    ) -> None:
        """`inputs`: their names in the mission; `wrong`: where something is wrong in it."""
        if isinstance(steps, list | tuple) and len(steps) > 1 and isinstance(steps[-1], dict) and steps[-1]:
            steps = steps[:-1] if step_of(steps[-1])[0] == "stop" else steps
        self.order, self.facts = Order(steps, facts, wrong), facts
        self.signals = declared_signals(steps, inputs, facts)
        silent = {*OWN_STEPS, *facts.behaviours} - {"call"}
        unknown = [f"{path[-1]}" for path in self.order.unread if path[-1] not in silent]
        complete = all(word != "call" and closest(word, OWN_STEPS) for word in unknown)
        if unknown:  # one of them may be an `ask`
            self.signals["answer"] = SignalKind(kind=str)
        self.conditions, self.problems = conditions_in(steps, self.signals, facts, complete=complete)
        never = "is never reached: the step before never ends with done"
        self.problems += [(path, never) for path in self.order.unreached]
        self._remarks = [
            (path, "no step within ends with an outcome that is left for it; faults, only where a key names them")
            for path in self.order.unused
        ]
        self._endless: list[tuple[Path, str]] = []
        """Remarks on what only a person ends, unless it is in one of these steps."""
        self._tries: dict[Path, Mapping[str, Any]] = {}
        """The keys of each `try`, by the path of its steps."""
        self._left: list[Path] = []
        """Steps that something around them ends."""
        self._check_signals()
        for path, word, body in steps_in(steps):
            keys = keys_of(body)
            match word:
                case "wait":
                    self._check_lapse((*path, "for"), "at_most_s", keys)
                case "repeat":
                    self._check_repeat(path, keys)
                case "try":
                    self._check_try(path, keys)
                case "during":
                    self._check_during(path, keys)
                case "choose":
                    self._check_choose(path, parts_of(body))
                case "together":
                    self._check_beside(path, keys.get("beside"))

    @property
    def remarks(self) -> list[str]:
        """See the class."""
        endless = [(path, text) for path, text in self._endless if not any(path[: len(at)] == at for at in self._left)]
        return [f"{dotted(path)}: {text}" for path, text in (*self._remarks, *endless)]

    def _check_signals(self) -> None:
        """Two behaviours must not publish the same signal."""
        publishers: dict[str, str] = {}
        for behaviour, facts in self.facts.behaviours.items():
            for name in facts.signals:
                if name in publishers:
                    both = f"{behaviour} and {publishers[name]} both publish the signal {name}: use one of them"
                    self.problems.append((("steps",), both))
                publishers[name] = behaviour

    def _check_lapse(self, path: Path, limit: str, keys: Mapping[str, Any]) -> None:
        """A condition that ends a step must not be one that never holds again, unless a limit ends the step, too."""
        if keys.get(limit) is None and path in self.conditions and lapses(self.conditions[path]):
            grows = "does not hold any more once run_s or driven_m has grown, and then only a person ends the step"
            self._endless.append((path, f"{grows}: add {limit}"))

    def _check_repeat(self, path: Path, keys: Mapping[str, Any]) -> None:
        ends = self.order.ends.get((*path, "steps"), {})
        if isinstance(keys.get("steps"), list | tuple) and TIME not in ends.get(DONE, (TIME,)):
            self.problems.append(
                (path, f"no time passes in it on some way through: add a step that takes time, or {LAST_BRANCH}")
            )
        if keys.get("times") is None and keys.get("until") is None and ends.keys() <= {DONE, FAULT, LOST}:
            self._endless.append((path, "repeats for ever; only a person ends it"))
        self._check_lapse((*path, "until"), "times", keys)

    def _check_try(self, path: Path, keys: Mapping[str, Any]) -> None:
        ends = self.order.ends.get((*path, "steps"), {})
        possible = {name for name in ends if name not in (DONE, FAULT) and not name.startswith("!")}
        self._tries[*path, "steps"] = keys
        for key, name in _named(keys):
            kind, _, id = f"{name}".partition(":")
            if kind == FAULT and id and id not in ROWS:
                self.problems.append(((*path, *key), f"no fault {id}{nearest(id, list(ROWS), 'faults')}"))
            if kind != FAULT and name not in (ANY, *possible) and UNREAD not in possible:
                why = self._why_never(f"{name}", keys.get("steps"))
                hint = f": {why}" if why else nearest(f"{name}", sorted({*possible, FAULT}), "possible")
                self.problems.append(((*path, *key), f"no step within ends with {name}{hint}"))

    def _why_never(self, name: str, steps: Any) -> str:  # noqa: ANN401 (of a file)
        """Why none of these steps ends with an outcome that their kinds have."""
        found = (outcomes_of(word, body, self.facts).get(name, "") for _, word, body in steps_in(steps))
        return next(filter(None, found), "")

    def _check_during(self, path: Path, keys: Mapping[str, Any]) -> None:
        watches = [keys_of(watch) for watch in parts_of(keys.get("when"))]
        thens = [f"{watch.get('then') or RESUME}" for watch in watches]
        branches = [self.order.ends.get((*path, "when", index, "steps"), {}) for index in range(len(watches))]
        leaves = any(ends.keys() - {DONE, FAULT, LOST} for ends in branches)
        if leaves or keys.get("at_most_s") is not None or set(thens) - {RESUME, RESTART}:
            self._left.append((*path, "steps"))
        above = []
        for index, then in enumerate(thens):
            at = (*path, "when", index)
            if (condition := self.conditions.get((*at, "if"))) in above:
                again = "the same condition as a watcher above: this one is never asked"
                self.problems.append(((*at, "if"), again))
            above += [] if condition is None else [condition]
            if then in (DONE, ANY) or is_fault(then) or then.startswith("!"):
                self.problems.append(((*at, "then"), f"{then} is no outcome of your own"))
            if then not in (RESUME, RESTART) and then in self.order.ends.get(path, ()):
                self._check_caught((*at, "then"), then)

    def _check_caught(self, path: Path, outcome: str) -> None:
        """An outcome of the mission's own that no `try` around it catches is a remark: its name may be misspelt."""
        tries = [self._tries[path[:end]] for end in range(len(path)) if path[:end] in self._tries]
        if any({outcome, ANY} & keys_of(keys.get("catch")).keys() for keys in tries):
            return
        again = [keys.get("again_on") or (ANY,) for keys in tries if keys.get("retries")]
        when = (
            "after its retries " if any(name in (outcome, ANY) for names in again for name in parts_of(names)) else ""
        )
        near = closest(outcome, (RESUME, RESTART))
        hint = f"; did you mean {near}?" if near else ""
        self._remarks.append((path, f"no `try` catches {outcome}: {when}it ends the mission as failed{hint}"))

    def _check_choose(self, path: Path, branches: Iterable[Any]) -> None:
        *others, _ = [*branches, None]
        for index, branch in enumerate(others[:-1]):
            if keys_of(branch).get("if") is None:
                self.problems.append(((*path, index), "without `if` it always holds: it can only be the last"))

    def _check_beside(self, path: Path, beside: Any) -> None:  # noqa: ANN401 (of a file)
        self._left.append((*path, "beside"))
        for inner, word, body in steps_in(beside, (*path, "beside")):
            if self.facts.moves(word):
                self.problems.append((inner, "moves the robot: steps beside others must not"))
            if word == "ask":
                self.problems.append((inner, "asks: a step beside others must not"))
            if word == "try":
                named = _named(keys_of(body))
                never = "a fault ends no step beside others: only the present one"
                self.problems += [((*inner, *key), never) for key, name in named if is_fault(f"{name}")]


def _named(keys: Mapping[str, Any]) -> list[tuple[Path, Any]]:
    """The outcomes that a `try` names, by the paths of the names within it."""
    return [
        *((("again_on", index), name) for index, name in enumerate(parts_of(keys.get("again_on")))),
        *((("catch", name), name) for name in keys_of(keys.get("catch"))),
    ]
