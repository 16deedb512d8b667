"""How each step and word of a mission may end, and what is done before it, on every path through the words to it.

The first of two steps dominates the second one, as compilers say of their graphs (R. T. Prosser, Applications of
Boolean matrices to the analysis of flow diagrams, 1959). Nothing that is done is ever undone, so one pass suffices: the
first round of a `repeat` and the first attempt of a `try` decide.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from artemis.progress import DONE, OWN_STEPS, WORDS
from artemis.states.outcomes import StepFacts, outcomes_of
from artemis.states.outline import Path, keys_of, parts_of, step_of, steps_in
from artemis.states.tree import ANY, FAULT, LOST, RESTART, RESUME, TIMEOUT, is_fault, names_in
from artemis.yaml_file import dotted

CALIBRATED, TIME, NEVER = "", "Time", "Never"
"""The wheels are aligned; at least a tick has passed; this is never reached. Beside these the names of the paths that
are recorded."""
UNREAD = "?"
"""The outcome of what cannot be read: it may end with anything."""
Facts = frozenset[str]
Ends = dict[str, Facts]
"""By outcome, `done` and `fault` among them: what is done whenever a step, or a word, ends so. The mission's end by
`end` or `stop` is an outcome that begins with an exclamation mark."""


def why_not(steps: Any, fact: str, target: Path) -> str:  # noqa: ANN401 (of a file)
    """Why a fact may be missing before a step, though another step sees to it; empty: no step before does."""
    for path, word, body in steps_in(steps):
        if path == target:
            return ""
        if fact in _gained(word, body):
            return f"{dotted(path)} {_condition(steps, path, target)}"
    return ""


class Order:
    """Goes through the steps of a mission in its file's own form.

    Attributes:
        before: Of each step that can be reached, by its path, what is done before.
        ends: Of each step, word and list of steps, by its path, how it may end.
        unreached: The first step of each list that is never reached.
        unused: Each `any` for which no outcome is left.
        unread: Steps that cannot be read: what they do is unknown.
    """

    def __init__(self, steps: Any, facts: StepFacts, wrong: Iterable[Path] = ()) -> None:  # noqa: ANN401 (of a file)
        """`wrong`: where something is wrong in the mission."""
        self._facts = facts
        self.unread = set(_unread(steps, facts, wrong))
        self.before: dict[Path, Facts] = {}
        self.ends: dict[Path, Ends] = {}
        self.unreached: list[Path] = []
        self.unused: list[Path] = []
        self._list(steps, ("steps",), Facts())

    def _list(self, steps: Any, path: Path, before: Facts) -> Ends:  # noqa: ANN401 (of a file)
        """One step after the other."""
        ends: Ends = {DONE: before}
        never: list[Path] = []
        for index, step in enumerate(parts_of(steps)):
            if not isinstance(step, dict) or not step:
                continue
            word, body = step_of(step)
            at = (*path, index, word)
            if DONE in ends:
                _join(ends, self._step(word, body, at, ends.pop(DONE)))
            else:
                never.append(at)
                self._step(word, body, at, before | {NEVER})
        self.unreached += never[:1]
        self.ends[path] = ends
        return ends

    def _step(self, word: str, body: Any, path: Path, before: Facts) -> Ends:  # noqa: ANN401 (of a file)
        if NEVER not in before:
            self.before[path] = before
        self.ends[path] = ends = self._ends(word, body, path, before)
        if path in self.unread:
            ends |= {DONE: ends.get(DONE, before) | {TIME}}
            if word in WORDS or word not in (*OWN_STEPS, *self._facts.behaviours):
                ends[UNREAD] = before
        return ends

    def _ends(self, word: str, body: Any, path: Path, before: Facts) -> Ends:  # noqa: ANN401 (of a file)
        keys = keys_of(body)
        match word:
            case "say":
                return {DONE: before}
            case "end" | "stop":
                return {f"!{keys.get('outcome') or DONE}": before}
            case "repeat":
                ends = _and(self._list(keys.get("steps"), (*path, "steps"), before - {TIME}), before)
                return ends if keys.get("times") or keys.get("until") else _but(ends, DONE)
            case "call":
                return dict(self._list(keys.get("steps"), (*path, "steps"), before))
            case "try":
                return self._try(keys, path, before)
            case "during":
                return self._during(keys, path, before)
            case "choose":
                return self._choose(body, path, before)
            case "together":
                ends = dict(self._list(keys.get("steps"), (*path, "steps"), before))
                for index, step in enumerate(_mappings(keys.get("beside"))):
                    word, body = step_of(step)
                    _join(ends, _but(self._step(word, body, (*path, "beside", index, word), before), DONE))
                return ends
        begun = before | {TIME}
        found, unread = outcomes_of(word, body, self._facts), path in self.unread
        others = [FAULT, *(name for name, never in found.items() if unread or not never)]
        return {DONE: begun | _gained(word, body), **dict.fromkeys(others, begun)}

    def _try(self, keys: Mapping[str, Any], path: Path, before: Facts) -> Ends:
        body = self._list(keys.get("steps"), (*path, "steps"), before)
        others = {name: facts for name, facts in body.items() if name != DONE and not name.startswith("!")}
        catch, again = keys_of(keys.get("catch")), keys.get("again_on")
        own = [name for name in others if not is_fault(name)]
        given = [ANY] if again is None else [f"{name}" for name in parts_of(again)]
        retried = [*(own if ANY in given else ()), *given]
        names = [*own, *filter(is_fault, retried)]
        rest = [name for name in names if catch.keys().isdisjoint({*names_in(name, [name])} - {ANY})]
        ends = _but(body, *_of(others, [name for name in catch if ":" not in name]), *(own if ANY in catch else ()))
        between = self._branch(keys.get("between"), (*path, "between"), _of(others, retried), before)
        _join(ends, _but(between, DONE))
        for name, steps in catch.items():
            after = _of(others, rest if name == ANY else [name])
            if not after and name == ANY:
                self.unused.append((*path, "catch", ANY))
            _join(ends, self._branch(steps, (*path, "catch", name), after, before))
        return ends

    def _branch(self, steps: Any, path: Path, after: Ends, before: Facts) -> Ends:  # noqa: ANN401 (of a file)
        """Steps of a word that run after one of these outcomes."""
        ends = self._list(steps, path, Facts.intersection(*after.values()) if after else before | {NEVER})
        return ends if after else {}

    def _during(self, keys: Mapping[str, Any], path: Path, before: Facts) -> Ends:
        ends, begun = dict(self._list(keys.get("steps"), (*path, "steps"), before)), before | {TIME}
        for index, watch in enumerate(_mappings(keys.get("when"))):
            branch = self._list(watch.get("steps"), (*path, "when", index, "steps"), begun)
            then = watch.get("then") or RESUME
            if DONE in branch and then not in (RESUME, RESTART):
                _join(ends, {str(then): branch[DONE]})
            _join(ends, _but(branch, DONE))
        _join(ends, {TIMEOUT: begun} if keys.get("at_most_s") else {})
        return ends

    def _choose(self, body: Any, path: Path, before: Facts) -> Ends:  # noqa: ANN401 (of a file)
        branches = _mappings(body)
        ends: Ends = {} if any(branch.get("if") is None for branch in branches) else {DONE: before}
        for index, branch in enumerate(branches):
            _join(ends, self._list(branch.get("steps"), (*path, index, "steps"), before))
        return ends


def _unread(steps: Any, facts: StepFacts, wrong: Iterable[Path]) -> Iterator[Path]:  # noqa: ANN401 (of a file)
    """The innermost steps in which something is wrong; behaviours that are not known, and calls of nothing."""
    paths = {path for path, _, _ in steps_in(steps)}
    for place in wrong:
        yield from [place[:end] for end in range(len(place), 0, -1) if place[:end] in paths][:1]
    for path, word, body in steps_in(steps):
        if (word == "call" and not keys_of(body).get("steps")) or word not in (*OWN_STEPS, *facts.behaviours):
            yield path


def _gained(word: str, body: Any) -> Facts:  # noqa: ANN401 (of a file)
    """What a step sees to."""
    if word == "calibrate":
        return Facts([CALIBRATED])
    name = body.get("record") if word == "teleop" and isinstance(body, dict) else None
    return Facts([name] if isinstance(name, str) and name else [])


def _mappings(parts: Any) -> Sequence[Mapping[str, Any]]:  # noqa: ANN401 (of a file)
    return [part if isinstance(part, dict) and part else {"": None} for part in parts_of(parts)]


def _join(ends: Ends, others: Ends) -> None:
    """Another path leads to these outcomes."""
    for name, facts in others.items():
        ends[name] = ends[name] & facts if name in ends else facts


def _and(ends: Ends, facts: Facts) -> Ends:
    return {name: done | facts for name, done in ends.items()}


def _but(ends: Ends, *names: str) -> Ends:
    return {name: facts for name, facts in ends.items() if name not in names}


def _of(ends: Ends, names: Sequence[str]) -> Ends:
    """Those that a `try` may call by one of these names."""
    kinds = {f"{name}".partition(":")[0] for name in names}
    if FAULT in kinds:
        kinds.add(LOST)
    return {name: facts for name, facts in ends.items() if name in kinds}


def _condition(steps: Any, path: Path, target: Path) -> str:  # noqa: ANN401 (of a file)
    """What has to happen for a step to be done before another one."""
    shared = next(index for index, (a, b) in enumerate(zip(path, target, strict=False)) if a != b)
    of: Any = {"steps": steps}
    left = ""
    for index, key in enumerate(path[:-1]):
        word, of, after = path[index - 1] if index else "", of[key], path[index + 1]
        if index < shared:
            continue
        if word == "choose":
            return f"only runs if {of['if']}" if of.get("if") else "only runs if no condition above it holds"
        if (word, key) == ("try", "catch"):
            return f"only runs after {after}"
        if (word, key) == ("try", "between"):
            return "only runs before a retry"
        if (word, key) == ("during", "when"):
            return f"only runs once {of[after]['if']}"
        if word in ("try", "during", "together"):
            left = left or f"may be left before it is done, as {dotted(path[:index])} says"
    return left
