"""The reference of a mission's steps, made from its schema."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from artemis.plugins.registry import BEHAVIOURS, declarations, names
from artemis.progress import DONE
from artemis.states.outcomes import ends_words, outcomes
from artemis.states.tree import TIMEOUT

_ENDS = {
    "say": "`done`, at once",
    "repeat": "`done` after the last round; else with what a step within ends with",
    "try": "what its steps end with, if it does not catch that; else with what the branch ends with",
    "during": f"what its steps end with; `{TIMEOUT}` after `at_most_s`; or the outcome that stands in `then`",
    "choose": "what the branch ends with; `done` where none holds",
    "together": "what `steps` end with; or an outcome other than `done` of a step beside",
    "call": "what the part ends with",
    "end": "nothing comes after it",
    "stop": "nothing comes after it",
}
Schema = Mapping[str, Any]


def steps_markdown(schema: Schema) -> str:
    """For each step and word what it does, how it may end, and a table of its keys."""
    definitions: Mapping[str, Schema] = schema["$defs"]
    behaviours, text = declarations(names(BEHAVIOURS)), ""
    for name, step in definitions["Step"]["properties"].items():
        used = [definitions[key] for key in _references(step)]
        says = step.get("description") or used[0]["description"]
        rows = [row for each in ([step] if name in behaviours else used) for row in _rows(each, "", definitions)]
        ends = _ENDS.get(name) or f"`{DONE}`{ends_words(outcomes(name, behaviours))}"
        text += f"### `{name}`\n\n{_line(says)} Ends with {ends}.\n\n".replace("Ends with nothing", "Nothing")
        if rows:
            text += "| key | value | default | meaning |\n|---|---|---|---|\n" + "".join(rows) + "\n"
    return text


def _rows(definition: Schema, prefix: str, definitions: Mapping[str, Schema]) -> Iterator[str]:
    """A line for each key, and for the keys within."""
    needed = definition.get("required", [])
    for key, value in definition.get("properties", {}).items():
        name, default = f"{prefix}{key}", value.get("default")
        shown = (
            "needed"
            if key in needed
            else ""
            if default in (None, [], {}) or isinstance(default, dict)
            else _text(default)
        )
        yield f"| `{name}` | {_kind(value)} | {shown} | {_line(value.get('description', ''))} |\n"
        for inner in _references(value):
            if inner != "Step":
                within = "[]." if "items" in value else ".DRIVE." if "additionalProperties" in str(value) else "."
                yield from _rows(definitions[inner], f"{name}{within}", definitions)


def _kind(value: Schema) -> str:
    """What is written as the value of a key."""
    if choices := value.get("anyOf") or value.get("oneOf"):
        return " or ".join(dict.fromkeys(_kind(choice) for choice in choices if choice.get("type") != "null"))
    if "enum" in value or "const" in value:
        return ", ".join(_text(word) for word in value.get("enum") or [value["const"]])
    if "$ref" in value:
        return "mapping"
    match value["type"]:
        case "array":
            if "prefixItems" in value:
                return f"list of {len(value['prefixItems'])} numbers"
            return "steps" if "Step" in _references(value) else f"list: {_kind(value['items'])}"
        case "object":
            return "steps, by outcome" if "Step" in _references(value) else "mapping"
        case "string":
            return "condition" if value.get("format") == "condition" else "text"
        case "boolean":
            return "`true`, `false`"
    words = "whole number" if value["type"] == "integer" else "number"
    bounds = [("exclusiveMinimum", "> "), ("minimum", ">= "), ("maximum", "<= ")]
    return ", ".join([words, *(f"{sign}{value[key]:g}" for key, sign in bounds if key in value)])


def _references(value: Any) -> list[str]:  # noqa: ANN401 (any part of a schema)
    """Names of the definitions that a part of a schema uses."""
    if isinstance(value, dict):
        own = [str(value["$ref"]).rpartition("/")[2]] if "$ref" in value else []
        return own + [name for part in value.values() for name in _references(part)]
    return [name for part in value for name in _references(part)] if isinstance(value, list) else []


def _text(value: object) -> str:
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def _line(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
