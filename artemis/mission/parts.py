"""Parts of a mission: steps that are written once, with arguments, and put in where they are called."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from artemis.mission.problems import closest, nearest
from artemis.states.outline import steps_in
from artemis.yaml_file import Document, KeyPath, Position

_ARGUMENT = re.compile(r"\$(?:\{([^\W\d]\w*)\}|([^\W\d]\w*))")
MAX_STEPS = 20_000
"""Of a mission, parts put in."""
MAX_CALLS = 20
"""Of parts inside each other."""
MAX_ARGUMENT = 2_000
"""Characters and values of an argument together: it may be made of others, again and again."""


@dataclass(frozen=True)
class ExpandedDocument(Document):
    """A mission with its parts put in; what is found there stands where the part does."""

    files: Mapping[str, Document] = field(default_factory=dict)
    """Of the parts that stand in files of their own, by name."""

    def position(self, path: KeyPath) -> Position:
        """Where the key at `path` stands in its file."""
        match self._written(path):
            case ("parts", str(name), *below) if name in self.files:
                return self.files[name].position(tuple(below))
            case written:
                return super().position(written)

    def problem(self, path: KeyPath, text: str) -> str:
        """As of a document, in the file where it stands."""
        match self._written(path):
            case ("parts", str(name), *below) if name in self.files:
                return self.files[name].problem(tuple(below), text)
            case written:
                return super().problem(written, text)

    def _written(self, path: KeyPath) -> KeyPath:
        """The path in the file: in a part, where the part was put in."""
        part: Any = self.data
        written: list[str | int] = []
        for key in path:
            if key == "steps" and written[-1:] == ["call"] and isinstance(part, dict) and "steps" in part:
                written = ["parts", part["part"]]
            written.append(key)
            try:
                part = part[key]
            except (KeyError, IndexError, TypeError):
                part = None
        return tuple(written)


def expanded(
    document: Document, files: Mapping[str, Document] | None = None
) -> tuple[Document, list[tuple[KeyPath, str]]]:
    """A mission with its parts put in where they are called; and what is wrong with calls and parts.

    Args:
        document: The mission.
        files: Of its parts that stand in files of their own, by name.
    """
    data = document.data
    if not isinstance(data, dict) or not isinstance(data.get("steps"), list):
        return document, []
    if isinstance(parts := data.get("parts"), dict) and files:
        data = {**data, "parts": parts | {name: file.data for name, file in files.items()}}
    parts = data.get("parts")
    putting = _PuttingIn(parts if isinstance(parts, dict) else {})
    steps = putting.steps(data["steps"], ("steps",), (), None)
    for name in putting.parts:
        if name not in putting.called:
            putting.problems.append((("parts", name), "no step calls this part"))
    found = ExpandedDocument(
        document.source, document.raw, {**data, "steps": steps}, document.positions, document.damaged, files or {}
    )
    return found, putting.problems


class _PuttingIn:
    def __init__(self, parts: Mapping[str, Any]) -> None:
        self.parts = parts
        self.called: set[str] = set()
        self.problems: list[tuple[KeyPath, str]] = []
        self._room = MAX_STEPS

    def steps(self, steps: Any, path: KeyPath, calls: tuple[str, ...], given: Mapping[str, Any] | None) -> Any:  # noqa: ANN401 (of a file)
        """Steps with the arguments `given` and the parts that they call put in; `path`: in the file."""
        found = steps if given is None else self._with(steps, given, path)
        for at, word, body in list(steps_in(found, ())):
            self._room -= 1
            if self._room < 0:
                self.problems.append((path, f"more than {MAX_STEPS} steps, parts put in"))
                self.called.update(self.parts)
                return []
            if word == "call":
                found = _replaced(found, at, self._called(body, (*path, *at), calls))
        return found

    def _called(self, body: Any, path: KeyPath, calls: tuple[str, ...]) -> Any:  # noqa: ANN401 (of a file)
        """What a call stands for."""
        name = body.get("part") if isinstance(body, dict) else body
        if not isinstance(name, str) or (isinstance(body, dict) and not isinstance(body.get("with", {}), dict)):
            self.called.update(self.parts)
            return body  # the schema complains
        at = (*path, "part") if isinstance(body, dict) else path
        part, given = self.parts.get(name), dict(body.get("with", {})) if isinstance(body, dict) else {}
        called = {"part": name, "with": given, "steps": []}
        self.called.add(name)
        if isinstance(body, dict) and "steps" in body:
            self.problems.append((path, "steps: unknown key; known keys: part, with"))
        if name not in self.parts:
            self.problems.append((at, f"no such part{nearest(name, list(self.parts), 'parts')}"))
            self.called.add(closest(name, list(self.parts)))
        elif name in calls:
            self.problems.append((at, f"a part cannot call itself: {' -> '.join([*calls[calls.index(name) :], name])}"))
        elif len(calls) >= MAX_CALLS:
            self.problems.append((at, f"parts call each other more than {MAX_CALLS} deep"))
            self.called.update(self.parts)
        elif isinstance(part, dict) and "file" not in part and isinstance(part.get("takes") or {}, dict):
            takes: Mapping[str, Any] = part.get("takes") or {}
            misfits = list(_misfits(name, takes, given, path))
            arguments = {key: None if misfits else given.get(key, value) for key, value in takes.items()}
            known = [*self.problems, *misfits]
            steps = self.steps(part.get("steps"), ("parts", name, "steps"), (*calls, name), arguments)
            if misfits:  # which parts it calls is known, and nothing else
                steps, self.problems = [], known
            called["steps"] = steps or []
        return called

    def _with(self, value: Any, given: Mapping[str, Any], path: KeyPath) -> Any:  # noqa: ANN401 (of a file)
        """A value of a part with its arguments put in."""
        match value:
            case str():
                whole = _ARGUMENT.fullmatch(value)
                for match in _ARGUMENT.finditer(value):
                    if (name := match[1] or match[2]) not in given:
                        hint = nearest(name, list(given), "arguments")
                        self.problems.append((path, f"the part takes no {name}{hint}"))
                        return value
                if whole:
                    return given[whole[1] or whole[2]]
                return _ARGUMENT.sub(lambda found: str(given[found[1] or found[2]]), value)
            case dict():
                return {key: self._with(inner, given, (*path, key)) for key, inner in value.items()}
            case list():
                return [self._with(inner, given, (*path, index)) for index, inner in enumerate(value)]
        return value


def _misfits(
    name: str, takes: Mapping[str, Any], given: Mapping[str, Any], path: KeyPath
) -> Iterator[tuple[KeyPath, str]]:
    for key, default in takes.items():
        if default is None and key not in given:
            yield path, f"part {name} needs the argument {key}: write with: {{{key}: ...}}"
    for key in given:
        if key not in takes:
            yield (*path, "with", key), f"part {name} takes no {key}{nearest(key, list(takes), 'arguments')}"
        elif next(islice(_atoms(given[key]), MAX_ARGUMENT, None), None) is not None:
            larger = f"larger than {MAX_ARGUMENT} characters and values together: write it where it is used"
            yield (*path, "with", key), f"the argument {key} of part {name} is {larger}"


def _atoms(value: Any) -> Iterator[str]:  # noqa: ANN401 (of a file)
    """The characters and values in an argument."""
    yield ""
    match value:
        case str():
            yield from value
        case dict():
            for key, inner in value.items():
                yield from key
                yield from _atoms(inner)
        case list():
            for inner in value:
                yield from _atoms(inner)


def _replaced(data: Any, path: KeyPath, value: Any) -> Any:  # noqa: ANN401 (of a file)
    """The same data with another value at a path."""
    if not path:
        return value
    key, *below = path
    if isinstance(data, list):
        return [_replaced(inner, tuple(below), value) if index == key else inner for index, inner in enumerate(data)]
    return {**data, key: _replaced(data[key], tuple(below), value)}


def without(data: Any, path: KeyPath) -> Any:  # noqa: ANN401 (of a file)
    """The same data without the key at a path, where it is there."""
    around: Any = data
    for key in path[:-1]:
        around = around[key]
    return _replaced(data, path[:-1], {key: value for key, value in around.items() if key != path[-1]})
