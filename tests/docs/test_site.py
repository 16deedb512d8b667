"""What the site is made of: reference pages from the code, pictures of what GitHub draws by Mermaid."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from artemis.mission import mission_schema, robot_schema

ROOT = Path(__file__).parents[2]
SCHEMAS = {"mission": mission_schema, "robot": robot_schema}


def script(path: str) -> ModuleType:
    """A file of `docs`, which is no package."""
    spec = importlib.util.spec_from_file_location(f"docs_{Path(path).stem}", ROOT / path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


BUILD, MODES = script("docs/site/build.py"), script("docs/images/modes.py")


def rows(kind: str) -> Iterator[tuple[str, list[str]]]:
    """The cells of a reference page's tables, with the part in which each row stands."""
    part = ""
    for line in "\n".join(BUILD.keys(kind, SCHEMAS[kind]())).splitlines():
        part = line.removeprefix("## ") if line.startswith("## ") else part
        if line.startswith("| `"):
            yield part, [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]


@pytest.mark.parametrize("kind", SCHEMAS)
def test_every_key_of_a_reference_has_a_meaning(kind: str) -> None:
    found = list(rows(kind))
    assert len(found) > 100
    assert [f"{part}: {key}" for part, (key, _, _, meaning) in found if not meaning] == []
    assert [f"{part}: {key}" for part, (key, type_, _, _) in found if not type_] == []


@pytest.mark.parametrize("kind", SCHEMAS)
def test_every_part_of_a_reference_says_what_it_is(kind: str) -> None:
    page = "\n".join(BUILD.keys(kind, SCHEMAS[kind]()))
    assert re.findall(r"^## (\w+)\n\n\s*\n", page, re.MULTILINE) == []


@pytest.mark.parametrize(
    ("kind", "part", "key", "default"),
    [
        ("mission", "mission", "tick_hz", "`50`"),
        ("mission", "mission", "steps", "required"),
        ("mission", "mission", "supervision", "`{stop_distance_m: 0.6, wait_for_arm: false}`"),
        ("mission", "mission", "simulation", "`{seed: 0}`"),
        ("mission", "mission", "localizer", "-"),
        ("mission", "MeasureSteering", "reference_deg", "-"),
        ("mission", "Goto", "follower", "`{plugin: frenet}`"),
        ("mission", "approach", "speed_m_s", "`0.2`"),
        ("robot", "Geometry", "differential", "`false`"),
        ("robot", "Cia402", "interpolation_period", "`true`"),
        ("robot", "Cia402", "settings", "-"),
    ],
)
def test_defaults_are_those_of_a_file(kind: str, part: str, key: str, default: str) -> None:
    assert [cells[2] for where, cells in rows(kind) if (where, cells[0]) == (part, f"`{key}`")] == [default]


def test_types_are_words_and_links() -> None:
    types = {(part, cells[0].strip("`")): cells[1] for kind in SCHEMAS for part, cells in rows(kind)}
    assert types["robot", "drives"] == "by name: [Drive](#drive)"
    assert types["Gains", "current"] == "list: whole number, whole number"
    assert types["Geometry", "driven_axle"] == "`front`, `rear`"
    assert types["mission", "localizer"] == "[PluginUse](#pluginuse)"
    assert types["mission", "bus"] == "`simulation` or [BusWords](#buswords) or [SerialWords](#serialwords)"


def test_every_mermaid_diagram_is_a_picture_on_the_site() -> None:
    drawn = 0
    for page in (ROOT / "docs").rglob("*.md"):
        text = page.read_text()
        names = BUILD.MERMAID.findall(text)
        shown = BUILD.adapted(page)
        assert "```mermaid" not in shown, page
        for name in names:
            assert shown.count(f"(images/{name}.svg)") == 1
            assert (page.parent / f"images/{name}.svg").exists()
        drawn += len(names)
    assert drawn >= 2


def test_picture_of_the_modes_is_the_table_that_runs() -> None:
    assert (ROOT / "docs/images/modes.svg").read_text() == MODES.drawing()


def test_a_page_is_one_entry_of_the_menu() -> None:
    for page in (ROOT / "docs").rglob("*.md"):
        without_code = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
        assert len(re.findall(r"^# ", without_code, re.MULTILINE)) == 1, page
