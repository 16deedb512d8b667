"""JSON schemas of mission and robot files, for editors."""

from __future__ import annotations

import ast
import inspect
from types import ModuleType
from typing import Any

from artemis import vehicle
from artemis.config import Config
from artemis.mission import schema
from artemis.mission.injector import installed_injector
from artemis.mission.schema import Mission


def mission_schema() -> dict[str, object]:
    """JSON schema of a mission file, for editors."""
    words: dict[str, Any] = _schema(Mission, schema)
    if (injector := installed_injector()) is not None:
        words["$defs"]["InjectedFault"]["properties"]["inject"]["enum"] = list(injector.ids())
    return words


def robot_schema() -> dict[str, object]:
    """JSON schema of a robot file, for editors."""
    return _schema(vehicle.RobotFile, vehicle)


def _schema(model: type[Config], module: ModuleType) -> dict[str, object]:
    words: dict[str, object] = {"$schema": "https://json-schema.org/draft/2020-12/schema", **model.model_json_schema()}
    definitions = words.get("$defs")
    models = {**(definitions if isinstance(definitions, dict) else {}), model.__name__: words}
    for (name, field), description in _field_docstrings(module).items():
        properties = models.get(name, {}).get("properties", {})
        if field in properties:
            properties[field]["description"] = description
    return words


def _field_docstrings(module: ModuleType) -> dict[tuple[str, str], str]:
    """The texts that stand below the fields of a module's classes, by class and field."""
    found: dict[tuple[str, str], str] = {}
    tree = ast.parse(inspect.getsource(module))
    for owner in (node for node in tree.body if isinstance(node, ast.ClassDef)):
        for field, text in zip(owner.body, owner.body[1:], strict=False):
            match field, text:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(words))):
                    found[owner.name, name] = inspect.cleandoc(words)
    return found
