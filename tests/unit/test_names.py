"""Names of classes: a reader who searches one finds one."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

HOUSE = Path(__file__).parents[2]


def test_no_two_classes_have_one_name() -> None:
    places: dict[str, list[str]] = defaultdict(list)
    for package in ("artemis", "artemis_lab"):
        for file in sorted((HOUSE / package).rglob("*.py")):
            for node in ast.parse(file.read_text()).body:
                if isinstance(node, ast.ClassDef):
                    places[node.name].append(f"{file.relative_to(HOUSE)}:{node.lineno}")
    assert len(places) > 500, "the test looks at the wrong folders"
    assert {name: found for name, found in places.items() if len(found) > 1} == {}
