"""Builds the documentation as a site: today's pages, reference pages made from the code, broken links as errors.

The pages are copied first, with all that they link to, so that a link to a source file shows that file.
"""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sphinx.cmd.build import build_main
from typer.main import get_command

from artemis.cli import app
from artemis.mission.json_schema import mission_schema, robot_schema

ROOT = Path(__file__).parents[2]
OUTPUT = ROOT / "build/docs"
COPIED = ("docs", "artemis", "artemis_lab", "missions", "scripts", "tests", "packaging", ".ci")
"""Folders that pages link into."""
LEFT_OUT = shutil.ignore_patterns("__pycache__", "runs", "*.pyc", "*.so")
CONTRACTS = ("artemis.plugins.contracts", "artemis.devices.device", "artemis.testing")
LINK = re.compile(r"(?<!!)\[((?:[^\]`]|`[^`]*`)+)\]\(([^)\s#:]+)\)")
FENCES = re.compile(r"^(```.*?^```)$", re.MULTILINE | re.DOTALL)


def main() -> int:
    """Build; the status of Sphinx."""
    source = OUTPUT / "source"
    shutil.rmtree(OUTPUT, ignore_errors=True)
    for name in COPIED:
        shutil.copytree(ROOT / name, source / name, ignore=LEFT_OUT)
    for file in (*ROOT.glob("*.md"), *ROOT.glob("*.toml"), ROOT / "LICENSE", ROOT / "Makefile", ROOT / "setup.py"):
        shutil.copy(file, source)
    shutil.copy(source / "docs/site/index.txt", source / "index.md")
    reference = source / "reference"
    reference.mkdir()
    (reference / "commands.md").write_text("\n".join(commands()))
    for kind, schema in (("mission", mission_schema()), ("robot", robot_schema())):
        (reference / f"{kind}.md").write_text("\n".join(keys(kind, schema)))
    (reference / "contracts.md").write_text("\n".join(contracts()))
    for page in source.rglob("*.md"):
        page.write_text(adapted(page))
    words = ["-c", str(source / "docs/site"), "--fail-on-warning", "--keep-going", "-q", "-j", "1"]
    status: int = build_main([*words, str(source), str(OUTPUT / "html")])
    return status


def adapted(page: Path) -> str:
    """A page as the site needs it: no links to folders, which a site cannot show; diagrams as their text."""

    def link(found: re.Match[str]) -> str:
        target = (page.parent / found[2]).resolve()
        if target.is_dir():
            return found[1]
        return found[0]

    parts = FENCES.split(page.read_text())
    parts[::2] = [LINK.sub(link, part) for part in parts[::2]]
    return "".join(parts).replace("```mermaid", "```text")


def commands() -> Iterator[str]:
    """Every command with its arguments and options."""
    yield "# Options of the commands\n"
    yield from _command(get_command(app), "artemis")


def _command(command: Any, name: str) -> Iterator[str]:  # noqa: ANN401  typer brings its own click
    context = command.context_class(command, info_name=name)
    yield f"## {name}\n"
    yield f"{command.help or ''}\n"
    subcommands = getattr(command, "commands", {})
    if subcommands:
        for each, below in sorted(subcommands.items()):
            yield from _command(below, f"{name} {each}")
        return
    rows = [record for each in command.params if (record := each.get_help_record(context))]
    if rows:
        yield "| option | |\n|---|---|"
        yield from (f"| `{option.replace('|', ' or ')}` | {_cell(text)} |" for option, text in rows)
        yield ""


def keys(kind: str, schema: dict[str, object]) -> Iterator[str]:
    """Every key of a file, by the part of the file in which it stands."""
    yield f"# Keys of a {kind} file\n"
    yield f"Made from the schema that artemis checks by; `artemis schema {kind}` prints it for editors.\n"
    parts: dict[str, object] = {kind: schema, **_mapping(schema.get("$defs"))}
    for name, part in parts.items():
        properties = _mapping(_mapping(part).get("properties"))
        if not properties:
            continue
        yield f"## {name}\n"
        yield "| key | type | default | |\n|---|---|---|---|"
        required = _mapping(part).get("required")
        for key, value in properties.items():
            rule = _mapping(value)
            default = "required" if isinstance(required, list) and key in required else rule.get("default", "")
            yield f"| `{key}` | {_cell(_type(rule))} | {_cell(default)} | {_cell(rule.get('description', ''))} |"
        yield ""


def _type(rule: dict[str, object]) -> str:
    """A type in words."""
    if isinstance(reference := rule.get("$ref"), str):
        return reference.rpartition("/")[2]
    for several in ("anyOf", "oneOf"):
        if isinstance(options := rule.get(several), list):
            return " or ".join(dict.fromkeys(_type(_mapping(each)) for each in options))
    if isinstance(words := rule.get("enum"), list):
        return ", ".join(map(str, words))
    if rule.get("type") == "array":
        return f"list of {_type(_mapping(rule.get('items')))}"
    return str(rule.get("type", rule.get("const", "any")))


def _mapping(value: object) -> dict[str, object]:
    return value if isinstance(value, dict) else {}


def _cell(value: object) -> str:
    return str(value).replace("|", "\\|").replace("\n", " ").replace("<", "&lt;")


def contracts() -> Iterator[str]:
    """What plugins and devices have to be, from their docstrings."""
    yield "# Contracts\n"
    for module in CONTRACTS:
        yield f"## {module}\n\n```{{eval-rst}}\n.. automodule:: {module}\n   :members:\n   :noindex:\n```\n"


if __name__ == "__main__":
    sys.exit(main())
