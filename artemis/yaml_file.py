"""Strict YAML files with positions: every surprise is refused where it stands. The only file that imports yaml.

Scalars follow the core schema of YAML 1.2 (10.3.2), narrowed: only `true` and `false` are truth values, only `null`,
`~` and nothing are null, dates and `1:30` stay text, `010`, `.inf` and `.nan` are refused. Merge keys (`<<`, YAML 1.1)
work; tags, several documents and duplicate keys are refused; size, depth and aliases are bounded.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import yaml

from artemis.errors import ConfigError

MAX_BYTES, MAX_DEPTH, MAX_ALIASES = 1 << 20, 20, 50
MAX_NODES, MAX_MESSAGE_NODES = 10_000, 2_000_000
"""Keys, values and list items of one document, aliases counted as often as they are used; and of a program's file."""

Scalar: TypeAlias = bool | int | float | str | None
Data: TypeAlias = "Scalar | list[Data] | dict[str, Data]"
KeyPath: TypeAlias = tuple[str | int, ...]
Position: TypeAlias = tuple[int, int]
"""Line and column, both from 1."""

_INTEGER = re.compile(r"[-+]?(?:0|[1-9][0-9]*)|0x[0-9a-fA-F]+")
_OCTAL = re.compile(r"[-+]?0[0-9_]+|0o[0-7]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)")
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f\ud800-\udfff]")
_WORDS: Mapping[str, Scalar] = {"": None, "~": None, "null": None, "true": True, "false": False}
_STANDARD_TAG = "tag:yaml.org,2002:"
_TORN = re.compile(r"([-+]?[0-9]+,[0-9]+)\s*[,}]")  # in `{a: 0,5}` YAML reads a 0, and a key 5 without a value
_MAX_DIGITS, _MAX_SHOWN = 20, 60

_SURPRISES: tuple[tuple[re.Pattern[str], str], ...] = (
    (re.compile(r"(?i:on|yes|y)|True|TRUE"), "{0} is a word in artemis' YAML, write true"),
    (re.compile(r"(?i:off|no|n)|False|FALSE"), "{0} is a word in artemis' YAML, write false"),
    (re.compile(r"true|false|" + _INTEGER.pattern + "|" + _FLOAT.pattern), "remove the quotes"),
    (re.compile(r"[0-9]{4}-[0-9]{1,2}-[0-9]{1,2}(?:[Tt ].*)?"), "a date is text in artemis' YAML"),
    (re.compile(r"[-+]?[0-9]+(?::[0-5]?[0-9])+(?:\.[0-9]*)?"), "{0} is text in artemis' YAML, write plain seconds"),
    (re.compile(r"[-+]?[0-9][0-9_.]*_[0-9_.]*"), "digits with _ are text in artemis' YAML, leave the _ out"),
    (re.compile(r"[-+]?[0-9]+,[0-9]+"), "a number with a decimal comma: write {1}"),
    (re.compile(r"[-+]?[0-9.]+ *[a-zA-Z°%µ/²]+[0-9]?"), "write the number alone: its unit stands in the key"),
)

_SYNTAX: tuple[tuple[str, str], ...] = (
    (r"found character '\t'", "a tab: indent and separate with spaces"),
    ("found character", "this character cannot begin a value: put the text in quotes"),
    ("mapping values are not allowed", "a colon cannot stand here: check the indentation, or put the text in quotes"),
    ("could not find expected ':'", "a line that is not `key: value`: the colon and a space after the key are missing"),
    ("expected <block end>", "the indentation does not fit the lines above, or text follows a closed quote or bracket"),
    ("expected ',' or ']'", "a list [...] is not closed, or a comma is missing"),
    ("expected ',' or '}'", "a mapping {...} is not closed, or a comma is missing"),
    ("found unexpected", "a quoted text is not closed"),
    ("expected the node content", "a value is missing, or a bracket or comma too many"),
    ("expected '<document start>'", "the text continues after its end: check the indentation"),
    ("found unknown escape character", "unknown escape in double quotes: use single quotes"),
    ("sequence entries are not allowed", "a list item `-` cannot stand here: put it on a line of its own"),
)


@dataclass(frozen=True, slots=True)
class Document:
    """One YAML file as plain data, and where in the file each part of it stands."""

    source: str
    """Name of the file, as given."""
    raw: bytes
    """The file as read."""
    data: Data
    positions: Mapping[KeyPath, Position]
    damaged: frozenset[KeyPath] = frozenset()
    """Where reading found something wrong: what a schema finds there too is no news."""

    def position(self, path: KeyPath) -> Position:
        """Where the key at `path` stands (a list item: its value); if missing, the nearest part around it."""
        while path not in self.positions:
            path = path[:-1]
        return self.positions[path]

    def problem(self, path: KeyPath, text: str) -> str:
        """One line for people: `file:line:column: dotted key: text`."""
        return _line(self.source, self.position(path), path, text)


def dotted(path: KeyPath) -> str:
    """Key path as people write it: `steps[1].follow.path`."""
    text = ""
    for key in path:
        text += f"[{key}]" if isinstance(key, int) else f".{_short(key)}" if text else _short(key)
    return text


def _short(key: str) -> str:
    word = key if len(key) <= _MAX_SHOWN else key[:_MAX_SHOWN] + "..."
    return word if word and word.isprintable() else repr(word)


def surprise(text: str) -> str | None:
    """Why a text is not the number or truth value that its writer may have meant, or None."""
    return next((hint.format(text, text.replace(",", ".")) for seen, hint in _SURPRISES if seen.fullmatch(text)), None)


def read(path: Path, max_bytes: int = MAX_BYTES) -> bytes:
    """Content of a regular file of at most `max_bytes`.

    Raises:
        ConfigError: missing, not a regular file, unreadable or too large.
    """
    try:
        if path.is_dir():
            raise ConfigError(f"{path}: is a directory, expected a file")
        if path.exists() and not path.is_file():
            raise ConfigError(f"{path}: is not a regular file")
        with path.open("rb") as file:
            raw = file.read(max_bytes + 1)
    except FileNotFoundError:
        raise ConfigError(f"{path}: file not found") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a file name"
        raise ConfigError(f"{path}: cannot be read: {reason}") from error
    if len(raw) > max_bytes:
        raise ConfigError(f"{path}: larger than {max_bytes} bytes")
    return raw


def load(path: Path) -> Document:
    """Read one YAML file. Raises ConfigError: everything wrong with it as a file and as strict YAML."""
    document, problems = survey(read(path), str(path))
    if problems:
        raise ConfigError(problems)
    return document


def survey(raw: bytes, source: str, *, messages: bool = False) -> tuple[Document, list[str]]:
    """The document, and the problems that leave the rest of it readable, so that a schema can add its own.

    With `messages`, of a program, it is the list of all documents that are not empty, up to `MAX_MESSAGE_NODES` large.

    Raises:
        ConfigError: not UTF-8, broken syntax, several documents or too much of it: the rest cannot be read.
    """
    composer = _Composer(source, _text(raw, source), MAX_MESSAGE_NODES if messages else MAX_NODES)
    nodes = composer.roots(several=messages)
    listed = _Node((1, 1), [node for node in nodes if node.content is not None])
    root = listed if messages else nodes[0] if nodes else _Node((1, 1), None)
    positions: dict[KeyPath, Position] = {}
    data = _flatten(root, (), positions)
    return Document(source, raw, data, positions, frozenset(composer.damaged)), composer.problems


def scalar(text: str) -> Scalar:
    """One value as in a file: `hop_limit: 0` and `--option hop_limit=0` mean the same. ConfigError where refused."""
    if not text:
        return None
    document, problems = survey(text.encode(errors="surrogateescape"), repr(text))
    if problems:
        raise ConfigError(problems)
    if isinstance(document.data, list | dict):
        raise ConfigError(f"{text!r}: expected one value, not a list or a mapping")
    return document.data


def _line(source: str, position: Position, path: KeyPath, text: str) -> str:
    key = f"{dotted(path)}: " if path else ""
    words = text if text.isprintable() else "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
    return f"{source}:{position[0]}:{position[1]}: {key}{words}"


def _text(raw: bytes, source: str) -> str:
    if raw.startswith((b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff")):
        raise ConfigError(f"{source}:1:1: begins with a byte order mark: save it as UTF-8 without BOM")
    if raw.startswith((b"P2\n", b"P5\n", b"\x89PNG")):
        raise ConfigError(f"{source}:1:1: is an image: name the YAML file of the map")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as error:
        before = raw[: error.start].decode("utf-8")
        line, column = _place(before, len(before))
        raise ConfigError(f"{source}:{line}:{column}: byte 0x{raw[error.start]:02x} is not UTF-8") from None


def _place(text: str, index: int) -> Position:
    return text.count("\n", 0, index) + 1, index - (text.rfind("\n", 0, index) + 1) + 1


@dataclass(frozen=True, slots=True)
class _Node:
    position: Position
    """Of its key in a mapping, else its own."""
    content: Scalar | list[_Node] | dict[str, _Node]
    size: int = 1
    """Nodes in it, itself included, aliases expanded."""
    height: int = 0
    """Lists and mappings inside each other, itself included."""


def _flatten(node: _Node, path: KeyPath, positions: dict[KeyPath, Position]) -> Data:
    positions[path] = node.position
    if isinstance(node.content, dict):
        return {key: _flatten(child, (*path, key), positions) for key, child in node.content.items()}
    if isinstance(node.content, list):
        return [_flatten(child, (*path, index), positions) for index, child in enumerate(node.content)]
    return node.content


def _node(position: Position, content: list[_Node] | dict[str, _Node]) -> _Node:
    children = list(content.values()) if isinstance(content, dict) else content
    size = 1 + sum(child.size for child in children)
    return _Node(position, content, size, 1 + max((child.height for child in children), default=0))


class _Composer:
    """Turns the parser's events into nodes; PyYAML's own composer and constructors are too lenient."""

    def __init__(self, source: str, text: str, most: int) -> None:
        self._most = most
        self.problems: list[str] = []
        self.damaged: list[KeyPath] = []
        self._source = source
        self._text = text
        self._anchors: dict[str, _Node | None] = {}  # None while the anchored node is still open
        self._aliases = self._nodes = 0
        try:
            self._parser = yaml.SafeLoader(text)
        except yaml.reader.ReaderError as error:
            place = _place(text, error.position)
            raise self._fatal(place, f"character U+{error.character:04X} is not allowed in YAML") from None

    def roots(self, *, several: bool) -> list[_Node]:
        """The root node of each document, of which there is one at most unless `several`."""
        roots: list[_Node] = []
        self._next()  # stream start
        while not isinstance(begin := self._next(), yaml.StreamEndEvent):
            if roots and not several:
                raise self._fatal(_position(begin.start_mark), "a second document begins: one file holds one")
            event = self._next()
            roots.append(self._compose(event, _position(event.start_mark), ()))
            self._anchors.clear()
            self._next()  # document end
        return roots

    def _fatal(self, position: Position, text: str, path: KeyPath = ()) -> ConfigError:
        return ConfigError([*self.problems, _line(self._source, position, path, text)])

    def _complain(self, position: Position, path: KeyPath, text: str) -> None:
        self.problems.append(_line(self._source, position, path, text))
        self.damaged.append(path)

    def _next(self) -> yaml.Event:
        try:
            event: yaml.Event = self._parser.get_event()  # type: ignore[no-untyped-call]  # the stubs leave it out
        except yaml.MarkedYAMLError as error:
            problem = error.problem or error.context or ""
            words = next((words for part, words in _SYNTAX if part in problem), problem)
            begin = _position(error.context_mark)
            since = f" (it begins at {begin[0]}:{begin[1]})" if "not closed" in words else ""
            raise self._fatal(_position(error.problem_mark), f"not YAML: {words}{since}") from None
        except (ValueError, OverflowError):  # the parser trusts numbers in escapes and directives
            place = _position(self._parser.get_mark())
            raise self._fatal(place, "not YAML: a number that names no character or version") from None
        return event

    def _compose(self, event: yaml.Event, where: Position, path: KeyPath) -> _Node:
        """The node that begins with `event`; `where` is the position to report for it."""
        if isinstance(event, yaml.AliasEvent):
            return self._alias(event, where, path)
        self._count(1, where, path)
        if len(path) >= MAX_DEPTH and not isinstance(event, yaml.ScalarEvent):
            raise self._fatal(where, f"nested more than {MAX_DEPTH} deep")
        if isinstance(event, yaml.ScalarEvent | yaml.CollectionStartEvent) and event.tag is not None:
            self._complain(where, path, f"tags are refused: {event.tag.replace(_STANDARD_TAG, '!!')}")
        anchor = event.anchor if isinstance(event, yaml.NodeEvent) else None
        if anchor is not None:
            if anchor in self._anchors:
                self._complain(where, path, f"anchor &{anchor} is defined twice")
            self._anchors[anchor] = None
        if isinstance(event, yaml.ScalarEvent):
            node = _Node(where, self._scalar(event, where, path))
        else:
            node = (self._sequence if isinstance(event, yaml.SequenceStartEvent) else self._mapping)(where, path)
        if anchor is not None:
            self._anchors[anchor] = node
        return node

    def _count(self, nodes: int, where: Position, path: KeyPath) -> None:
        self._nodes += nodes
        if self._nodes > self._most:
            raise self._fatal(where, f"more than {self._most} values (aliases expanded)", path)

    def _alias(self, event: yaml.AliasEvent, where: Position, path: KeyPath) -> _Node:
        self._aliases += 1
        if self._aliases > MAX_ALIASES:
            raise self._fatal(where, f"more than {MAX_ALIASES} aliases", path)
        target = self._anchors.get(event.anchor or "")
        if target is None:
            text = "is inside its own anchor" if event.anchor in self._anchors else "has no anchor before it"
            self._complain(where, path, f"alias *{event.anchor} {text}")
            return _Node(where, {} if path[-1:] == ("<<",) else None)
        if len(path) + target.height > MAX_DEPTH:
            raise self._fatal(where, f"nested more than {MAX_DEPTH} deep")
        self._count(target.size, where, path)
        return _Node(where, target.content, target.size, target.height)

    def _sequence(self, where: Position, path: KeyPath) -> _Node:
        items: list[_Node] = []
        while not isinstance(event := self._next(), yaml.SequenceEndEvent):
            items.append(self._compose(event, _position(event.start_mark), (*path, len(items))))
        return _node(where, items)

    def _mapping(self, where: Position, path: KeyPath) -> _Node:
        entries: dict[str, _Node] = {}
        merged: _Node | None = None
        key, place, begin = "", where, 0
        while not isinstance(event := self._next(), yaml.MappingEndEvent):
            end = event.end_mark
            if end and (torn := _TORN.match(self._text, begin)) and torn.end(1) == end.index:
                self._complain(place, (*path, key), str(surprise(torn[1])))
                self._next()
                continue
            place = _position(event.start_mark)
            key = self._key(event, place, path)
            event = self._next()
            begin = event.start_mark.index if event.start_mark else 0
            value = self._compose(event, place, (*path, key))
            earlier = merged if key == "<<" else entries.get(key)
            if earlier is not None:
                line, column = earlier.position
                self._complain(place, (*path, key), f"duplicate key, first at {line}:{column}")
            elif key == "<<":
                merged = value
            else:
                entries[key] = value
        for part in self._merged(merged, path):
            entries = {**entries, **{key: node for key, node in part.items() if key not in entries}}
        return _node(where, entries)

    def _key(self, event: yaml.Event, place: Position, path: KeyPath) -> str:
        if not isinstance(event, yaml.ScalarEvent):
            self._compose(event, place, (*path, "?"))
            self._complain(place, (*path, "?"), "a key must be one word of text")
            return "?"
        key = str(event.value)
        self._count(1, place, path)
        if event.tag is not None or event.anchor is not None or _CONTROL.search(key):
            self._complain(place, (*path, "?"), "a key must be text alone: no tag, no anchor, no control characters")
            return "?"
        if event.implicit[0] and not isinstance(_resolve(key), str):
            self._complain(place, (*path, key), "a key must be text: put it in quotes if it is meant so")
        return key

    def _merged(self, node: _Node | None, path: KeyPath) -> list[dict[str, _Node]]:
        if node is None:
            return []
        parts = [part.content for part in node.content] if isinstance(node.content, list) else [node.content]
        mappings = [part for part in parts if isinstance(part, dict)]
        if len(mappings) < len(parts):
            self._complain(node.position, (*path, "<<"), "expected an alias of a mapping, or a list of such")
        return mappings

    def _scalar(self, event: yaml.ScalarEvent, where: Position, path: KeyPath) -> Scalar:
        text = str(event.value)
        if control := _CONTROL.search(text):
            self._complain(where, path, f"character U+{ord(control[0]):04X} cannot be part of a text")
            return "?"
        if not event.implicit[0]:  # quoted, or a block
            return text
        if _OCTAL.fullmatch(text):
            self._complain(where, path, f"{text} may mean octal or decimal: leave the leading 0 out, or quote it")
            return text
        value = _resolve(text)
        if _NOT_FINITE.fullmatch(text) or (isinstance(value, float) and not math.isfinite(value)):
            self._complain(where, path, f"expected a finite number, found {text}")
            return text
        if isinstance(value, int) and len(text) > _MAX_DIGITS:
            self._complain(where, path, f"a number of {len(text)} digits: at most {_MAX_DIGITS} are meaningful")
            return text
        return value


def _position(mark: yaml.error.Mark | yaml._yaml.Mark | None) -> Position:
    return (mark.line + 1, mark.column + 1) if mark else (1, 1)


def _resolve(text: str) -> Scalar:
    """Value of a plain (unquoted) scalar."""
    if text in _WORDS:
        return _WORDS[text]
    if _INTEGER.fullmatch(text):
        return int(text, 16 if text.startswith("0x") else 10) if len(text) <= 4 * _MAX_DIGITS else 0
    return float(text) if _FLOAT.fullmatch(text) else text
