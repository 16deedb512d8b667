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
MERMAID = re.compile(r"^<!-- (\w+):[^\n]*-->\n```mermaid\n.*?^```\n<!-- end of \1 -->\n", re.MULTILINE | re.DOTALL)
ORPHAN = "---\norphan: true\n---\n"
"""Above a page that is in no menu."""
TYPES = {"object": "mapping", "string": "text", "integer": "whole number", "boolean": "true or false"}


def main() -> int:
    """Build; the status of Sphinx."""
    from sphinx.cmd.build import build_main  # the environment of the tests has no Sphinx

    source = OUTPUT / "source"
    shutil.rmtree(OUTPUT, ignore_errors=True)
    for name in COPIED:
        shutil.copytree(ROOT / name, source / name, ignore=LEFT_OUT)
    for file in (*ROOT.glob("*.md"), *ROOT.glob("*.toml"), ROOT / "LICENSE", ROOT / "Makefile", ROOT / "setup.py"):
        shutil.copy(file, source)
    shutil.copy(source / "docs/site/index.txt", source / "index.md")
    (source / "README.md").write_text(ORPHAN + (ROOT / "README.md").read_text())  # the start page begins with it
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
    """A page as the site needs it: no links to folders, which a site cannot show; diagrams for Mermaid as pictures."""
    text = page.read_text()

    def link(found: re.Match[str]) -> str:
        target = (page.parent / found[2]).resolve()
        if target.is_dir():
            return found[1]
        return found[0]

    def picture(found: re.Match[str]) -> str:
        image = f"(images/{found[1]}.svg)"
        return "" if image in text else f"![{found[1]}]{image}\n"

    parts = FENCES.split(MERMAID.sub(picture, text))
    parts[::2] = [LINK.sub(link, part) for part in parts[::2]]
    return "".join(parts)


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
    definitions = _mapping(schema.get("$defs"))
    steps = _mapping(_mapping(definitions.get("Step")).get("properties"))
    behaviours = {name: step for name, step in steps.items() if "properties" in _mapping(step)}
    parts: dict[str, object] = {kind: schema, **definitions, **behaviours}
    for name, part in parts.items():
        properties = _mapping(_mapping(part).get("properties"))
        if not properties and _mapping(part).get("type") != "object":
            continue
        yield f"## {name}\n"
        yield f"{_cell(_mapping(part).get('description', ''))}\n"
        if not properties:
            continue
        yield "| key | type | default | meaning |\n|---|---|---|---|"
        required = _mapping(part).get("required")
        for key, value in properties.items():
            rule = _mapping(value)
            default = "required" if isinstance(required, list) and key in required else _default(rule.get("default"))
            yield f"| `{key}` | {_cell(_type(rule))} | {_cell(default)} | {_cell(rule.get('description', ''))} |"
        yield ""


def _type(rule: dict[str, object]) -> str:
    """A type in words; null is left out, because who means it leaves out the key."""
    if isinstance(reference := rule.get("$ref"), str):
        name = reference.rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    for several in ("anyOf", "oneOf"):
        if isinstance(options := rule.get(several), list):
            given = (_mapping(each) for each in options)
            return " or ".join(dict.fromkeys(_type(each) for each in given if each.get("type") != "null"))
    if isinstance(words := rule.get("enum", [rule["const"]] if "const" in rule else None), list):
        return ", ".join(f"`{_yaml(each)}`" for each in words)
    if isinstance(places := rule.get("prefixItems"), list):
        return f"list: {', '.join(_type(_mapping(each)) for each in places)}"
    if rule.get("type") == "array":
        return f"list of {_type(_mapping(rule.get('items')))}"
    patterns = [*_mapping(rule.get("patternProperties")).values(), rule.get("additionalProperties")]
    if inner := _mapping(patterns[0]):
        return f"by name: {_type(inner)}"
    found = str(rule.get("type", "any"))
    return TYPES.get(found, found)


def _default(value: object) -> str:
    """A default as it is written in a file; what is not there by default is a dash."""
    value = _without_nothing(value)
    return "-" if value in (None, "", [], {}) else f"`{_yaml(value)}`"


def _without_nothing(value: object) -> object:
    """A mapping without the keys that have no default."""
    if not isinstance(value, dict):
        return value
    return {key: kept for key, each in value.items() if (kept := _without_nothing(each)) not in (None, [], {})}


def _yaml(value: object) -> str:
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key}: {_yaml(each)}' for key, each in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_yaml, value))}]"
    return str(value).lower() if isinstance(value, bool) else str(value)


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
