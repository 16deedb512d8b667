"""`artemis plugins`: what is installed, and the beginning of a plugin of one's own."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from importlib.resources import files
from pathlib import Path
from string import Template

from artemis.errors import ConfigError
from artemis.plugins.registry import BEHAVIOURS, CONTRACTS, FOLLOWERS, INPUTS, LOCALIZERS, OBSERVERS, SCANNERS, listing
from artemis.progress import OWN_STEPS

GROUPS = {
    "input": INPUTS,
    "follower": FOLLOWERS,
    "localizer": LOCALIZERS,
    "scanner": SCANNERS,
    "observer": OBSERVERS,
    "behaviour": BEHAVIOURS,
}
NAME = re.compile("[a-z][a-z0-9]*(-[a-z0-9]+)*")
LONGEST = 30
"""Letters of a name: longer ones would make long lines of the package's code."""
ADVICE = {
    "input": "As written it drives without an enable button: run it in simulation only.",
    "follower": "It is pure pursuit, to begin with; `path.csv` is a path to try it on.",
    "localizer": "As it is, it knows where a simulated robot is: in `fixes`, ask your device instead.",
    "scanner": "As it is, it sees a round room that is not there: in `run`, ask your device instead.",
    "observer": "It writes how far the robot has gone into `NAME.txt` of the run's folder, to begin with.",
    "behaviour": "It drives an arc, to begin with; its name is the key of the step in `mission.yaml`.",
}

SCANNER = """
outline: {{front_m: 0.68, rear_m: 0.12, half_width_m: 0.27}}   # around the wheels, turned out

scanners:
  front:
    plugin: {}
    x_m: 0.56              # from the centre of the rear axle
    y_m: 0.0
    heading_deg: 0
    height_m: 0.30
    least_range_m: 0.1
"""
"""In the robot file of a package with a scanner."""


def show_plugins() -> int:
    """Print every installed plugin with where it comes from; the exit status: 1 if one is broken."""
    broken = False
    for group in CONTRACTS:
        for found in listing(group, check=True):
            origin = f"{found.distribution or 'unknown package'} {found.version}".rstrip()
            sys.stdout.write(f"{group:18}  {found.name:14}  {origin:22}  {found.target}\n")
            if found.error:
                broken = True
                sys.stdout.write(f"    BROKEN: {found.error}\n")
    return int(broken)


def begin_plugin(kind: str, name: str, folder: Path) -> None:
    """Write the package `artemis-NAME` into `folder`: a plugin that works, its tests, a mission for it.

    Raises:
        ConfigError: an impossible or taken name, the package's folder is there already, or it cannot be written.
    """
    root = folder / f"artemis-{name}"
    problems = [] if kind in GROUPS else [f"no plugins of kind {kind!r}: write one of {', '.join(GROUPS)}"]
    problems += _problems_of_name(name, kind)
    if not folder.is_dir():
        problems.append(f"--folder {folder}: no such folder")
    elif root.exists():
        problems.append(f"{root}: exists already; choose another name or --folder")
    if problems:
        raise ConfigError(problems)
    target = root
    try:
        for file, text in _Package(kind, name).files().items():
            target = root / file
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{error.filename or target}: cannot be written: {error.strerror}") from error
    sys.stdout.write(f"{root}: created; see README.md for what to do next\n")


def _problems_of_name(name: str, kind: str) -> list[str]:
    if not NAME.fullmatch(name) or len(name) > LONGEST:
        expected = (
            f"expected at most {LONGEST} small letters and digits, parts joined by single hyphens, a letter first"
        )
        return [f"{name!r} is no name of a plugin: {expected}"]
    if kind == "behaviour" and name in OWN_STEPS:
        return [f"{name!r} is a step of artemis' own; another name"]
    for found in listing(GROUPS[kind]) if kind in GROUPS else ():
        if found.name == name:
            return [f"the {kind} '{name}' is installed already, from {found.distribution}; another name"]
    try:
        installed = distribution(f"artemis-{name}")
    except PackageNotFoundError:
        return []
    return [f"a package artemis-{name} {installed.version} is installed already; another name"]


@dataclass(frozen=True)
class _Package:
    """The texts of a package for a plugin."""

    kind: str
    name: str

    def files(self) -> dict[str, str]:
        """Texts by their file's name in the package."""
        made = {
            "pyproject.toml": self._filled("pyproject.toml"),
            "README.md": self._filled("README.md"),
            f"src/{self._module}/__init__.py": self._filled(f"{self.kind}/plugin.py"),
            f"src/{self._module}/py.typed": "",
            f"tests/test_{self._module}.py": self._filled(f"{self.kind}/test.py"),
            "mission.yaml": self._filled(f"{self.kind}/mission.yaml"),
            "robot.yaml": self._robot(),
        }
        return made if self.kind in ("input", "behaviour") else made | {"path.csv": self._filled("follower/path.csv")}

    def _robot(self) -> str:
        text = (files("artemis") / "testing/artemis.yaml").read_text(encoding="utf-8")
        return text + SCANNER.format(self.name) if self.kind == "scanner" else text

    @property
    def _module(self) -> str:
        return f"artemis_{self.name.replace('-', '_')}"

    def _filled(self, template: str) -> str:
        title = "".join(part.capitalize() for part in self.name.split("-"))
        text = (files("artemis.plugins") / "templates" / f"{template}.txt").read_text(encoding="utf-8")
        return Template(text).substitute(
            name=self.name,
            kind=self.kind,
            group=GROUPS[self.kind],
            module=self._module,
            title=title,
            signal=self.name.replace("-", "_"),
            plugin=f"{title}{self.kind.capitalize()}",
            advice=ADVICE[self.kind],
        )
