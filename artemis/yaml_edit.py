"""Change single values of a YAML file and leave all the rest as its writer left it: comments, order, anchors."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

import yaml

from artemis.errors import ConfigError
from artemis.whole_files import replace_content
from artemis.yaml_file import Data, KeyPath, dotted, read, survey

Keys = tuple[str, ...]
"""Where a value stands: its keys from the top."""
_ROUNDS = 5
"""A change inside an anchor changes its aliases, too: what those had is written out; that may go on so deep."""
_ALIAS = re.compile(r"\s*\*[^\s,\]}]+")
_ANCHOR = re.compile(r"&\S+")


def edit(path: Path, changes: Mapping[Keys, Data]) -> None:
    """Change values of a file; either all of it is changed or nothing.

    Raises:
        ConfigError: the file cannot be read or written, or a value cannot be changed in place.
    """
    replace_content(path, edited(read(path), str(path), changes))


def edited(raw: bytes, source: str, changes: Mapping[Keys, Data]) -> bytes:
    """The content `raw` of a file with other values; keys that it lacks are added.

    Args:
        raw: A mapping in strict YAML.
        source: Its name, for errors.
        changes: New values by their keys. The mapping around each must be there.

    Raises:
        ConfigError: the file is broken, or a value cannot be changed in place; with its key.
    """
    wanted = _read(raw, source)
    for keys, value in changes.items():
        _set(wanted, keys, value, source)
    for _ in range(_ROUNDS):
        left = list(_differences(_read(raw, source), wanted))
        if not left:
            return raw
        for keys in left:
            raw = _with(raw.decode(), keys, wanted).encode()
    raise ConfigError(f"{source}: {dotted(left[0])}: cannot be changed in place; write it by hand")


def with_words(raw: bytes, source: str, words: Mapping[KeyPath, str]) -> bytes:
    """The content of a file with other numbers or names, each where the old one stands; all else stays as it is.

    Args:
        raw: A mapping in strict YAML.
        source: Its name, for errors.
        words: What is to stand at such keys and numbers of items.

    Raises:
        ConfigError: the file is broken, or an anchor gives two values one number that would differ.
    """
    _read(raw, source)
    text = raw.decode()
    top, found = yaml.compose(text, Loader=yaml.SafeLoader), dict[tuple[int, int], str]()
    for path, word in words.items():
        value: Any = top
        for key in path:
            value = value.value[key] if isinstance(key, int) else next(_parts(value, key))
        begin, end = int(value.start_mark.index), int(value.end_mark.index)
        if anchor := _ANCHOR.match(text, begin):
            begin, word = anchor.end(), f" {word}"
        if found.setdefault((begin, end), word) != word:
            raise ConfigError(
                f"{source}: {dotted(path)}: shares its anchor with a value that will differ; write both out"
            )
    for (begin, end), word in sorted(found.items(), reverse=True):
        text = f"{text[:begin]}{word}{text[end:]}"
    return text.encode()


def _parts(mapping: yaml.MappingNode, key: str) -> Iterator[yaml.Node]:
    """What stands at a key: in the mapping itself, then in those that it is merged with."""
    yield from (value for name, value in mapping.value if name.value == key)
    for name, merged in mapping.value:
        if name.tag == "tag:yaml.org,2002:merge":
            for each in merged.value if isinstance(merged, yaml.SequenceNode) else [merged]:
                yield from _parts(each, key)


def with_line(raw: bytes, source: str, key: str, entry: str) -> bytes:
    """The content of a file with another entry below those of a block, on a line of its own; it begins the block.

    Args:
        raw: A mapping in strict YAML, or nothing.
        source: Its name, for errors.
        key: Of a list or mapping at the top.
        entry: As it is written: `- VALUE`, or `NAME: VALUE`.

    Raises:
        ConfigError: the file is broken, or the block is not written line by line.
    """
    text = raw.decode()
    found = None if is_blank(raw) or not _read(raw, source) else _block(text, key)
    if found is None:
        return f"{text.rstrip()}\n{key}:\n  {entry}\n".lstrip().encode()
    name, block = found
    if _is_one_piece(block) and not (isinstance(block, yaml.CollectionNode) and not block.value):
        raise ConfigError(f"{source}: {key}: is not written line by line; change it by hand")
    if _is_one_piece(block):  # [] or {}
        return f"{text[: name.end_mark.index]}:\n  {entry}{text[block.end_mark.index :]}".encode()
    end = text.find("\n", _end(block))
    end = len(text) if end < 0 else end
    first = block.value[0]
    column = int((first[0] if isinstance(first, tuple) else first).start_mark.column)
    column -= 0 if isinstance(first, tuple) else 2
    return f"{text[:end]}\n{' ' * column}{entry}{text[end:]}".encode()


def without_line(raw: bytes, source: str, key: str, entry: int | str) -> bytes:
    """The content of a file without one entry of a block: an item of a list by its number from 0, or a key.

    Args:
        raw: A mapping in strict YAML that has it.
        source: Its name, for errors.
        key: Of the list or mapping at the top.
        entry: Which one.

    Raises:
        ConfigError: the file is broken, or the block is not written line by line.
    """
    _read(raw, source)
    text = raw.decode()
    found = _block(text, key)
    assert found is not None
    name, block = found
    if _is_one_piece(block):
        raise ConfigError(f"{source}: {key}: is not written line by line; change it by hand")
    if len(block.value) == 1:
        end = _end(block)
        empty = "[]" if isinstance(block, yaml.SequenceNode) else "{}"
        return f"{text[: name.end_mark.index]}: {empty}{text[end:]}".encode()
    if isinstance(entry, int):
        begin, end = block.value[entry].start_mark.index, _end(block.value[entry])
    else:
        begin, end = next((each.start_mark.index, _end(value)) for each, value in block.value if each.value == entry)
    begin, stop = text.rfind("\n", 0, begin) + 1, text.find("\n", end)
    return f"{text[:begin]}{text[stop + 1 :] if stop >= 0 else ''}".encode()


def is_blank(raw: bytes) -> bool:
    """Whether a file holds nothing but comments."""
    return not any(line.strip() and not line.lstrip().startswith(b"#") for line in raw.splitlines())


def _block(text: str, key: str) -> tuple[yaml.Node, yaml.Node] | None:
    top = yaml.compose(text, Loader=yaml.SafeLoader)
    assert isinstance(top, yaml.MappingNode)
    return _entry(top, key)


def _read(raw: bytes, source: str) -> dict[str, Data]:
    document, problems = survey(raw, source)
    if problems or not isinstance(document.data, dict):
        raise ConfigError(problems or f"{source}: expected keys with values")
    return deepcopy(document.data)  # what an anchor and its aliases share must not be changed at once


def _set(data: dict[str, Data], keys: Keys, value: Data, source: str) -> None:
    for key in keys[:-1]:
        part = data.get(key)
        if not isinstance(part, dict):
            raise ConfigError(f"{source}: {dotted(keys)}: there is no mapping {key}")
        data = part
    data[keys[-1]] = value


def _differences(found: dict[str, Data], wanted: dict[str, Data], path: Keys = ()) -> Iterator[Keys]:
    for key, value in wanted.items():
        present = found.get(key)
        if isinstance(value, dict) and isinstance(present, dict) and present.keys() <= value.keys():
            yield from _differences(present, value, (*path, key))
        elif key not in found or repr(present) != repr(value):  # true is not 1, nor 1 the same as 1.0
            yield (*path, key)


def _with(text: str, keys: Keys, wanted: Data) -> str:
    """The text with the value at `keys` as in `wanted`, where it stands, or added to its mapping.

    A mapping around it that stands elsewhere, behind an alias or a merge key, is written out whole.
    """
    mapping = yaml.compose(text, Loader=yaml.SafeLoader)
    for number, key in enumerate(keys, 1):
        assert isinstance(mapping, yaml.MappingNode)
        assert isinstance(wanted, dict)
        entry, wanted = _entry(mapping, key), wanted[key]
        if entry is None:
            return _added(text, mapping, f"{key}: {_written(wanted)}")
        name, old = entry
        if _is_alias(name, old) or number == len(keys):
            break
        mapping = old
    if _is_alias(name, old):
        begin = text.index(":", int(name.end_mark.index)) + 1
        alias = _ALIAS.match(text, begin)
        assert alias
        return f"{text[:begin]} {_written(wanted)}{text[alias.end() :]}"
    begin = int(old.start_mark.index if _is_one_piece(old) else text.index(":", name.end_mark.index) + 1)
    if anchor := _ANCHOR.match(text, old.start_mark.index):
        begin = anchor.end()
    return f"{text[:begin].rstrip(' ')} {_written(wanted)}{text[_end(old) :]}"


def _entry(mapping: yaml.MappingNode, key: str) -> tuple[yaml.Node, yaml.Node] | None:
    """Key and value that stand in the mapping itself."""
    return next(((name, value) for name, value in mapping.value if name.value == key), None)


def _is_alias(name: yaml.Node, value: yaml.Node) -> bool:
    return bool(value.start_mark.index < name.end_mark.index)


def _end(node: yaml.Node) -> int:
    """Where the text of a value ends; what the parser calls the end of a block is the beginning of the next."""
    if _is_one_piece(node):
        return int(node.end_mark.index)
    last = node.value[-1]
    if isinstance(last, yaml.Node):
        return _end(last)
    name, value = last
    return int(name.end_mark.index) if _is_alias(name, value) else _end(value)


def _is_one_piece(node: yaml.Node) -> bool:
    return not isinstance(node, yaml.CollectionNode) or bool(node.flow_style) or not node.value


def _added(text: str, mapping: yaml.MappingNode, entry: str) -> str:
    """The text with another entry: before the closing bracket, or below the first entry."""
    end = int(mapping.end_mark.index) - 1
    if mapping.flow_style:
        head = text[:end].rstrip(", ")
        return f"{head}, {entry}{text[end:]}" if mapping.value else f"{head}{entry}{text[end:]}"
    name, value = mapping.value[0]
    begin = int(name.start_mark.index)
    indent = "\n" + " " * int(name.start_mark.column)
    if _is_alias(name, value) or _is_one_piece(value):
        end = text.find("\n", int(name.end_mark.index) if _is_alias(name, value) else _end(value))
        end = len(text) if end < 0 else end
        return text[:end] + indent + entry + text[end:]
    return text[:begin] + entry + indent + text[begin:]


def _written(value: Data) -> str:
    """A value on one line."""
    match value:
        case dict():
            return "{" + ", ".join(f"{key}: {_written(part)}" for key, part in value.items()) + "}"
        case list() | tuple():
            return "[" + ", ".join(map(_written, value)) + "]"
        case bool() | None:
            return "null" if value is None else str(value).lower()
        case str():
            return "'" + value.replace("'", "''") + "'"
        case _:
            return repr(value)
