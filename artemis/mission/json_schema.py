"""JSON schemas of mission and robot files, for editors."""

from __future__ import annotations

import ast
import inspect
from contextlib import suppress
from inspect import getmodule
from types import ModuleType
from typing import Any

from pydantic.errors import PydanticInvalidForJsonSchema

from artemis import axles, battery, drive_schema, mounting, vehicle
from artemis.config import Config
from artemis.errors import PluginError
from artemis.families import cia402
from artemis.mission import actions, goto, obstacles, schema, words
from artemis.mission.conditions import UNTIL
from artemis.mission.injector import installed_injector
from artemis.mission.schema import Mission
from artemis.plugins.registry import BEHAVIOURS, behaviour_class, names
from artemis.route_planning import zones

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def mission_schema() -> dict[str, object]:
    """JSON schema of a mission file, for editors."""
    found: dict[str, Any] = _schema(Mission, actions, goto, obstacles, words, schema, zones)
    if (injector := installed_injector()) is not None:
        found["$defs"]["InjectedFault"]["properties"]["inject"]["enum"] = list(injector.ids())
    step = found["$defs"]["Step"]
    step["additionalProperties"] = False
    for name in names(BEHAVIOURS):
        with suppress(PluginError, PydanticInvalidForJsonSchema):  # `artemis plugins` reports what is broken
            plugin = behaviour_class(name)
            own = _schema(plugin.Config, getmodule(plugin.Config), template=f"#/$defs/{name}.{{model}}")
            found["$defs"] |= {f"{name}.{model}": inner for model, inner in own.pop("$defs", {}).items()}
            told = (inspect.getdoc(plugin) or name).partition("\n")[0]
            if UNTIL in own.get("properties", {}):
                own["properties"][UNTIL]["format"] = "condition"
            step["properties"][name] = {**own, "description": told}
            del step["properties"][name]["$schema"]
    return found


def robot_schema() -> dict[str, object]:
    """JSON schema of a robot file, for editors."""
    return _schema(vehicle.RobotFile, vehicle, axles, battery, cia402, drive_schema, mounting)


def _schema(model: type[Config], *modules: ModuleType | None, template: str = "#/$defs/{model}") -> dict[str, Any]:
    found = {"$schema": _DIALECT, **model.model_json_schema(ref_template=template)}
    definitions = found.get("$defs")
    models = {**(definitions if isinstance(definitions, dict) else {}), model.__name__: found}
    for (name, field), description in (item for module in modules for item in _field_docstrings(module).items()):
        properties = models.get(name, {}).get("properties", {})
        if (key := field.removesuffix("_")) in properties:  # `if_` is the key `if`
            properties[key]["description"] = description
    for value in (value for each in models.values() for value in each.get("properties", {}).values()):
        used = [each["$ref"].rpartition("/")[2] for each in (value, *value.get("anyOf", ())) if "$ref" in each]
        told = models[used[0].rpartition(".")[2]].get("description") if len(used) == 1 else None
        if told and "description" not in value:
            value["description"] = told.partition("\n\n")[0]
    return found


def _field_docstrings(module: ModuleType | None) -> dict[tuple[str, str], str]:
    """The texts below the fields of a module's classes, by class and field, also of classes that inherit them there.

    Of a module without source none.
    """
    found: dict[tuple[str, str], str] = {}
    try:
        tree = ast.parse(inspect.getsource(module) if module is not None else "")
    except (OSError, TypeError, SyntaxError):
        return found
    for owner in (node for node in tree.body if isinstance(node, ast.ClassDef)):
        bases = {base.id for base in owner.bases if isinstance(base, ast.Name)}
        found |= {(owner.name, name): text for (base, name), text in found.items() if base in bases}
        for field, text in zip(owner.body, owner.body[1:], strict=False):
            match field, text:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(words))):
                    found[owner.name, name] = inspect.cleandoc(words)
    return found
