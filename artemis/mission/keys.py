"""What keys of a mission have in common: names, positive numbers, and mappings with exactly one key."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import AfterValidator, Field

from artemis.config import Config

Positive = Annotated[float, Field(gt=0)]


def _check_name(name: str) -> str:
    if not re.fullmatch("[a-z0-9-]{1,64}", name):
        raise ValueError("expected at most 64 small letters, digits and hyphens")
    return name


Name = Annotated[str, AfterValidator(_check_name), Field(json_schema_extra={"pattern": "^[a-z0-9-]{1,64}$"})]


def check_one_key(config: Config, name: str) -> None:
    """Refuse a mapping, called `name` in the message, that has not exactly one key.

    Raises:
        ValueError: it has none, several, or an empty one.
    """
    fields = type(config).model_fields
    keys = sorted((fields[key].alias or key) if key in fields else key for key in config.model_fields_set)
    if len(keys) != 1:
        choice = ", ".join(field.alias or key for key, field in fields.items())
        raise ValueError(f"{name} has exactly one key of {choice}; found {', '.join(keys) or 'none'}")
    if all((config.model_extra or config.__dict__).get(key) is None for key in config.model_fields_set):
        raise ValueError(f"{keys[0]} is empty; write its keys, or {{}} where it has none")
