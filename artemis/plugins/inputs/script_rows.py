"""The rows of a script, from a table or from YAML: times, levels of axes and buttons, everything checked."""

from __future__ import annotations

from collections.abc import Sequence

from artemis.errors import ConfigError, shown
from artemis.motion.table import Table, raise_first
from artemis.plugins.inputs.hands import AXES, BUTTONS, PEDALS, Kind
from artemis.yaml_file import Data, KeyPath, surprise, survey


def rows_from(raw: bytes, source: str) -> tuple[Kind, dict[str, list[float]]]:
    """What the script stands in for, as its names of axes show, and its columns; all are equally long.

    Raises:
        ConfigError: everything that is wrong in it, with file:line:column.
    """
    rows = YamlRows(raw, source) if source.endswith((".yaml", ".yml")) else _table(raw, source)
    if rows.complete:
        _check(rows)
    rows.raise_problems()
    return _kind(rows.columns), dict(rows.columns)


class YamlRows:
    """A list of mappings as the columns of a table. A button that a row leaves out is released."""

    def __init__(self, raw: bytes, source: str) -> None:
        """Read all rows that can be read.

        Raises:
            ConfigError: it is no YAML.
        """
        self._document, self._found = survey(raw, source)
        self._problems: list[tuple[KeyPath, str]] = []
        data = self._document.data
        items: list[Data] = data if isinstance(data, list) else []
        if not isinstance(data, list):
            self._problems.append(((), f"expected a list of rows, found {shown(data)}"))
        named = list(dict.fromkeys(name for item in items if isinstance(item, dict) for name in item))
        kind = _kind(named)
        self._required = ("time_s", *AXES[kind])
        buttons = [name for name in named if name in BUTTONS[kind]]
        self.columns: dict[str, list[float]] = {name: [] for name in (*self._required, *buttons)}
        self.lines: list[int] = []
        """Number in the list of each row that could be read."""
        self.complete = isinstance(data, list)
        for index, item in enumerate(items):
            self._read(index, item, (*self._required, *BUTTONS[kind]))

    def _read(self, index: int, item: Data, known: Sequence[str]) -> None:
        row = item if isinstance(item, dict) else {}
        before = len(self._problems)
        if not isinstance(item, dict):
            self._problems.append(((index,), f"expected a row such as {{time_s: 0, x: 0, y: 0}}, found {shown(item)}"))
        elif missing := [name for name in self._required if name not in row]:
            self._problems.append(((index,), f"expected {', '.join(self._required)}; no {', '.join(missing)}"))
        for name, value in row.items():
            if name not in known:
                self._problems.append(((index, name), f"unknown; known are {', '.join(known)}"))
            elif isinstance(value, bool) or not isinstance(value, int | float):
                hint = surprise(value) if isinstance(value, str) else None
                words = f"expected a number, found {shown(value)}" + (f"; {hint}" if hint else "")
                self._problems.append(((index, name), words))
        if len(self._problems) == before:
            self.lines.append(index)
            for name, column in self.columns.items():
                column.append(_number(row.get(name, 0)))

    def report(self, row: int, problem: str, column: str) -> None:
        """Note a problem of a value in a row that could be read."""
        self._problems.append(((self.lines[row], column), problem.removeprefix(f"{column}: ")))

    def report_file(self, problem: str) -> None:
        """Note a problem of the file as a whole."""
        self._problems.append(((), problem))

    def raise_problems(self) -> None:
        """Raise what was found, if anything was.

        Raises:
            ConfigError: as `raise_first`, with file:line:column.
        """
        document = self._document
        ordered = sorted(self._problems, key=lambda problem: document.position(problem[0]))
        fresh = [document.problem(path, text) for path, text in ordered if path not in document.damaged]
        raise_first(self._found + fresh, document.source)


def _number(value: Data) -> float:
    assert isinstance(value, int | float)
    return float(value)


def _kind(names: Sequence[str] | dict[str, list[float]]) -> Kind:
    if "speed" in names:
        return "levers"
    return "wheel" if any(name in names for name in AXES["wheel"]) else "stick"


def _table(raw: bytes, source: str) -> Table:
    """The table in a file; what it stands in for shows in its header."""
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{source}:1:1: byte {error.start} is not text in UTF-8") from error
    header = next((line for line in text.splitlines() if line.partition("#")[0].strip()), "").lower()
    kind = _kind(header)
    required = ("time_s", *AXES[kind])
    return Table(text, source, {name: name for name in (*required, *BUTTONS[kind])}, required=required)


def _check(rows: Table | YamlRows) -> None:
    """Report times that do not rise, and levels that no stick or button has."""
    if not rows.lines:
        rows.report_file("no rows; expected at least one")
    times = rows.columns["time_s"]
    for row, time in enumerate(times):
        if time < 0 or (row > 0 and time <= times[row - 1]):
            rows.report(row, f"time_s: expected at least 0 and more than in the row before, found {time:g}", "time_s")
    for name, levels in rows.columns.items():
        lowest = 0 if name in PEDALS else -1
        for row, level in enumerate(levels):
            if any(name in axes for axes in AXES.values()) and not lowest <= level <= 1:
                rows.report(row, f"{name}: expected {lowest} to 1, found {level:g}", name)
            if name in BUTTONS["wheel"] and level not in (0, 1):
                rows.report(row, f"{name}: expected 0 or 1, found {level:g}", name)
