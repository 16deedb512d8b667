"""What a schema found wrong, in plain words: what was expected, what was found, the nearest valid name."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Iterator, Mapping
from typing import Any, TypeVar, cast, get_args

from pydantic import BaseModel, ValidationError
from pydantic.json_schema import SkipJsonSchema
from pydantic_core import ErrorDetails

from artemis.config import Config, Inconsistent
from artemis.errors import ConfigError, shown
from artemis.mounting import Mounting
from artemis.yaml_file import Data, Document, KeyPath, dotted, surprise

LAST_BRANCH = "a last branch without `if`"
"""Of `choose`: what other languages call `else`."""
UNKNOWN_KEY = "unknown key"
NO_ELSE = f"{UNKNOWN_KEY}; write {LAST_BRANCH}"
_MAX_NAMED = 12

Model = TypeVar("Model", bound=Config)

_INNER = cast(type, SkipJsonSchema)  # marks a field that is no key of a file
_REPLACED = {
    "discharge_v_per_h": "the battery is discharged by what the robot takes; to see that, drive longer, or describe a "
    "small battery in the robot file: robots/artemis_small_battery.yaml",
    "charge_v_per_h": "a charger gives a current: write current_a",
}
"""Keys of earlier versions, with what to write instead."""
_EXPECTED = {
    "string_type": "text",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "list_type": "a list",
    "tuple_type": "a list",
    "greater_than": "more than {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than": "less than {lt}",
    "less_than_equal": "at most {le}",
    "literal_error": "{expected}",
    "string_too_short": "text",
    "string_too_long": "at most {max_length} characters",
    "string_pattern_mismatch": "text like {pattern}",
    "too_short": "a list of at least {min_length}",
    "too_long": "a list of at most {max_length}",
}
_HINTED = {"int_type", "int_from_float", "float_type", "bool_type"}


def closest(word: str, names: Collection[str]) -> str:
    """The name that a misspelt word probably means; empty: none is similar."""
    similar = difflib.get_close_matches(word.lower(), [name.lower() for name in names], n=1)
    return next(name for name in names if name.lower() == similar[0]) if similar else ""


def nearest(word: str, names: Collection[str], kind: str = "names") -> str:
    """Ending of a message about an unknown word: the most similar of the names, or which there are."""
    if found := closest(word, names):
        return f"; did you mean {found}?"
    if not names:
        return f"; there are no {kind}"
    shown = sorted(names)[:_MAX_NAMED]
    return f"; {kind}: " + ", ".join(shown) + (", ..." if len(names) > len(shown) else "")


def checked(model: type[Model], values: Mapping[str, object], source: str = "") -> Model:
    """Values that stand in no file; `source`: where they do stand, in words.

    Raises:
        ConfigError: some are wrong; a line with source and key for each.
    """
    try:
        return model.model_validate(values)
    except ValidationError as error:
        document = Document("", b"", cast(Data, values), {(): (1, 1)})
        found = placed(error, document, model, at=())
        raise ConfigError([": ".join(filter(None, (source, dotted(path), text))) for path, text in found]) from None


def describe(value: object) -> str:
    """A value as its writer would name it."""
    match value:
        case None:
            return "nothing"
        case bool():
            return "true" if value else "false"
        case Mapping():
            return "a mapping"
        case list() | tuple():
            return f"a list of {len(value)}"
        case str() if not value:
            return "empty text"
    return shown(value)


def problems_from(error: ValidationError, document: Document, model: type[BaseModel]) -> list[str]:
    """One line with file, position and key for each error that `model` found in a document."""
    return [document.problem(path, text) for path, text in placed(error, document, model, at=())]


def placed(
    error: ValidationError, document: Document, model: type[BaseModel], at: KeyPath
) -> list[tuple[KeyPath, str]]:
    """The same of the part of a document at `at`, as key paths and words."""
    found = [(_path(document, (*at, *detail["loc"])), detail) for detail in error.errors(include_url=False)]
    beside: tuple[str, ...] = ("plugin",) if at[-1:] == ("follower",) else ()  # its own keys stand beside its name
    if at[:1] == ("scanners",):  # and a scanner's beside its mounting
        beside = tuple(Mounting.model_fields)
    problems: list[tuple[KeyPath, str]] = []
    for path, detail in found:
        if _follows_from_damage(document, path, detail["type"]) or _is_long_enough(detail):
            continue
        reason = detail.get("ctx", {}).get("error")
        if isinstance(reason, Inconsistent):
            problems += [((*path, *below), text) for below, text in reason.problems]
        else:
            problems.append((path, _words(detail, model, path[len(at) :], beside)))
    return problems


def _follows_from_damage(document: Document, path: KeyPath, kind: str) -> bool:
    """Whether reading the document found the cause already."""
    if kind == "missing":
        return (*path[:-1], "<<") in document.damaged
    if kind == "value_error":  # of a whole mapping: any part of it may be the cause
        return any(damaged[: len(path)] == path for damaged in document.damaged)
    return path in document.damaged


def _is_long_enough(detail: ErrorDetails) -> bool:
    """Whether a list is called too short only because what is wrong in it, which is told, does not count."""
    return detail["type"] == "too_short" and len(detail["input"]) >= detail["ctx"]["min_length"]


def _path(document: Document, location: KeyPath) -> KeyPath:
    """Key path of an error location, without the parts that name branches of the schema instead of keys."""
    path: list[str | int] = []
    part: Any = document.data
    for number, key in enumerate(location, start=1):
        last = number == len(location)
        if isinstance(part, dict) and isinstance(key, str) and (key in part or (last and not {*"[>"} & {*key})):
            path.append(key)
            part = part.get(key)
        elif isinstance(part, list) and isinstance(key, int) and (key < len(part) or last):
            path.append(key)
            part = part[key] if key < len(part) else None
    return tuple(path)


def _words(detail: ErrorDetails, model: type[BaseModel], path: KeyPath, beside: tuple[str, ...]) -> str:
    kind, found, context = detail["type"], detail["input"], detail.get("ctx", {})
    if kind == "missing":
        return _missing(found, model, path)
    if kind == "extra_forbidden":
        fields = [field for around in _models_around(model, path) for field in around.model_fields.items()]
        own = [(name, field) for name, field in fields if not any(isinstance(it, _INNER) for it in field.metadata)]
        known = [*beside, *(field.alias or name for name, field in own)]
        if "catch" in known and path[-1] == "on":
            why = "readers of YAML 1.1 take the key `on` for true: no key is called so"
            return f"{UNKNOWN_KEY}; did you mean catch? ({why})"
        if path[-1] == "else" and "choose" in path:
            return NO_ELSE
        if path[-1] in _REPLACED:
            return f"{UNKNOWN_KEY}; {_REPLACED[path[-1]]}"
        return f"{UNKNOWN_KEY}{nearest(str(path[-1]), known, 'known keys')}"
    if kind == "value_error":
        return f"{context['error']}" + (f", found {describe(found)}" if isinstance(found, str) else "")
    if kind == "union_tag_invalid":  # the alternatives are named as in a file, in angle brackets and with blanks
        known = [tag.strip("'<>").replace(" ", "_") for tag in context["expected_tags"].split(", ")]
        return f"{context['tag']} is unknown{nearest(context['tag'], known, 'known')}"
    if kind not in _EXPECTED:
        return f"expected {detail['msg'].removeprefix('Input should be ')}, found {describe(found)}"
    context = {key: f"{bound:g}" if isinstance(bound, float) else bound for key, bound in context.items()}
    text = f"expected {_EXPECTED[kind].format(**context)}, found {describe(found)}"
    if kind == "literal_error" and isinstance(found, str):
        names = [name.strip("'") for name in context["expected"].replace(" or ", ", ").split(", ")]
        meant = closest(found, names)
        return text + (f"; did you mean {meant}?" if meant else "")
    hint = surprise(found) if kind in _HINTED and isinstance(found, str) else None
    if path[-1:] == ("goto",) and isinstance(found, str):
        hint = f"write {{map: FILE, to: {found}}}"
    return f"{text}: {hint}" if hint else text


def _missing(around: object, model: type[BaseModel], path: KeyPath) -> str:
    if isinstance(path[-1], int):
        return "the list is too short"
    is_open = any(found.model_config.get("extra") == "allow" for found in _models_around(model, path))
    # a misspelt key passes for a plugin's or back end's own
    similar = closest(path[-1], around) if is_open and isinstance(around, dict) else ""
    return "this key is missing" + (f"; did you write {similar} for it?" if similar else "")


def _models_around(model: type[BaseModel], path: KeyPath) -> list[type[BaseModel]]:
    """The model (or models, in a union) of the mapping around the last key."""
    models = [model]
    for key in path[:-1]:  # an index, or a key of the user's own, leads no deeper
        fields = [field for m in models for name, field in m.model_fields.items() if key == (field.alias or name)]
        models = [found for field in fields for found in _models(field)] or models
    return models


def _models(field: object) -> Iterator[type[BaseModel]]:
    annotation = getattr(field, "annotation", field)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models(argument)


def by_position(problem: str) -> tuple[str, int, int]:
    """Key to sort problems by: file, line, column."""
    place = re.match(r"(.*?):(\d+):(\d+): ", problem)
    return (place[1], int(place[2]), int(place[3])) if place else (problem, 0, 0)
